"""Hands whose path stands in a file: a CSV table, or the hand in a recording.

Spring and damper of a simulated hand, K and b, gave a recorded hand force ``F = K z + b dz/dt``
for ``z``, the target's distance from the true position. So between two ticks, with F even,

    z(t + dt) = F/K + (z(t) - F/K) exp(-dt K/b)

and the target is position plus z. Of a person on hardware only the position is known. A hand that
follows it is a spring and a damper behind that path, not the person: in front of another wall or
law it shows how they would answer somebody who pulls towards where that person was.
"""

import math
import reprlib
from bisect import bisect_right
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import accumulate, pairwise
from pathlib import Path
from typing import Annotated

import msgspec

from forcebound import mcap_file
from forcebound.errors import ConfigError
from forcebound.files import RECORDING_SUFFIX, content_of, read_rows
from forcebound.haptics.hands.hands import PressingButtons, SoftGrip, StraightWay, straight_way
from forcebound.messages.packets import MAX_AXES, TOPIC_OF, Telemetry, Vector
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
        last = places[0] if self.repeat else places[-1]
        ways = tuple([straight_way(one, other) for one, other in pairwise((*places, last))])
        object.__setattr__(self, "_ways", ways)
        object.__setattr__(self, "_ends", tuple(accumulate(way.length for way in ways)))

    def target(self, elapsed: float) -> Vector:
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
                rows = _numbers(Path(self.file), "the path", expected, 1, MAX_AXES)
                points = tuple([tuple(row) for _, row in rows])
            except ConfigError as error:
                raise ConfigError(str(error), field="file") from None
        for number, point in enumerate(points, start=1):
            if not 1 <= len(point) <= MAX_AXES:
                expected = f"points: point {number} must have 1 to {MAX_AXES} numbers, one per axis"
                raise ConfigError(f"{expected}, got {len(point)}", field="points")
        axes = max(map(len, points))
        return tuple([point + (0.0,) * (axes - len(point)) for point in points])


@dataclass(frozen=True)
class TrajectoryHand(SoftGrip):
    """Mass, spring and damper whose target follows a CSV file, or the hand in a recording.

    A CSV file has a header line; its first column is the time in s, strictly increasing, the others
    (1 to 6) are the target's position in m, one per axis. Between two lines the target moves in a
    straight line; before the first and after the last it rests. Of a recording (``.mcap``), it is
    where the hand wanted to be, as far as that is known, else where the device was
    (docs/recordings.md).
    """

    file: Path
    _times: tuple[float, ...] = field(init=False, repr=False, compare=False)
    _positions: tuple[Vector, ...] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        file = Path(self.file)
        try:
            read = read_recording if file.suffix == RECORDING_SUFFIX else _read_trajectory
            times, positions = read(file)
        except ConfigError as error:
            raise ConfigError(str(error), field="file") from None
        object.__setattr__(self, "_times", times)
        object.__setattr__(self, "_positions", positions)

    def target(self, elapsed: float) -> Vector:
        times, positions = self._times, self._positions
        after = bisect_right(times, elapsed)
        if after in (0, len(times)):
            return positions[after and -1]
        before = after - 1
        share = (elapsed - times[before]) / (times[after] - times[before])
        ends = zip(positions[before], positions[after], strict=True)
        return tuple([a + share * (b - a) for a, b in ends])


def _read_trajectory(file: Path) -> tuple[tuple[float, ...], tuple[Vector, ...]]:
    expected = "time in s, then 1 to 6 positions in m, after one header line"
    times: list[float] = []
    positions: list[Vector] = []
    for place, values in _numbers(file, "the trajectory", expected, 2, 1 + MAX_AXES):
        if times and values[0] <= times[-1]:
            raise ConfigError(f"{place}: time must increase: {values[0]} after {times[-1]}")
        times.append(values[0])
        positions.append(tuple(values[1:]))
    return tuple(times), tuple(positions)


def _numbers(
    file: Path, what: str, expected: str, fewest: int, most: int
) -> Iterator[tuple[str, list[float]]]:
    """Yield the numbers of each line under the header, with its place, ``file.csv:3``."""
    rows = read_rows(file, what)
    _, head = next(rows, ("", []))
    is_empty = True
    for place, row in rows:
        got = reprlib.repr(",".join(row))
        try:
            values = [float(cell) for cell in row]
        except ValueError:
            raise ConfigError(f"{place}: expected {expected}, got {got}") from None
        if not fewest <= len(values) <= most or len(values) != len(head):
            raise ConfigError(f"{place}: expected {expected}, got {len(values)} columns")
        if not all(map(math.isfinite, values)):
            raise ConfigError(f"{place}: expected finite numbers, got {got}")
        yield place, values
        is_empty = False
    if is_empty:
        raise ConfigError(f"{file}: expected {expected}, got no line of numbers")


class _Hand(msgspec.Struct):
    kind: str = ""
    stiffness: float = 0.0
    damping: float = 0.0


class _Launch(msgspec.Struct):
    operator: _Hand | None = None


class _Tick(msgspec.Struct):
    seq: int
    deadline_misses: int
    elapsed: float
    position: tuple[float, ...]
    true_position: tuple[float, ...] | None = None
    hand_force: tuple[float, ...] | None = None


def read_recording(file: Path) -> tuple[tuple[float, ...], tuple[Vector, ...]]:
    """Return the times, in s since the force engaged, and the places, in m, of a recorded hand.

    If the recording begins later than that, the times count from its beginning.
    """
    hand, ticks = _Hand(), []
    with content_of(file):
        for content in mcap_file.readable(file, (TOPIC_OF[Telemetry],)):
            if isinstance(content, tuple):
                ticks.append(msgspec.json.decode(content[1], type=_Tick))
            elif content.name == mcap_file.METADATA_NAME:
                launch = msgspec.json.decode(content.metadata.get("launch", "{}"), type=_Launch)
                hand = launch.operator or hand
    start = began(iter(ticks))
    path = {time - start: place for time, place in _path(_engaged(ticks), hand)}
    if not path:
        raise ConfigError(f"{file} has no tick with an engaged force: no path to follow")
    return tuple(path), tuple(path.values())


def began(ticks: Iterator[_Tick | Telemetry]) -> float:
    """Return when recorded ticks begin, in s since the force engaged; 0: with the run, or before.

    A run begins with its first tick, the elapsed time of which is up to a period. Only the first is
    taken.
    """
    first = next(ticks, None)
    return 0.0 if first is None or first.seq == first.deadline_misses else first.elapsed


def _engaged(ticks: list[_Tick]) -> Iterator[_Tick]:
    """Yield the ticks with an engaged force; those of a device that was lost end before."""
    last = 0.0
    for tick in ticks:
        if tick.elapsed < last:
            return
        if tick.elapsed > last:
            yield tick
        last = tick.elapsed


def _path(ticks: Iterator[_Tick], hand: _Hand) -> Iterator[tuple[float, Vector]]:
    before, stretch = 0.0, None
    for tick in ticks:
        place, force = tick.true_position, tick.hand_force
        if place is None or force is None or hand.stiffness <= 0.0:
            yield tick.elapsed, tick.position
            continue
        rest = [f / hand.stiffness for f in force]
        fading = 0.0
        if stretch is not None and hand.damping > 0.0:
            fading = math.exp(-(tick.elapsed - before) * hand.stiffness / hand.damping)
        was = rest if stretch is None else stretch
        stretch = [r + fading * (z - r) for r, z in zip(rest, was, strict=True)]
        before = tick.elapsed
        yield tick.elapsed, tuple([x + z for x, z in zip(place, stretch, strict=True)])
