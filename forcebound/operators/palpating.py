"""A hand that moves in to a depth and there to and fro, as in palpation."""

import math
from dataclasses import dataclass
from typing import Annotated

from forcebound.messages.packets import Vector
from forcebound.operators.grip import SoftGrip
from forcebound.quantities import NOT_NEGATIVE, POSITIVE, Frequency, Length, Speed


@dataclass(frozen=True)
class PalpatingHand(SoftGrip):
    """Mass, spring and damper whose target moves to ``centre`` and then is a sine about it.

    Unlike :class:`forcebound.operators.sinusoidal.SinusoidalHand` it begins outside the surface
    and, with a ``centre`` deeper than the ``amplitude``, then never leaves it.
    """

    start: Length = 0.0
    centre: Length = 0.0125  # 2.5 mm behind the surface of the paper's wall at 10 mm
    amplitude: Annotated[Length, NOT_NEGATIVE] = 0.002
    frequency: Annotated[Frequency, NOT_NEGATIVE] = 2.0
    approach_speed: Annotated[Speed, POSITIVE] = 0.05

    def target(self, elapsed: float) -> Vector:
        """Return the target after ``elapsed`` s; see :class:`forcebound.operators.Operator`."""
        way = self.centre - self.start
        since = elapsed - abs(way) / self.approach_speed
        if since < 0.0:
            return (self.centre + math.copysign(self.approach_speed, way) * since,)
        phase = 2.0 * math.pi * self.frequency * since
        return (self.centre + self.amplitude * math.sin(phase),)
