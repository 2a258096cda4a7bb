"""Measures of one touch: speed on the way to the wall, penetration, force, displayed stiffness."""

from dataclasses import dataclass

import numpy as np

from forcebound.results.contact import mean_stiffness
from forcebound.results.samples import Samples
from forcebound.run.results import RunResult


@dataclass(frozen=True)
class Measures:
    """Means over the samples of a touch that are behind the surface; None without contact."""

    speed: float | None = None  # m/s, between the starting line and the wall
    penetration: float | None = None  # m
    force: float | None = None  # N
    stiffness: float | None = None  # N/m, mean force over mean penetration


def measure(run: RunResult, line: float, touch_time: float) -> Measures:
    """Return the measures of a touch.

    Args:
        run: Of the touch; the first time that the hand comes from before the starting line into
            the wall counts.
        line: Distance of the starting line from the wall, in m.
        touch_time: Time from the first contact on that counts, in s.
    """
    samples = Samples(run.columns, run.document, run.events, explains=False)
    first = samples.first_contact
    if samples.touch is None or first is None:
        return Measures()
    depth, force, time = samples.depth, samples.normal_force, samples.time
    before = np.flatnonzero(depth[:first] <= -line)
    speed = None
    if before.size:
        start = int(before[-1])
        speed = float((depth[first] - depth[start]) / (time[first] - time[start]))
    counted = samples.contact & (time <= time[first] + touch_time)
    depth, force = depth[counted], force[counted]
    return Measures(speed, float(depth.mean()), float(force.mean()), mean_stiffness(force, depth))
