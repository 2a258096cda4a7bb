"""Parts of passes: the mean force, speed and acceleration of a motion between two places."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from forcebound.identification.estimators import Floats, Point
from forcebound.identification.experiments import Pass

NEAR = 8  # samples to either side, of which a speed is taken
FEWEST = 8  # samples of a part


@dataclass(frozen=True)
class Window:
    """One pass between two places.

    Attributes:
        speed: With its sign, in m/s (rad/s).
        push: Mean force that moves the axis, in N (N m), positive with positive motion.
        gained: Mean acceleration, in m/s^2 (rad/s^2).
    """

    speed: float
    push: float
    gained: float


def window_of(one: Pass, low: float, high: float) -> Window | None:
    """Return the part of a pass between two places, in m (rad); None if it has too few."""
    trace, axis = one.trace, one.axis
    q = trace.readings[:, axis]
    inside = np.flatnonzero((q >= low) & (q <= high))
    if inside.size < FEWEST:
        return None
    first, last = int(inside[0]), int(inside[-1])
    if trace.late[first:last].any():
        return None
    begin, end = trace.read[first], trace.read[last]
    duration = end - begin
    impulse = _impulse(trace.effect, trace.forces[:, axis], begin, end)
    gained = _speed_at(trace.read, q, last) - _speed_at(trace.read, q, first)
    return Window(float(q[last] - q[first]) / duration, -impulse / duration, gained / duration)


def _impulse(effect: Floats, forces: Floats, begin: float, end: float) -> float:
    total = np.concatenate([[0.0], np.cumsum(forces[:-1] * np.diff(effect))])
    at_begin, at_end = np.interp([begin, end], effect, total)
    return float(at_end - at_begin)


def _speed_at(time: Floats, q: Floats, index: int) -> float:
    part = slice(max(0, index - NEAR), index + NEAR + 1)
    t = time[part] - time[part].mean()
    return float((t * q[part]).sum() / (t * t).sum())


def points_of(passes: Sequence[Pass], low: float, high: float, parts: int) -> list[Point]:
    """Return a point for each pair of passes, there and back, and each part of the range.

    Args:
        passes: Of one axis, each followed by its way back.
        low: Least place, in m (rad).
        high: Largest place.
        parts: Of the range.
    """
    edges = np.linspace(low, high, parts + 1)
    points = []
    for there, back in zip(passes[::2], passes[1::2], strict=True):
        for part in range(parts):
            a = window_of(there, edges[part], edges[part + 1])
            b = window_of(back, edges[part], edges[part + 1])
            if a is None or b is None:
                continue
            points.append(
                Point(
                    (there.pose, part),
                    0.5 * (a.speed - b.speed),
                    0.5 * (a.push - b.push),
                    0.5 * (a.push + b.push),
                    0.5 * (a.gained - b.gained),
                    0.5 * (a.gained + b.gained),
                )
            )
    return points
