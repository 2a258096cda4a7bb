"""A hand, or a shaker in its place, that shakes the handle at one frequency after the other."""

import math
from dataclasses import dataclass
from typing import Annotated

from forcebound.messages.packets import Vector
from forcebound.operators import Operator
from forcebound.quantities import (
    NOT_NEGATIVE,
    POSITIVE,
    Damping,
    Frequency,
    Length,
    Mass,
    Stiffness,
    Time,
    check_ranges,
)


@dataclass(frozen=True)
class ChirpHand(Operator):
    """Mass, spring and damper whose target is a sine of rising frequency along the first axis.

    The frequency rises by the same factor in the same time, from ``lowest`` to ``highest``
    within ``sweep_time``, and stays there. Measures of impedance need such a motion.

    Source: Farina, Simultaneous measurement of impulse response and distortion with a swept-sine
    technique, 108th Convention of the Audio Engineering Society, 2000.
    """

    mass: Annotated[Mass, NOT_NEGATIVE] = 0.05
    stiffness: Annotated[Stiffness, NOT_NEGATIVE] = 2_000.0
    damping: Annotated[Damping, NOT_NEGATIVE] = 10.0
    centre: Length = 0.013
    amplitude: Annotated[Length, NOT_NEGATIVE] = 0.0007
    lowest: Annotated[Frequency, POSITIVE] = 1.0
    highest: Annotated[Frequency, POSITIVE] = 100.0
    sweep_time: Annotated[Time, POSITIVE] = 20.0

    def __post_init__(self) -> None:
        check_ranges(self)

    def target(self, elapsed: float) -> Vector:
        """Return the target after ``elapsed`` s; see :class:`forcebound.operators.Operator`."""
        swept = min(max(elapsed, 0.0), self.sweep_time)
        octaves = math.log(self.highest / self.lowest)
        share = octaves * swept / self.sweep_time
        cycles = self.lowest * (self.sweep_time * math.expm1(share) / octaves if octaves else swept)
        cycles += self.highest * (elapsed - swept)
        return (self.centre + self.amplitude * math.sin(2.0 * math.pi * cycles),)
