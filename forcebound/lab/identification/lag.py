r"""The lag of an amplifier, seen by the encoder.

While an axis passes along its range, its force jumps up and down. The ripple of its speed comes
after the jumps: by the lag. With a first-order lag :math:`\tau` the force is
:math:`F_\tau`, and the motion

.. math::

    x = c_0 + c_1 t + c_2 t^2 + c_3 t^3 - \frac{1}{I} \iint F_\tau - \frac{b}{I} \int x ,

where the polynomial takes all that is slow: how it began, friction, weight, cogging. The lag is the
:math:`\tau` of the least squares. A stroke turns nowhere, so friction neither changes its sign nor
yields.

Less than some hundredths of a period cannot be distinguished from no lag: an estimate may then be
below 0, as of a force that comes too early.
"""

from collections.abc import Sequence

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.optimize import least_squares
from scipy.signal import lfilter

from forcebound.lab.identification.estimators import UNMODELLED, Bounded, Floats, mean_of
from forcebound.lab.identification.experiments import Pass, impulse_of

FEWEST = 40  # ticks of a stroke
FIRST_GUESS, LARGEST = 1e-4, 0.02  # s
STEP = 2e-5  # s, in which the lagging force is integrated
LATE = 2.0  # periods between two readings; a stroke with more is not used
WIDEST = 1e-4, 0.1  # s, and share of the lag: a wider bound says nothing of the amplifier


def lag_of(strokes: Sequence[Pass], damping: float) -> Bounded | None:
    """Return the lag of the motor of an axis, in s; None if it cannot be found.

    That is so where late ticks leave too few strokes, or the strokes differ too much.

    Args:
        strokes: Passes of one axis with a force that jumps.
        damping: Of the axis, in N s/m (N m s).
    """
    found = [lag for one in strokes if (lag := _lag_of_stroke(one, damping)) is not None]
    if len(found) < 4:
        return None
    mean, error = mean_of(np.array(found))
    error += UNMODELLED * abs(mean)
    if error > WIDEST[0] + WIDEST[1] * abs(mean):
        return None
    return Bounded(mean, mean - error, mean + error)


def _lag_of_stroke(stroke: Pass, damping: float) -> float | None:
    trace, axis = stroke.trace, stroke.axis
    elapsed = trace.read - trace.read[0]
    ticks = np.flatnonzero([stroke.profile.is_even(t) for t in elapsed.tolist()])
    if ticks.size < FEWEST or trace.late[: ticks[-1]].any():
        return None
    gaps = np.diff(trace.read[: ticks[-1]])
    if gaps.max() > LATE * np.median(gaps):
        return None
    time, place = trace.read[ticks], trace.readings[ticks, axis]
    slow = np.vander((time - time[0]) / (time[-1] - time[0]), 4)
    lost = damping * cumulative_trapezoid(place - place[0], time, initial=0.0)
    grid = np.arange(trace.effect[0] - LARGEST, time[-1] + STEP, STEP)
    impulse = impulse_of(stroke)

    def misses(parameters: Floats) -> Floats:
        lag = float(parameters[0])
        # Twice the integral over time of the lagging force; below 0 it comes so much earlier.
        lagging = np.interp(grid, trace.effect + min(lag, 0.0), impulse)
        if lag > 0.0:  # the bilinear transform of 1 / (1 + lag s)
            pole = 2.0 * lag / STEP
            lagging = lfilter([1.0, 1.0], [1.0 + pole, 1.0 - pole], lagging)
        pushed = np.interp(time, grid, cumulative_trapezoid(lagging, grid, initial=0.0))
        design = np.column_stack([slow, pushed + lost])
        design /= np.abs(design).max(axis=0)
        return np.asarray(place - design @ np.linalg.lstsq(design, place, rcond=None)[0])

    scale = float(np.abs(misses(np.array([FIRST_GUESS]))).max()) or 1.0
    fit = least_squares(
        lambda x: misses(FIRST_GUESS * x) / scale, [1.0], x_scale=1.0,
        bounds=(-LARGEST / FIRST_GUESS, LARGEST / FIRST_GUESS), diff_step=1e-2,
    )  # fmt: skip
    return FIRST_GUESS * float(fit.x[0])
