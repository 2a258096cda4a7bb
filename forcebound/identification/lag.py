r"""The lag of an amplifier, told by the encoder.

While an axis passes along its range, its force jumps up and down. The ripple of its speed comes
after the jumps: by the lag. With a first-order lag :math:`\tau` the force is
:math:`F_\tau`, and the motion

.. math::

    x = c_0 + c_1 t + c_2 t^2 + c_3 t^3 - \frac{1}{I} \iint F_\tau - \frac{b}{I} \int x ,

where the polynomial takes all that is slow: how it began, friction, weight, cogging. The lag is the
:math:`\tau` of the least squares, found by Gauss and Newton's method. A stroke turns nowhere, so
friction neither changes its sign nor yields.

Less than some hundredths of a period cannot be told from no lag: an estimate may then be below 0,
as a force that comes too early.
"""

import math
from collections.abc import Sequence

import numpy as np

from forcebound.identification.estimators import UNMODELLED, Bounded, Floats, student
from forcebound.identification.experiments import Pass

FEWEST = 40  # ticks of a stroke
FIRST_GUESS, CHANGE, LARGEST = 1e-4, 1e-6, 0.02  # s
LATE = 2.0  # periods between two readings; a stroke with more is not used
WIDEST = 1e-4, 0.1  # s, and share of the lag: a wider bound says nothing of the amplifier
ROUNDS, CONVERGED = 10, 1e-8  # s


def lag_of(strokes: Sequence[Pass], damping: float) -> Bounded | None:
    """Return the lag of the motor of an axis, in s; None if it cannot be told.

    That is so where late ticks leave too few strokes, or the strokes differ too much.

    Args:
        strokes: Passes of one axis with a force that jumps.
        damping: Of the axis, in N s/m (N m s).
    """
    found = np.array([lag for one in strokes if (lag := _lag_of_stroke(one, damping)) is not None])
    if found.size < 4:
        return None
    mean = float(found.mean())
    error = student(found.size - 1) * float(found.std(ddof=1)) / math.sqrt(found.size)
    error += UNMODELLED * abs(mean)
    if error > WIDEST[0] + WIDEST[1] * abs(mean):
        return None
    return Bounded(mean, mean - error, mean + error)


def _lag_of_stroke(stroke: Pass, damping: float) -> float | None:
    trace, axis = stroke.trace, stroke.axis
    elapsed = trace.read - trace.read[0]
    ticks = np.flatnonzero([stroke.way.is_even(t) for t in elapsed.tolist()])
    if ticks.size < FEWEST or trace.late[: ticks[-1]].any():
        return None
    gaps = np.diff(trace.read[: ticks[-1]])
    if gaps.max() > LATE * np.median(gaps):
        return None
    time, place = trace.read[ticks], trace.readings[ticks, axis]
    forces = trace.forces[:, axis]
    since = (time - time[0]) / (time[-1] - time[0])
    way = place - place[0]
    lost = damping * np.concatenate([[0.0], np.cumsum(0.5 * (way[1:] + way[:-1]) * np.diff(time))])
    slow = np.stack([np.ones_like(since), since, since**2, since**3], axis=1)

    def pushed(lag: float) -> Floats:
        return _twice_integrated(trace.effect, forces, time, lag)

    lag = FIRST_GUESS
    for _ in range(ROUNDS):
        now = pushed(lag)
        design = np.column_stack([slow, now + lost])
        slope = (pushed(lag + CHANGE) - now) / CHANGE
        both = np.column_stack([design, slope])
        found = np.linalg.lstsq(both / np.abs(both).max(axis=0), place, rcond=None)[0]
        found /= np.abs(both).max(axis=0)
        step = float(found[-1] / found[-2])
        lag = min(max(lag + step, -LARGEST), LARGEST)
        if abs(step) < CONVERGED:
            break
    return lag


def _twice_integrated(effect: Floats, forces: Floats, time: Floats, lag: float) -> Floats:
    """Return twice the integral over time of forces that follow with a lag, in N s^2.

    Args:
        effect: When each force begins, in s.
        forces: In N.
        time: At which it is wanted, in s, after the first effect.
        lag: First order, in s; below 0: the forces come so much earlier.
    """
    if lag < 0.0:
        effect = effect + lag
    edges = np.union1d(effect, time)
    edges = edges[edges >= effect[0]]
    force = forces[np.searchsorted(effect, edges[:-1], side="right") - 1]
    lasting = np.diff(edges)
    once, twice = force * lasting, 0.5 * force * lasting**2
    if lag > 0.0:
        left = -np.expm1(-lasting / lag)
        lack = _lacks(force, left)
        once += lack * lag * left
        twice += lack * lag * (lasting - lag * left)
    speed = np.concatenate([[0.0], np.cumsum(once)])
    total = np.concatenate([[0.0], np.cumsum(speed[:-1] * lasting + twice)])
    return np.asarray(total[np.searchsorted(edges, time)])


def _lacks(force: Floats, left: Floats) -> Floats:
    """Return by how much the lagging force differs from ``force`` when each interval begins."""
    lacks, lagging = [], float(force[0])
    for told, share in zip(force.tolist(), left.tolist(), strict=True):
        lacks.append(lagging - told)
        lagging += share * (told - lagging)
    return np.array(lacks)
