"""A hand that moves to and fro, as in palpation."""

import math
from dataclasses import dataclass
from typing import Annotated

from forcebound.messages.packets import Vector
from forcebound.operators.grip import SoftGrip
from forcebound.quantities import NOT_NEGATIVE, Frequency, Length


def sinusoidal_target(elapsed: float, centre: float, amplitude: float, frequency: float) -> float:
    """Return the position, in m, of a sine about ``centre`` that begins at its minimum."""
    phase = 2.0 * math.pi * frequency * elapsed
    return centre - amplitude * math.cos(phase)


@dataclass(frozen=True)
class SinusoidalHand(SoftGrip):
    """Mass, spring and damper whose target is a sine along the first axis (paper Fig. 19: 2 Hz)."""

    centre: Length = 0.010
    amplitude: Annotated[Length, NOT_NEGATIVE] = 0.004
    frequency: Annotated[Frequency, NOT_NEGATIVE] = 2.0

    def target(self, elapsed: float) -> Vector:
        """Return the target after ``elapsed`` s; see :class:`forcebound.operators.Operator`."""
        return (sinusoidal_target(elapsed, self.centre, self.amplitude, self.frequency),)
