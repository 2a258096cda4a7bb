"""A soft hand that approaches, presses nearly with a constant force, and trembles."""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated

from forcebound.messages.packets import Vector
from forcebound.operators import Operator
from forcebound.operators.places import (
    Place,
    StraightWay,
    check_places,
    coordinates,
    shifted,
    straight_way,
)
from forcebound.operators.pressing import pressing_target
from forcebound.quantities import (
    NOT_NEGATIVE,
    POSITIVE,
    Damping,
    Force,
    Frequency,
    Mass,
    Speed,
    Stiffness,
    check_ranges,
)


def trembling_target(
    elapsed: float, start: float, end: float, speed: float, amplitude: float, frequency: float
) -> float:
    """Return the target on one axis, with a sine of ``amplitude``, in m, on it; for kernels."""
    tremor = amplitude * math.sin(2.0 * math.pi * frequency * elapsed)
    return pressing_target(elapsed, start, end, speed) + tremor


@dataclass(frozen=True)
class TremblingHand(Operator):
    """Mass, spring and damper whose target moves from ``start`` to ``end`` and trembles.

    With a soft spring and a target far behind the surface the hand pushes with a force that hardly
    depends on where the handle is, as an arm does whose grip is soft. ``tremor`` is the amplitude
    of a sinusoidal force of the muscles; it moves the target by ``tremor / stiffness``. A hand's
    physiological tremor has 8 to 12 Hz.

    Attributes:
        start: Where the target begins: on the first axis, or a list of one for each axis.
        end: Where it stays, apart from the tremor; likewise.
        approach_speed: Along the way from the one to the other.
        tremor: On the first axis, or a list of one for each axis. Each axis trembles a quarter of
            a cycle after the one before, so that the tip circles.
        tremor_frequency: Of every axis.
    """

    mass: Annotated[Mass, NOT_NEGATIVE] = 0.6
    stiffness: Annotated[Stiffness, POSITIVE] = 28.0
    damping: Annotated[Damping, NOT_NEGATIVE] = 0.1
    start: Place = -0.010
    end: Place = 0.13  # 120 mm behind the surface of the paper's wall at 10 mm
    approach_speed: Annotated[Speed, POSITIVE] = 0.1
    tremor: Annotated[Force, NOT_NEGATIVE] | tuple[Annotated[Force, NOT_NEGATIVE], ...] = 0.4
    tremor_frequency: Annotated[Frequency, NOT_NEGATIVE] = 8.0

    def __post_init__(self) -> None:
        check_ranges(self)
        check_places(self, "start", "end", "tremor")

    def target(self, elapsed: float) -> Vector:
        """Return the target after ``elapsed`` s; see :class:`forcebound.operators.Operator`."""
        phase = 2.0 * math.pi * self.tremor_frequency * elapsed
        tremor = [
            force / self.stiffness * math.sin(phase - 0.5 * math.pi * axis)
            for axis, force in enumerate(coordinates(self.tremor))
        ]
        return shifted(self._way.at(self.approach_speed * elapsed), tuple(tremor))

    @cached_property
    def _way(self) -> StraightWay:
        return straight_way(self.start, self.end)
