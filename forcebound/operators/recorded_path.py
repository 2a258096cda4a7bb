"""A hand's path in a recording: its target where that is known, else the position of the device.

Spring and damper of a simulated hand, K and b, gave the recorded hand force ``F = K z + b dz/dt``
for ``z``, the target's distance from the true position. So between two ticks, with F even,

    z(t + dt) = F/K + (z(t) - F/K) exp(-dt K/b)

and the target is position plus z. Of a person on hardware only the position is known. A hand that
follows it is a spring and a damper behind that path, not the person: in front of another wall or
law it shows how they would answer somebody who pulls towards where that person was.
"""

import math
from collections.abc import Iterator
from pathlib import Path

import msgspec

from forcebound import mcap_file
from forcebound.errors import ConfigError
from forcebound.files import content_of
from forcebound.messages.packets import TOPIC_OF, Telemetry, Vector


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

    Raises:
        ConfigError: If the file cannot be read, or holds no tick with an engaged force.
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
