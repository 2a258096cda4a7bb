"""Parts of passes: the mean force, speed and acceleration of a motion between two places."""

from collections.abc import Sequence

import numpy as np

from forcebound.identification.estimators import Floats, Point
from forcebound.identification.experiments import Pass

NEAR = 8  # samples to either side, of which a speed is taken
FEWEST = 8  # samples of a part


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
            a, b = (_means(one, edges[part], edges[part + 1]) for one in (there, back))
            if a is not None and b is not None:
                speed, loss, gained = (0.5 * (a - b)).tolist()
                _, load, load_gained = (0.5 * (a + b)).tolist()
                points.append(Point((there.pose, part), speed, loss, load, gained, load_gained))
    return points


def _means(one: Pass, low: float, high: float) -> "Floats | None":
    """Mean speed, force that moves the axis, and acceleration between two places.

    All are positive with positive motion. None: there are too few samples, or a late one.
    """
    trace, q = one.trace, one.trace.readings[:, one.axis]
    inside = np.flatnonzero((q >= low) & (q <= high))
    if inside.size < FEWEST or trace.late[inside[0] : inside[-1]].any():
        return None
    ends = [int(inside[0]), int(inside[-1])]
    impulse = np.concatenate(
        [[0.0], np.cumsum(trace.forces[:-1, one.axis] * np.diff(trace.effect))]
    )
    given = np.interp(trace.read[ends], trace.effect, impulse)
    speeds = [_speed_at(trace.read, q, end) for end in ends]
    changes = [q[ends[1]] - q[ends[0]], given[0] - given[1], speeds[1] - speeds[0]]
    return np.asarray(np.array(changes) / (trace.read[ends[1]] - trace.read[ends[0]]))


def _speed_at(time: Floats, q: Floats, index: int) -> float:
    part = slice(max(0, index - NEAR), index + NEAR + 1)
    return float(np.polyfit(time[part] - time[index], q[part], 1)[0])
