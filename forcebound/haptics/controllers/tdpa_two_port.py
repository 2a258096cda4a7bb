r"""Time-domain passivity of a two-port: the network gives neither end more than the other put in.

Each port adds up the energy that goes into the network there, E_in, and that comes out, E_out,
apart. E_in travels with the packets; it only grows, so the largest one that was received counts,
and loss and disorder are harmless. With F the force (positive: it resists) that was held for a step
d, P is the energy that goes into the network: F d at the hand, -F d at the environment,

.. math::

    E_{in} \mathrel{+}= \max(P, 0), \qquad E_{out} \mathrel{+}= \max(-P, 0)

At the hand it is the force that gives way (an impedance). With the rest R, the other port's
E_in less E_out, and :math:`d = v\,dt` the step that comes next,

.. math:: F \mathrel{+}= \alpha d, \qquad \alpha = (-P - R) / |d|^2 \qquad (-P > R)

so that, while R is negative since another step came, it brakes; that part is at most
``MAX_DAMPING``. At the environment it is the motion that gives way (an admittance). F is the
environment's last answer:

.. math:: d \mathrel{+}= \beta F, \qquad \beta = (R + P) / |F|^2 \qquad (-P > R)

So the environment is asked about a place that falls behind that of the hand. With
``drift_compensation`` a step goes to the hand's place, as far as R pays for it; without, it is the
hand's step, and the drift stays. With several axes the products are those of vectors, and the
energies of all axes are one.

What the method leaves out is left out here, too: the next step is guessed from the device's
low-passed difference of readings, the encoder's steps are taken for motion, and a force is held
while the hand moves on. So the hand can get energy all the same; no law but `none` is of use.

Source: J.-H. Ryu, J. Artigas and C. Preusche, A passive bilateral control scheme for a teleoperator
with time-varying communication delay, Mechatronics 20(7), 2010; J. Artigas, J.-H. Ryu and C.
Preusche, Position drift compensation in time domain passivity based teleoperation, IROS 2010. The
equations were compared with two public implementations, not with the papers' text; there a drift
stays while F is 0, here it is then made good, since it costs nothing.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated

from forcebound.haptics.controllers import Ask, Controller, ControllerModel, SecondPort
from forcebound.haptics.controllers.plane import along, dot
from forcebound.haptics.parts.signals import Signal
from forcebound.messages.packets import DeviceState, EnvironmentQuery, EnvironmentReply, Vector
from forcebound.quantities import POSITIVE, Ranged, Time

MAX_DAMPING = 30.0  # N s/m, as of the law `tdpa`


@dataclass(frozen=True, kw_only=True)
class TdpaTwoPort(Ranged, ControllerModel):
    """Parameters of the two-port passivity control.

    Attributes:
        drift_compensation: Whether the environment's place comes back to the hand's.
        hold: Silence of the environment after which there is no force.
    """

    drift_compensation: bool = True
    hold: Annotated[Time, POSITIVE] = 0.1

    answers_states = True
    takes_contacts = False
    signals = (
        Signal("energy_in", "J", "into the network, at the hand"),
        Signal("energy_out", "J", "out of the network, at the hand"),
    )
    port_signals = (
        Signal("port_energy_in", "J", "into the network, at the environment"),
        Signal("port_energy_out", "J", "out of the network, at the environment"),
        Signal("drift", "m", "from the hand's place, as it was sent, to the environment's"),
    )

    def open(self, axes: int) -> "HandPort":
        return HandPort(self.hold, axes)

    def open_port(self, axes: int) -> "EnvironmentPort":
        return EnvironmentPort(self.drift_compensation, axes)


@dataclass
class Book:
    """The energies of one port, and E_in of the other one, in J."""

    entered: float = 0.0
    left: float = 0.0
    other: float = 0.0

    def add(self, entering: float) -> None:
        """Enter what one step put in, or took out if it is negative."""
        self.entered += max(entering, 0.0)
        self.left += max(-entering, 0.0)

    def limited(self, effort: Vector, flow: Vector) -> Vector:
        """Return an effort that along a flow takes no more out than there is."""
        lack = -dot(effort, flow) - max(self.other - self.left, 0.0)
        squared = dot(flow, flow)
        return along(effort, flow, lack / squared) if lack > 0.0 and squared > 0.0 else effort


class HandPort(Controller):
    """The port at the hand."""

    def __init__(self, hold: float, axes: int) -> None:
        self._hold_ns, self._zero = round(hold * 1e9), (0.0,) * axes
        self._book, self._environment = Book(), ""
        self._state: DeviceState | None = None
        self._dt, self._heard_ns = 0.0, 0
        self._answer = self._held = self._zero  # of the environment; on the hand, N

    def on_state(self, state: DeviceState, time_ns: int) -> Vector | None:
        """Close the last tick's books; return the force of this one."""
        before, self._state = self._state or state, state
        self._dt = (state.time_ns - before.time_ns) * 1e-9
        self._book.add(dot(self._held, along(state.position, before.position, -1.0)))
        self.signal_all(("energy_in", "energy_out"), (self._book.entered, self._book.left))
        if self._environment and time_ns - self._heard_ns <= self._hold_ns:
            return self._force(state)
        self._held = self._zero
        return None

    def query(self, state: DeviceState) -> tuple[Vector, Vector]:
        return state.position, state.velocity

    def on_reply(self, reply: EnvironmentReply, time_ns: int) -> Vector | None:
        """Take the answer; return the force if it answers the newest state."""
        self._heard_ns, self._answer, book = time_ns, reply.force, self._book
        signals = reply.signals if isinstance(reply.signals, Mapping) else {}
        entered = signals.get("port_energy_in", 0.0)
        book.other = max(book.other, entered)
        if reply.environment != self._environment:  # it has begun to count
            book.left, book.other, self._environment = entered, entered, reply.environment
        state = self._state
        return self._force(state) if state and state.seq == reply.device_seq else None

    def _force(self, state: DeviceState) -> Vector:
        step, book = along(self._zero, state.velocity, self._dt), self._book
        self._held = book.limited(self._answer, step)
        if book.left > book.other and (squared := dot(step, step)) > 0.0:
            damping = min((book.left - book.other) * self._dt / squared, MAX_DAMPING)
            self._held = along(self._held, state.velocity, damping)
        return self._held


class EnvironmentPort(SecondPort):
    """The port at the environment."""

    def __init__(self, compensates: bool, axes: int) -> None:
        self._compensates, self._zero, self._book = compensates, (0.0,) * axes, Book()
        self._before: EnvironmentQuery | None = None
        self._place = self._force = self._zero  # where the environment was asked, m; its answer, N

    def answer(
        self, query: EnvironmentQuery, signals: Mapping[str, float], ask: Ask
    ) -> tuple[Vector, Mapping[str, float]]:
        """Move by the hand's step, as far as the energy goes."""
        before, book = self._before or query, self._book
        if self._before is None:  # the hand may have counted for another environment
            self._place, book.left = query.position, signals["energy_in"]
        self._before, book.other = query, max(book.other, signals["energy_in"])
        start = self._place if self._compensates else before.position
        step = book.limited(
            along(query.position, start, -1.0), along(self._zero, self._force, -1.0)
        )
        book.add(-dot(step, self._force))
        self._place = along(self._place, step, 1.0)
        dt = (query.device_time_ns - before.device_time_ns) * 1e-9
        changed = along(along(step, query.position, -1.0), before.position, 1.0)
        velocity = along(query.velocity, changed, 1.0 / dt if dt > 0.0 else 0.0)
        self._force = ask(self._place, velocity)
        drift = math.dist(query.position, self._place)
        sent = {"port_energy_in": book.entered, "port_energy_out": book.left, "drift": drift}
        return self._force, sent
