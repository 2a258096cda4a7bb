"""A hand that presses towards a surface and strokes over it, to and fro."""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated

from forcebound.messages.packets import Vector
from forcebound.operators.buttons import PressingButtons
from forcebound.operators.grip import SoftGrip
from forcebound.operators.places import (
    Place,
    StraightWay,
    check_places,
    coordinates,
    shifted,
    straight_way,
)
from forcebound.quantities import NOT_NEGATIVE, POSITIVE, Frequency, Speed


@dataclass(frozen=True)
class StrokingHand(SoftGrip, PressingButtons):
    """Mass, spring and damper whose target goes straight to ``end`` and then strokes about it.

    Pressed into a surface, with a ``stroke`` along it, the tip slides: the spring presses with
    about its stiffness times the way from the surface to the target.

    Attributes:
        start: Where the target begins: on the first axis, or a list of one for each axis.
        end: Middle of the strokes, such as behind a surface; likewise.
        approach_speed: Along the way from the one to the other.
        stroke: From the middle to the first turn, a list of one for each axis; the other turn is
            opposite.
        frequency: Of strokes to and fro; the motion is a sine.
    """

    start: Place = -0.010
    end: Place = 0.014  # 4 mm behind the surface of the paper's wall at 10 mm
    approach_speed: Annotated[Speed, POSITIVE] = 0.1
    stroke: Place = (0.0, 0.020)  # across the first axis
    frequency: Annotated[Frequency, NOT_NEGATIVE] = 0.5

    def __post_init__(self) -> None:
        super().__post_init__()
        check_places(self, "start", "end", "stroke")

    def target(self, elapsed: float) -> Vector:
        """Return the target after ``elapsed`` s; see :class:`forcebound.operators.Operator`."""
        travel = self.approach_speed * elapsed
        since = max(elapsed - self._way.length / self.approach_speed, 0.0)
        share = math.sin(2.0 * math.pi * self.frequency * since)
        stroke = tuple([share * length for length in coordinates(self.stroke)])
        return shifted(self._way.at(travel), stroke)

    @cached_property
    def _way(self) -> StraightWay:
        return straight_way(self.start, self.end)
