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

from forcebound.haptics.controllers.estimating import EstimatingController, EstimatingModel
from forcebound.haptics.controllers.passivity import colgate_schenkel
from forcebound.haptics.controllers.plane import PlaneEstimator, along, dot
from forcebound.messages.packets import DeviceState, Vector
from forcebound.quantities import NOT_NEGATIVE, POSITIVE, Damping, Mass, Stiffness

FORGETTING, STIFFEST = 0.9, 1e6  # of the environment's plane; N/m
PAIR_STEP = 1e-6  # m; a proxy moves little in a stiff wall


@dataclass(frozen=True)
class VirtualCoupling(EstimatingModel):
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


class OpenVirtualCoupling(EstimatingController):
    """A virtual coupling with its proxy."""

    def __init__(self, model: VirtualCoupling) -> None:
        self._model = model
        super().__init__(model)

    def _forget(self) -> None:
        super()._forget()
        self._proxy: Vector | None = None  # m; None: it is where the device is
        self._speed: Vector = ()  # of the proxy, m/s

    def _new_estimator(self) -> PlaneEstimator:
        return PlaneEstimator(FORGETTING, STIFFEST, self._model.release, PAIR_STEP)

    def _force(self, state: DeviceState, dt: float) -> Vector:
        """Move the proxy; return the coupling's force."""
        assert self._proxy is not None  # there is an answer, so there was a question
        if dt > 0.0:
            self._speed = self._step(state, self._proxy, dt)
            self._proxy = along(self._proxy, self._speed, dt)
        spring = along(state.position, self._proxy, -1.0)
        damper = along(state.velocity, self._speed, -1.0)
        k, b = self._model.stiffness, self._model.damping
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

    def _question(self, state: DeviceState) -> tuple[Vector, Vector]:
        """The proxy's position and velocity."""
        if self._proxy is None or self._heard_ns is None:
            self._proxy, self._speed = state.position, (0.0,) * len(state.position)
        return self._proxy, self._speed
