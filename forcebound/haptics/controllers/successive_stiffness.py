r"""Successive stiffness increment (SSI): what a release did not give back lifts the next press.

With penetration e and its rate, the environment's force :math:`f_{raw}`, and the force f:

.. math::

    f &= f_{raw} + \alpha \delta, \quad x_{max} = e, \quad f_{max} = f \quad
        (\text{pressing}, \dot e \ge 0) \\
    f &= f_{raw} + \alpha \delta_{pressed}, \quad E_O = \sum f \Delta e \quad
        (\text{releasing}, \dot e < 0) \\
    \delta &= \frac{2}{x_{max}} \Big(E_O + \frac{x_{max} f_{max}}{2}\Big)

so with small releases the force rises from press to press, towards at most
:math:`1 / (1 - \alpha)` times that of the wall, and a full release of a wall without damping
changes nothing. In its own account each press stores the triangle :math:`x_{max} f_{max} / 2` and
each release takes :math:`-E_O`; the sum stays positive for :math:`\alpha \le 1`. The account is too
kind: a small press after a small release stores the whole triangle again, so a hand that does this
and then lets go gets energy, even without a delay. Neither encoder nor hold is counted, the rate is
a difference of readings, and a wall that leaks with ``direct`` leaks with it. It promises nothing
to the hand. For one axis; with several it acts along the force.

Source: C. Lee, D.-H. Kim, H. Singh, J.-H. Ryu, Successive stiffness increment and time domain
passivity approach for stable high bandwidth control of series elastic actuator, presented at ICRA
2020. Its text could not be had; the equations are those of the first author's library (KTBioLabLib
of the KOREATECH Biorobotics Lab, ``ImpedanceSSI``), read there with :math:`\alpha = 0.1` and f_max
at most 1.5 N. Different here: a wall has one side, so e counts from where its force began, there is
no offset without contact, and a force never pulls; and a press before a release is complete is one
on the same side, where the library changes the sign. The library's successive force augmentation
(SFA) needs the stiffness of the wall, which a controller does not know, and is left out.
"""

import math
from dataclasses import dataclass
from typing import Annotated

from forcebound.haptics.controllers import Controller, ControllerModel
from forcebound.haptics.controllers.plane import along, dot
from forcebound.messages.packets import DeviceState, EnvironmentReply, Vector
from forcebound.quantities import POSITIVE, Force, Range, Ratio


@dataclass(frozen=True)
class SuccessiveStiffness(ControllerModel):
    """Parameters of the successive stiffness increment.

    Attributes:
        gain: Share α of the offset that the next press gets; up to 1.
        largest_force: Most that counts as the force of a press, f_max.
    """

    gain: Annotated[Ratio, Range(at_least=0, at_most=1)] = 0.1
    largest_force: Annotated[Force, POSITIVE] = 1.5
    takes_contacts = False

    def open(self, axes: int) -> "OpenSuccessiveStiffness":
        return OpenSuccessiveStiffness(self, axes)


class OpenSuccessiveStiffness(Controller):
    """A successive stiffness increment with its last press."""

    def __init__(self, model: SuccessiveStiffness, axes: int) -> None:
        self._model = model
        self._position: Vector = (0.0,) * axes
        self._origin: Vector | None = None  # where the contact began; None: there is none
        self._depth = self._deepest = self._force = self._released = 0.0
        self._offset = self._held = 0.0  # N, of the next press and of the last

    def query(self, state: DeviceState) -> tuple[Vector, Vector]:
        self._position = state.position
        return state.position, state.velocity

    def on_reply(self, reply: EnvironmentReply, time_ns: int) -> Vector:
        """Return the environment's force with the offset of this press."""
        raw = math.hypot(*reply.force)
        if raw == 0.0:
            self._origin = None
            return reply.force
        if self._origin is None:
            self._origin, self._depth = self._position, 0.0
        depth = dot(reply.force, along(self._position, self._origin, -1.0)) / raw
        force, move = self._step(raw, depth), depth - self._depth
        self._depth = depth
        if move < 0.0 and self._deepest > 0.0:
            self._released += force * move
            self._offset = 2.0 * self._released / self._deepest + self._force
        return tuple([force / raw * one for one in reply.force])

    def _step(self, raw: float, depth: float) -> float:
        """Return the force, in N; a press is remembered."""
        if depth < self._depth:
            return max(raw + self._model.gain * self._held, 0.0)
        force = max(raw + self._model.gain * self._offset, 0.0)
        self._deepest, self._force = depth, min(force, self._model.largest_force)
        self._held, self._released = self._offset, 0.0
        return force
