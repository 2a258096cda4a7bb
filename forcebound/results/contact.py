"""Measures of a contact: stiffness, rate-hardness, bounces, settling, final speed.

Pure functions of arrays of shape ``(n,)``: time, in s since the force engaged; the applied force
along the surface's normal, in N; the depth of the reading behind the surface, in m. *In contact* is
a sample with a depth above zero. A measure that a run does not have is ``None``, never NaN.
"""

from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from forcebound.results.surface import Floats, Mask

STEADY_WINDOW = (2.0, 5.0)  # s after engagement; paper, section 4.2
STEADY_SHARE = 0.4  # last part of a run that ends before the steady window does
RATE_WINDOW = 0.010  # s after first contact, for "initial" in Eq. 34; long enough to average the
#                      encoder's steps, short against the 50 ms in which a hand is slowed down
RATE_SAMPLES = 3  # fewest from which a slope is taken, also if they take longer
BOUNCE_EXCURSION = 1e-4  # m, hysteresis of a turning point: three steps of a 0.03 mm encoder
REST_WINDOW = 0.5  # s at the end of the run
REST_SPEED = 1e-3  # m/s, RMS; a hand slower than this over the rest window is at rest
MORE = 1.005  # of the stiffness: more than all of it
SETTLING_BAND = 0.05  # of the final penetration; at least BOUNCE_EXCURSION


def rms(values: Floats) -> float:
    """Return the root of the mean square of some values."""
    return float(np.sqrt(np.mean(values**2)))


def steady_window(time: Floats) -> Mask:
    """Return which samples count as steady: those from 2 to 5 s after the force engaged.

    Of a run that ends earlier, the samples of its last 40 %. ``time`` is in s since then.
    """
    start, end = STEADY_WINDOW
    if time.size and time[-1] < end:
        start, end = time[-1] * (1.0 - STEADY_SHARE), time[-1]
    return np.asarray((time >= start) & (time <= end))


def at_end(time: Floats) -> Mask:
    """Return which samples lie in the last 0.5 s of a run; ``time`` is in s."""
    return np.asarray(time >= time[-1:] - REST_WINDOW)


def displayed_stiffness(time: Floats, force: Floats, depth: Floats) -> float | None:
    r"""Return the stiffness that the hand feels in the steady state, in N/m.

    .. math:: S_D = \operatorname{mean} \frac{F_d}{x_p}

    over the samples in contact in the :func:`steady_window`.

    None without contact in the window. Means little for a hand that oscillates: a shallow sample
    with a late force weighs as much as a deep one.

    Source: the enhanced force bounding paper, 2017, Eq. 33 and section 4.2.
    """
    steady = steady_window(time) & (depth > 0.0)
    return float(np.mean(force[steady] / depth[steady])) if steady.any() else None


def says_something(felt: float, asked: float, is_at_rest: bool | None) -> bool:
    """Return whether a mean stiffness does, in N/m: 0 to all of it by a hand that moves.

    The mean of a hand to and fro says nothing. ``is_at_rest``: None if it is not known.
    """
    return 0.0 <= felt <= MORE * asked or is_at_rest is not False


def mean_stiffness(force: Floats, depth: Floats) -> float | None:
    """Return mean force over mean depth of the samples in contact, in N/m; None without any.

    Not the mean of their ratios, as :func:`displayed_stiffness` is: of a hand that moves, a shallow
    sample weighs there as much as a deep one. So palpation and touches of a study have this one.

    Source: the enhanced force bounding paper, 2017, section 5.3.
    """
    contact = depth > 0.0
    return float(np.mean(force[contact]) / np.mean(depth[contact])) if contact.any() else None


def rate_hardness(time: Floats, force: Floats, depth: Floats) -> float | None:
    r"""Return the rate-hardness of the first contact over 10 ms, in N/m.

    .. math:: H_R = \frac{\text{initial rate of change of force}}{\text{initial velocity of
              penetration}}

    Both are least-squares slopes against time over the first 10 ms of the first contact, or its
    first three samples where the rate is low. The paper does not state its window. A wall whose
    answer comes later than that has a rate-hardness of 0: at first there is nothing to feel.

    None without a contact of three samples, or if the hand does not move inwards in it.

    Source: Lawrence et al., Rate-hardness: a new performance metric for haptic interfaces, IEEE
    Transactions on Robotics and Automation 16(4), 2000; the paper, 2017, Eq. 34.
    """
    window = _first_window(time, depth)
    if window is None:
        return None
    velocity = _slope(time[window], depth[window])
    return _slope(time[window], force[window]) / velocity if velocity > 0.0 else None


def extended_rate_hardness(time: Floats, force: Floats, depth: Floats) -> float | None:
    r"""Return the extended rate-hardness of the first contact over 10 ms, in N/m.

    .. math:: H_{ER} = \frac{\text{largest rate of change of force}}{\text{initial velocity of
              penetration}}

    As :func:`rate_hardness`, with the steepest 10 ms between the last sample before contact and the
    deepest point of the first contact in place of the first 10 ms. So it also shows a wall that
    answers late, and the jump of a damper at the surface. The window is ours: we
    know the definition of the source by citation only.

    None where :func:`rate_hardness` is.

    Source: Han and Choi, Extended rate-hardness: a measure for perceived hardness, EuroHaptics
    2010, LNCS 6191.
    """
    window = _first_window(time, depth)
    if window is None:
        return None
    velocity = _slope(time[window], depth[window])
    if velocity <= 0.0:
        return None
    length = window.stop - window.start
    leaves = np.flatnonzero(depth[window.start :] <= 0.0)
    end = window.start + int(leaves[0]) if leaves.size else depth.size
    end = max(window.start + int(np.argmax(depth[window.start : end])) + 1, window.stop)
    searched = slice(max(window.start - 1, 0), end)
    times = sliding_window_view(time[searched], length)
    centred = times - times.mean(axis=1, keepdims=True)
    rates = np.sum(centred * sliding_window_view(force[searched], length), axis=1)
    return float((rates / np.sum(centred**2, axis=1)).max()) / velocity


def _first_window(time: Floats, depth: Floats) -> slice | None:
    """Return the first 10 ms of the first contact; None without three samples."""
    contact = depth > 0.0
    if not contact.any():
        return None
    first = int(np.argmax(contact))
    leaves = np.flatnonzero(~contact[first:])
    length = int(leaves[0]) if leaves.size else contact.size - first
    if length < RATE_SAMPLES:
        return None
    # Half a nanosecond: stamps are whole nanoseconds, and the sample at 10 ms exactly belongs in.
    wanted = int(np.searchsorted(time[first:], time[first] + RATE_WINDOW + 5e-10))
    return slice(first, first + min(length, max(wanted, RATE_SAMPLES)))


def initial_rate_hardness(force: Floats, depth: Floats) -> float | None:
    r"""Return the rate-hardness of the first contact as in the paper's Table 1, in N/m.

    .. math:: H_R = \frac{F(c) - F(c-1)}{q(c) - q(c-1)}

    over one sample, the one that enters the wall: c is the first sample behind the surface.
    :func:`rate_hardness` covers 10 ms and so what the hand feels, also behind a delay; this measure
    shows the law alone, before the hand can react. The paper states no window; its numbers need
    this one. A saturated bound grows by 2B times the *whole* move of the sample that enters the
    wall, and by friction over that move: ``sqrt(4 B^2 + 4 B f_c / |q(c) - q(c-1)|)`` is the paper's
    1.29 and 2.16 N/mm for moves of three steps of its encoder and of one. A wall that is not
    bounded yet shows less than its own stiffness by the part of that move that lay before the
    surface, as the 6.05 and 8.02 of 10 N/mm in the paper's table.

    None without a contact that begins in the run.

    Source: Lawrence et al. 2000; the paper, 2017, Eq. 34.
    """
    contact = depth > 0.0
    first = int(np.argmax(contact))
    if first == 0:
        return None
    return float((force[first] - force[first - 1]) / (depth[first] - depth[first - 1]))


def _slope(time: Floats, values: Floats) -> float:
    centred = time - time.mean()
    return float(centred @ values / (centred @ centred))


def count_bounces(position: Floats, excursion: float = BOUNCE_EXCURSION) -> int:
    """Return the number of contact bounces: turning points of a motion that begins inwards.

    A turning point counts when the position, in m from the first contact on, has come back from it
    by more than ``excursion``, so the steps of an encoder do not count.
    """
    bounces = 0
    direction = 1.0
    extreme = -np.inf  # furthest point in this direction so far
    moves = np.flatnonzero(np.diff(position)) + 1  # a reading often stays as it is
    for value in position[np.concatenate(([0], moves))].tolist() if position.size else ():
        travelled = direction * value
        if travelled > extreme:
            extreme = travelled
        elif extreme - travelled > excursion:
            bounces += 1
            direction = -direction
            extreme = -travelled
    return bounces


def final_speed(time: Floats, true_position: Floats) -> float | None:
    """Return the RMS speed over the last 0.5 s, in m/s, of true positions, in m, ``(n, axes)``.

    A reading would not do: one 0.03 mm step in a 1 ms sample is 30 mm/s. None without ground truth
    or with fewer than two samples.
    """
    last = at_end(time)
    if np.count_nonzero(last) < 2:
        return None
    velocity = np.diff(true_position[last], axis=0) / np.diff(time[last])[:, np.newaxis]
    speed = float(np.sqrt(np.mean(np.sum(velocity**2, axis=1))))
    return speed if np.isfinite(speed) else None


@dataclass(frozen=True)
class Settling:
    """How a hand comes to its final penetration."""

    time: float  # s from first contact until the penetration stays in the band about its final one
    overshoot: float  # deepest penetration over the final one, less 1


def settling(time: Floats, depth: Floats) -> Settling | None:
    """Return settling time and overshoot of the penetration, as of a step response.

    The final penetration is the mean over the last 0.5 s; the band is 5 % of it, and at least
    0.1 mm, three steps of a 0.03 mm encoder.

    None without contact, or if the penetration leaves the band, or the wall, in the last 0.5 s.

    Source: the usual 5 % criterion; Ogata, Modern control engineering, 5th edition, 2010, 5.3.
    """
    contact = np.flatnonzero(depth > 0.0)
    if not contact.size:
        return None
    final = depth[at_end(time)]
    level = float(final.mean())
    band = max(SETTLING_BAND * level, BOUNCE_EXCURSION)
    if level <= 0.0 or np.abs(final - level).max() > band:
        return None
    first = contact[0]
    outside = np.flatnonzero(np.abs(depth[first:] - level) > band)
    settled = first + (int(outside[-1]) + 1 if outside.size else 0)
    return Settling(
        float(time[settled] - time[first]), max(float(depth[first:].max()) / level - 1.0, 0.0)
    )


def limit_cycle_amplitude(time: Floats, position: Floats) -> float | None:
    """Return half of the range of the position in the last 0.5 s, in m: 0 for a hand at rest.

    The position is the true one where it is known, since a reading at rest may chatter between two
    steps. Of a hand whose target moves, this is the amplitude of that motion. None with fewer than
    two samples.
    """
    last = at_end(time)
    return 0.5 * float(np.ptp(position[last])) if np.count_nonzero(last) > 1 else None
