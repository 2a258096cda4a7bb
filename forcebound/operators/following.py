"""A hand that follows a path of points at an even speed."""

from bisect import bisect_right
from dataclasses import dataclass, field
from itertools import accumulate, pairwise
from pathlib import Path
from typing import Annotated

from forcebound.errors import ConfigError
from forcebound.messages.packets import MAX_AXES, Vector
from forcebound.operators.buttons import PressingButtons
from forcebound.operators.grip import SoftGrip
from forcebound.operators.path_file import read_numbers
from forcebound.operators.places import StraightWay, straight_way
from forcebound.quantities import POSITIVE, Length, Speed


@dataclass(frozen=True)
class FollowingHand(SoftGrip, PressingButtons):
    """Mass, spring and damper whose target goes from point to point in straight lines.

    The points stand in the launch file or in a CSV file: one header line, then a point a line, its
    positions in m, a column for each axis (1 to 6). For a path with times, see ``trajectory``.

    Attributes:
        points: Of the path, in order: a list of one number for each axis.
        file: Of the points, in place of ``points``.
        speed: Along the path.
        repeat: Whether it goes from the last point straight to the first, and on; else it stays.

    Raises:
        ConfigError: If there are points and a file, or neither; if a point has no or too many
            numbers; if the file cannot be read or is not such a table (names the line).
    """

    points: tuple[tuple[Length, ...], ...] = ()
    file: Path | None = None
    speed: Annotated[Speed, POSITIVE] = 0.05
    repeat: bool = False
    _ways: tuple[StraightWay, ...] = field(init=False, repr=False, compare=False)
    _ends: tuple[float, ...] = field(init=False, repr=False, compare=False)  # m, along the path

    def __post_init__(self) -> None:
        super().__post_init__()
        places = self._read()
        ways = [straight_way(one, other) for one, other in pairwise((*places, places[0]))]
        if not self.repeat:
            ways[-1] = straight_way(places[-1], places[-1])
        object.__setattr__(self, "_ways", tuple(ways))
        object.__setattr__(self, "_ends", tuple(accumulate(way.length for way in ways)))

    def target(self, elapsed: float) -> Vector:
        """Return the target after ``elapsed`` s; see :class:`forcebound.operators.Operator`."""
        travel, length = self.speed * max(elapsed, 0.0), self._ends[-1]
        if self.repeat and length > 0.0:
            travel %= length
        number = min(bisect_right(self._ends, travel), len(self._ways) - 1)
        return self._ways[number].at(travel - (self._ends[number] - self._ways[number].length))

    def _read(self) -> tuple[Vector, ...]:
        """Points of equal length."""
        if bool(self.points) == (self.file is not None):
            given = "both" if self.points else "neither"
            message = f"a hand that follows a path needs points or a file, got {given}"
            raise ConfigError(message, field="points")
        points = self.points
        if self.file is not None:
            expected = "1 to 6 positions in m, after one header line"
            try:
                rows = read_numbers(Path(self.file), "the path", expected, 1, MAX_AXES)
                points = tuple([tuple(row) for _, row in rows])
            except ConfigError as error:
                raise ConfigError(str(error), field="file") from None
        for number, point in enumerate(points, start=1):
            if not 1 <= len(point) <= MAX_AXES:
                wanted = f"points: point {number} must have 1 to {MAX_AXES} numbers (one per axis)"
                raise ConfigError(f"{wanted}, got {len(point)}", field="points")
        axes = max(map(len, points))
        return tuple([point + (0.0,) * (axes - len(point)) for point in points])
