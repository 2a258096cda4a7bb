"""A soft hand that approaches, presses nearly with a constant force, and trembles."""

import math
from dataclasses import dataclass
from typing import Annotated

from forcebound.messages.packets import Vector
from forcebound.operators.pressing import pressing_target
from forcebound.quantities import (
    NOT_NEGATIVE,
    POSITIVE,
    Damping,
    Force,
    Frequency,
    Length,
    Mass,
    Speed,
    Stiffness,
    check_ranges,
)


def trembling_target(
    elapsed: float, start: float, end: float, speed: float, amplitude: float, frequency: float
) -> float:
    """Return the target of a pressing hand with a sine of ``amplitude``, in m, on it."""
    tremor = amplitude * math.sin(2.0 * math.pi * frequency * elapsed)
    return pressing_target(elapsed, start, end, speed) + tremor


@dataclass(frozen=True)
class TremblingHand:
    """Mass, spring and damper whose target moves from ``start`` to ``end`` and trembles.

    With a soft spring and a target far behind the surface the hand pushes with a force that hardly
    depends on where the handle is, as an arm does whose grip is soft. ``tremor`` is the amplitude
    of a sinusoidal force of the muscles; it moves the target by ``tremor / stiffness``. A hand's
    physiological tremor has 8 to 12 Hz.
    """

    mass: Annotated[Mass, NOT_NEGATIVE] = 0.6
    stiffness: Annotated[Stiffness, POSITIVE] = 28.0
    damping: Annotated[Damping, NOT_NEGATIVE] = 0.1
    start: Length = -0.010
    end: Length = 0.13  # 120 mm behind the surface of the paper's wall at 10 mm
    approach_speed: Annotated[Speed, POSITIVE] = 0.1
    tremor: Annotated[Force, NOT_NEGATIVE] = 0.4
    tremor_frequency: Annotated[Frequency, NOT_NEGATIVE] = 8.0

    def __post_init__(self) -> None:
        check_ranges(self)

    def target(self, elapsed: float) -> Vector:
        """Return the target after ``elapsed`` s; see :class:`forcebound.operators.Operator`."""
        amplitude = self.tremor / self.stiffness
        path = (self.start, self.end, self.approach_speed)
        return (trembling_target(elapsed, *path, amplitude, self.tremor_frequency),)
