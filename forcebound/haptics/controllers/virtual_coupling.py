r"""A virtual coupling: spring and damper between the device and a proxy in the environment.

The environment is asked about the proxy p, so it never meets the hand itself
(``docs/controllers.md``). A step of time is taken implicitly, as stiff contacts need:

.. math:: \frac{m}{dt} (w' - w) = k (x - p - w'\,dt) + b (v - w') - F_{env}(p + w'\,dt)

The environment's force in it is that of a plane estimated from its answers, since the answer about
p' is not there yet.

Source: J. E. Colgate, M. C. Stanley and J. M. Brown, Issues in the haptic display of tool use, IROS
1995; R. J. Adams and B. Hannaford, Stable haptic interaction with virtual environments, IEEE
Transactions on Robotics and Automation 15(3), 1999.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

from forcebound.haptics.controllers import Controller
from forcebound.haptics.controllers.exchange import Exchange, ReplyTimeouts, has_restarted
from forcebound.haptics.controllers.passivity import colgate_schenkel
from forcebound.haptics.controllers.plane import Asked, PlaneEstimator
from forcebound.haptics.controllers.vectors import along, dot
from forcebound.messages.packets import DeviceState, EnvironmentReply, Vector
from forcebound.quantities import NOT_NEGATIVE, POSITIVE, Damping, Mass, Stiffness

FORGETTING, STIFFEST = 0.9, 1e6  # of the environment's plane; N/m
PAIR_WAY = 1e-6  # m; a proxy moves little in a stiff wall


@dataclass(frozen=True)
class VirtualCoupling(ReplyTimeouts):
    """Parameters of the virtual coupling.

    Attributes:
        stiffness: Between device and proxy; all that a hand can feel of a wall.
        damping: Between them.
        mass: Of the proxy; 0: it moves at once to where both forces are equal.
    """

    stiffness: Annotated[Stiffness, POSITIVE] = 250.0
    damping: Annotated[Damping, NOT_NEGATIVE] = 0.02
    mass: Annotated[Mass, NOT_NEGATIVE] = 0.0

    def cautions(self, damping: float, period: float, delay: float) -> Sequence[str]:
        stiffest = colgate_schenkel(damping, period, self.damping, delay)
        if self.stiffness <= stiffest:
            return ()
        needed = self.stiffness * (0.5 * period + delay) + self.damping
        return (
            f"stiffness {self.stiffness:g} N/m and damping {self.damping:g} N s/m are passive by"
            f" themselves with a device damping of K (T/2 + t_d) + B = {needed:.3g} N s/m; this"
            f" device has {damping:.3g} N s/m, so without a certified law the hand can get energy,"
            f" and with one it gets less force: passive is a stiffness up to {stiffest:.3g} N/m",
        )

    def open(self, axes: int) -> "OpenVirtualCoupling":
        """Return a coupling whose proxy is where the device is at its first state."""
        return OpenVirtualCoupling(self)


class OpenVirtualCoupling(Controller):
    """A virtual coupling with its proxy."""

    def __init__(self, model: VirtualCoupling) -> None:
        self._model = model
        self._time_ns = 0  # of the newest state, controller's clock
        self._state: DeviceState | None = None
        self._let_go()

    def _let_go(self) -> None:
        model = self._model
        self._exchange = Exchange(model)
        self._estimator = PlaneEstimator(FORGETTING, STIFFEST, model.release, PAIR_WAY)
        self._is_answered = False
        self._proxy: Vector | None = None  # m
        self._speed: Vector = ()  # of the proxy, m/s

    def on_state(self, state: DeviceState, time_ns: int) -> Vector | None:
        """Move the proxy; return the coupling's force, None without a living environment."""
        if self._state is not None and has_restarted(self._state, state):
            self._let_go()
        dt = 0.0 if self._state is None else (state.time_ns - self._state.time_ns) * 1e-9
        self._state, self._time_ns = state, time_ns
        share = self._exchange.share(time_ns)
        if self._is_answered and share == 0.0:
            self._let_go()
        if self._proxy is None or not self._is_answered:
            self._proxy, self._speed = state.position, (0.0,) * len(state.position)
            return None if not self._is_answered else self._speed
        if dt > 0.0:
            self._speed = self._step(state, self._proxy, dt)
            self._proxy = along(self._proxy, self._speed, dt)
        spring = along(state.position, self._proxy, -1.0)
        damper = along(state.velocity, self._speed, -1.0)
        k, b = share * self._model.stiffness, share * self._model.damping
        return tuple([k * x + b * v for x, v in zip(spring, damper, strict=True)])

    def _step(self, state: DeviceState, proxy: Vector, dt: float) -> Vector:
        """Return the proxy's new velocity, in m/s."""
        model = self._model
        inertia = model.mass / dt
        resistance = inertia + model.damping + model.stiffness * dt
        spring = along(state.position, proxy, -1.0)
        pulled = [
            (model.stiffness * x + model.damping * v + inertia * w) / resistance
            for x, v, w in zip(spring, state.velocity, self._speed, strict=True)
        ]
        free, plane = tuple(pulled), self._estimator.plane
        if plane is None or plane.depth(along(proxy, free, dt)) <= 0.0:
            return free
        speed, depth = dot(free, plane.inwards), plane.depth(proxy)
        slowed = resistance * speed - plane.stiffness * depth
        slowed /= resistance + plane.stiffness * dt + plane.damping
        return along(free, plane.inwards, slowed - speed)

    def query(self, state: DeviceState) -> tuple[Vector, Vector]:
        """Return the proxy's position and velocity."""
        assert self._proxy is not None  # on_state comes first
        asked = Asked(self._proxy, self._speed, state.time_ns)
        self._exchange.ask(state.seq, asked, self._time_ns)
        return asked.position, asked.velocity

    def on_reply(self, reply: EnvironmentReply, time_ns: int) -> None:
        """Learn the environment's plane from an answer."""
        asked = self._exchange.take(reply, time_ns)
        if asked is None:
            return
        self._is_answered = True
        self._estimator.take(asked, reply.force, reply.contact)
