"""Measures of one touch: speed on the way to the wall, penetration, force, displayed stiffness."""

from dataclasses import dataclass

import numpy as np

from forcebound.results.surface import touch_of_run
from forcebound.run.results import RunResult


@dataclass(frozen=True)
class Measures:
    """Means over the samples of a touch that are behind the surface; None without contact."""

    speed: float | None = None  # m/s, between the starting line and the wall
    penetration: float | None = None  # m
    force: float | None = None  # N
    stiffness: float | None = None  # N/m, mean force over mean penetration, as in the paper, 5.3


def measure(run: RunResult, line: float, touch_time: float) -> Measures:
    """Return the measures of a touch.

    Args:
        run: Of the touch; the first time that the hand comes from before the starting line into
            the wall counts.
        line: Distance of the starting line from the wall, in m.
        touch_time: Time from the first contact on that counts, in s.
    """
    columns = run.columns
    touch = touch_of_run(columns, run.events, run.document)
    if touch is None or not (touch.depth > 0.0).any():
        return Measures()
    depth, force, time = touch.depth, touch.along(columns.applied_force), columns.time
    first = int(np.argmax(depth > 0.0))
    before = np.flatnonzero(depth[:first] <= -line)
    speed = None
    if before.size:
        start = int(before[-1])
        speed = float((depth[first] - depth[start]) / (time[first] - time[start]))
    counted = (depth > 0.0) & (time >= time[first]) & (time <= time[first] + touch_time)
    penetration, pushed = float(depth[counted].mean()), float(force[counted].mean())
    return Measures(speed, penetration, pushed, pushed / penetration)
