"""Hands whose path is a list of points, a CSV table, or the hand in a recording.

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
from functools import cached_property
from itertools import accumulate, pairwise
from pathlib import Path
from typing import Annotated

import msgspec

from forcebound import mcap_file
from forcebound.errors import ConfigError
from forcebound.files import RECORDING_SUFFIX, content_of, read_rows
from forcebound.haptics.hands.hands import PressingButtons, Segment, SoftGrip, segment
from forcebound.messages.packets import MAX_AXES, TOPIC_OF, Telemetry, Vector
from forcebound.messages.topology import HAND, node_name
from forcebound.quantities import POSITIVE, Length, Speed


@dataclass(frozen=True)
class FollowingHand(SoftGrip, PressingButtons):
    """Mass, spring and damper whose target goes from point to point in straight lines.

    For a path with times, or in a file, see ``trajectory``.

    Attributes:
        points: Of the path, in order: a list of one number for each axis.
        speed: Along the path.
        repeat: Whether it goes from the last point straight to the first, and on; else it stays.
    """

    points: tuple[tuple[Length, ...], ...]
    speed: Annotated[Speed, POSITIVE] = 0.05
    repeat: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.points:
            raise ConfigError("a hand that follows a path needs points, got none", field="points")
        for number, point in enumerate(self.points, start=1):
            if not 1 <= len(point) <= MAX_AXES:
                expected = f"points: point {number} must have 1 to {MAX_AXES} numbers, one per axis"
                raise ConfigError(f"{expected}, got {len(point)}", field="points")

    @cached_property
    def _segments(self) -> list[Segment]:
        axes = max(map(len, self.points))
        points = [point + (0.0,) * (axes - len(point)) for point in self.points]
        last = points[0] if self.repeat else points[-1]
        return [segment(one, other) for one, other in pairwise((*points, last))]

    @cached_property
    def _ends(self) -> list[float]:
        """Of the segments, in m along the path."""
        return list(accumulate(one.length for one in self._segments))

    def target(self, elapsed: float) -> Vector:
        travel, length = self.speed * max(elapsed, 0.0), self._ends[-1]
        if self.repeat and length > 0.0:
            travel %= length
        number = min(bisect_right(self._ends, travel), len(self._segments) - 1)
        segment = self._segments[number]
        return segment.at(travel - (self._ends[number] - segment.length))


@dataclass(frozen=True)
class TrajectoryHand(SoftGrip):
    """Mass, spring and damper whose target follows a CSV file, or the hand in a recording.

    A CSV file has a header line; its first column is the time in s, strictly increasing, the others
    (1 to 8) are the target's position in m, one per axis. Between two lines the target moves in a
    straight line; before the first and after the last it rests. Of a recording (``.mcap``), it is
    where the hand's target was, as far as that is known, else where the device was
    (docs/recordings.md).

    Attributes:
        file: CSV file, or recording (``.mcap``).
        hand: The name of the hand in a recording of several.
    """

    file: Path
    hand: str = ""
    _path: dict[float, Vector] = field(init=False, repr=False, compare=False)
    _times: tuple[float, ...] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        file = Path(self.file)
        try:
            is_recording = file.suffix == RECORDING_SUFFIX
            path = read_recording(file, self.hand) if is_recording else _read_csv(file)
        except ConfigError as error:
            raise ConfigError(str(error), field="file") from None
        object.__setattr__(self, "_path", path)
        object.__setattr__(self, "_times", tuple(path))

    def target(self, elapsed: float) -> Vector:
        times, path = self._times, self._path
        after = bisect_right(times, elapsed)
        if after in (0, len(times)):
            return path[times[after and -1]]
        before = times[after - 1]
        share = (elapsed - before) / (times[after] - before)
        ends = zip(path[before], path[times[after]], strict=True)
        return tuple([a + share * (b - a) for a, b in ends])


def _read_csv(file: Path) -> dict[float, Vector]:
    """The path in a CSV file: places, in m, by their time, in s."""
    rows = read_rows(file, "the trajectory")
    _, head = next(rows, ("", []))
    expected = f"time in s, then 1 to {MAX_AXES} positions in m, as many columns as the header line"
    path: dict[float, Vector] = {}
    last = -math.inf
    for place, row in rows:
        try:
            time, *position = map(float, row)
        except ValueError:
            time, position = math.nan, []
        is_sound = 1 <= len(position) <= MAX_AXES and len(row) == len(head)
        if not is_sound or not all(map(math.isfinite, (time, *position))):
            raise ConfigError(f"{place}: expected {expected}, got {reprlib.repr(','.join(row))}")
        if time <= last:
            raise ConfigError(f"{place}: time must increase: {time} after {last}")
        path[time] = tuple(position)
        last = time
    if not path:
        raise ConfigError(f"{file}: expected {expected}, got no line of numbers")
    return path


class _Hand(msgspec.Struct):
    kind: str = ""
    stiffness: float = 0.0
    damping: float = 0.0


class _Launch(msgspec.Struct):
    operator: _Hand | None = None
    hands: "dict[str, _Launch]" = {}


class _Tick(msgspec.Struct):
    seq: int
    deadline_misses: int
    elapsed: float
    position: tuple[float, ...]
    true_position: tuple[float, ...] | None = None
    hand_force: tuple[float, ...] | None = None


def read_recording(file: Path, name: str = "") -> dict[float, Vector]:
    """Return the places of a recorded hand, in m, by the time since the force engaged, in s.

    ``name`` is that of the hand, of several. If the recording begins later than that, the times
    count from its beginning.
    """
    name = name or HAND
    hand, ticks = _Hand(), []
    with content_of(file):
        for content in mcap_file.readable(file, (node_name(name, TOPIC_OF[Telemetry]),)):
            if isinstance(content, tuple):
                ticks.append(msgspec.json.decode(content[1], type=_Tick))
            elif content.name == mcap_file.METADATA_NAME:
                launch = msgspec.json.decode(content.metadata.get("launch", "{}"), type=_Launch)
                hand = launch.hands.get(name, launch).operator or hand
                if launch.hands and name not in launch.hands:
                    raise ConfigError(
                        f"{file} has no hand {name!r}; it has {', '.join(launch.hands)}"
                    )
    start = began(iter(ticks))
    path = {time - start: place for time, place in _path(_engaged(ticks), hand)}
    if not path:
        raise ConfigError(f"{file} has no tick with an engaged force: no path to follow")
    return path


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
