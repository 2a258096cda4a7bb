"""A hand that approaches at a set speed and then presses towards a point behind the surface."""

from dataclasses import dataclass
from functools import cached_property
from typing import Annotated

from forcebound.messages.packets import Vector
from forcebound.operators.grip import SoftGrip
from forcebound.operators.places import Place, StraightWay, check_places, straight_way
from forcebound.quantities import POSITIVE, Speed


def pressing_target(elapsed: float, start: float, end: float, speed: float) -> float:
    """Return the position, in m, of a point that moves at ``speed`` from ``start`` to ``end``.

    On one axis; the same numbers as :func:`forcebound.operators.places.straight_way`, for kernels.
    """
    travel = speed * elapsed
    if travel >= abs(end - start):
        return end
    return start + travel if end > start else start - travel


@dataclass(frozen=True)
class PressingHand(SoftGrip):
    """Mass, spring and damper whose target moves straight from ``start`` to ``end``.

    Attributes:
        start: Where the target begins: on the first axis, or a list of one for each axis.
        end: Where it stays, such as behind a surface; likewise.
        approach_speed: Along the way from the one to the other.
    """

    start: Place = -0.010
    end: Place = 0.014  # 4 mm behind the surface of the paper's wall at 10 mm
    # Paper 4.2: "high" is 150 to 250 mm/s, "low" 20 to 50 mm/s.
    approach_speed: Annotated[Speed, POSITIVE] = 0.2

    def __post_init__(self) -> None:
        super().__post_init__()
        check_places(self, "start", "end")

    def target(self, elapsed: float) -> Vector:
        """Return the target after ``elapsed`` s; see :class:`forcebound.operators.Operator`."""
        return self._way.at(self.approach_speed * elapsed)

    @cached_property
    def _way(self) -> StraightWay:
        return straight_way(self.start, self.end)
