r"""The certified law: a bound on the physical energy, for any commanded force.

It relies on the stated b, f_c, the resolution Δ = 2r of the reading (\|x(t_n) - q(n)\| <= r), the
measured sample interval dt, and a device that by itself drops a force older than T_max. The state
is the ledger A. With e = x - q, y_i the play operator of axis i, P_i its path and D_i =
\|x_i - y_i\|, it keeps between samples the invariant

    loss + work at t_n  >=  A + F(n-1)·e(n) + f_c (‖P(n) + D(n)‖ - ‖P(n)‖)

whose last term, for one axis, is f_c \|x(n) - y(n)\|.

1. *In a hold.* By Cauchy-Schwarz a displacement d within T_max costs at least B d² + f_c\|d\|, so
   the energy in it is at least G + B d² + f_c\|d\| + F·d >= G - (\|F\| - f_c)₊²/(4B), where
   G = A - r Σ_i\|F_i(n-1)\|.
2. *Readings for positions.* Summation by parts turns Σ F·Δx into Σ F·Δq + F(n-1)·e(n) -
   Σ ΔF(k)·e(k): a price r Σ_i\|ΔF_i\| for a change of force, not r\|F\| for every sample.
3. *Friction.* When y_i moves by m, it moves towards x_i: D_i grows by at most (path of x_i) - m. So
   each x_i has gone at least P_i + D_i - r, and by Minkowski's inequality the path ∫\|v\| dt is at
   least ‖P + D‖ - r √axes: the growth of f_c ‖P‖ may be credited, f_c r √axes is paid at the start.
4. *Damping.* In any window of readings from t_j to t_n the way is at least \|Δ\| with Δ_i =
   max(\|q_i(n) - q_i(j)\| - 2r, 0), so by Cauchy-Schwarz ∫\|v\|² dt >= \|Δ\|²/(t_n - t_j) in it. If
   V_j is a lower bound up to t_j, then V_j + \|Δ\|²/(t_n - t_j) is one up to t_n, and so is the
   largest of several such: from the last sample and from two anchors, which move on every eight
   samples (:func:`~forcebound.bounding.sample.squared_velocity_integral`). The ledger gets b times
   its increase. One sample alone loses 2r each time: a hand at 35 mm/s moves 0.035 mm a
   millisecond, and with 2r = 0.03 mm a fiftieth of its loss is left.
5. *In deficit* \|F\| <= f_c: friction dissipates all that such a force could give.
6. *The memoryless variant* only discards energy, so its A is a lower bound as well.

Note: after an overrun (dt > T_max) the play operator must *start again* at the
reading, for the price f_c r √axes of a start. Letting it follow the reading without credit is not
enough. The friction of the cut hold is part of step 1 already, but \|x - y\| may have grown by 2r
in it, and step 3 would credit that path a second time: f_c Δ for each overrun
(``tests/test_certified_law.py`` walks the path on which this leaks). The anchors start again too,
for no price: the damping's loss in the cut hold is accounted for in step 1, and no window may reach
across it. The factor √axes is the length of a vector of n errors of at most r.
"""

import math

from forcebound.bounding.law import BoundingLaw, State
from forcebound.bounding.sample import DeviceConstants, Sample, Write

FORGETTING = 0.020  # s, in which the memoryless law forgets 62 % of a surplus: the longest for
#                     which contacts turn no oftener than with the paper's law (docs/theory.md, 3)


def start(device: DeviceConstants) -> State:
    r"""Return the ledger at the first reading, in J: :math:`A = -f_c r \sqrt{axes}`."""
    return -device.friction * device.half_resolution * math.sqrt(device.axes)


def limit(state: State, sample: Sample, device: DeviceConstants) -> tuple[State, float, float]:
    r"""Bring the ledger up to this sample.

    .. math::

        A &\mathrel{+}= b\,(V' - V) + f_c |y' - y| + F(n-1) \Delta q \\
        F_{max} &= f_c + 2 \sqrt{B \max(A - r |F(n-1)|, 0)}

    with :math:`B = b / T_{max}` and V the least viscous path. If :math:`dt > T_{max}` the hold
    was cut at an unknown position:

    .. math:: A \mathrel{-}= \mathrm{loss}_{cut} + r |F(n-1)| + f_c r \sqrt{axes}

    and from there (:func:`cut_loss`) F(n-1) = 0, y' = q(n) and V begins anew.
    """
    r, friction = device.half_resolution, device.friction
    if sample.dt > device.hold_limit:
        ledger = state - cut_loss(sample, device)
        ledger -= r * sample.held_sum + friction * r * math.sqrt(device.axes)
        surplus = max(ledger, 0.0)
    else:
        ledger = (
            state
            + device.damping * sample.squared_velocity_integral
            + friction * sample.path
            + sample.work
        )
        surplus = max(ledger - r * sample.held_sum, 0.0)
    capability = device.damping / device.hold_limit
    return ledger, friction + 2.0 * math.sqrt(capability * surplus), 0.0


def cut_loss(sample: Sample, device: DeviceConstants) -> float:
    r"""Return the most energy that a cut hold and the free motion after it can have cost, in J.

    The device dropped the force F at an unknown time :math:`s \le T_{max}` after an unknown
    displacement d, and moved on freely to the end of the period. Two bounds hold; the smaller one
    counts. With the friction of the hold alone (step 1 of the proof):

    .. math:: (|F| - f_c)_+^2 / (4B)

    And with the way that is known, :math:`\Delta x`. By Cauchy-Schwarz the two parts lose
    :math:`b |d|^2 / s + b |\Delta x - d|^2 / (dt - s)`; with the work :math:`F d` and the worst d
    this is, for :math:`\bar s = s / dt`,

    .. math:: \bar s (1 - \bar s) |F|^2 dt / (4b) - \bar s\, F \Delta x - b |\Delta x|^2 / dt

    which is concave in s, so the worst s is known too. Readings may stand for positions: the error
    of :math:`\bar s F \Delta q` and the F·e(n-1) of the invariant are together
    :math:`F ((1 - \bar s) e(n-1) + \bar s e(n)) \ge -r \sum_i |F_i|`, the price paid anyway.
    A hand at rest that is released for a moment thus costs a quarter of the first bound.

    :math:`|\Delta x|` is at least :math:`(|\Delta q| - 2r\sqrt{axes})_+`.

    Args:
        sample: A sample whose dt is more than the hold limit.
        device: Constants of the device.
    """
    damping, held, work, dt = device.damping, sample.held, sample.work, sample.dt
    clear = max(sample.distance - 2.0 * device.half_resolution * math.sqrt(device.axes), 0.0)
    excess = max(held - device.friction, 0.0)
    blind = excess * excess * device.hold_limit / (4.0 * damping)
    square = max(held * held, 1e-30)  # N²; without a force the share does not matter
    share = 0.5 - 2.0 * damping * work / (square * dt)
    share = min(max(share, 0.0), device.hold_limit / dt)
    seeing = share * (1.0 - share) * held * held * dt / (4.0 * damping)
    seeing -= share * work + damping * clear * clear / dt
    return min(blind, seeing)


def settle(state: State, write: Write, device: DeviceConstants) -> State:
    r"""Pay for the change of force: :math:`A \mathrel{-}= r |F(n) - F(n-1)|`."""
    return state - device.half_resolution * write.change_sum


def settle_memoryless(state: State, write: Write, device: DeviceConstants) -> State:
    r"""Forget part of what this force does not need, then pay for its change.

    .. math::

        N &= r |F(n-1)| + (|F(n)| - f_c)_+^2 / (4B) \\
        A &= \min\Big(A, N + \frac{\tau}{\tau + T} (A - N)\Big) - r |F(n) - F(n-1)|

    Giving energy up is always safe: A remains a lower bound.
    """
    r = device.half_resolution
    excess = max(math.sqrt(write.square) - device.friction, 0.0)
    needed = r * write.held_sum + excess * excess * device.hold_limit / (4.0 * device.damping)
    surplus = max(state - needed, 0.0)
    forgotten = surplus * device.period / (FORGETTING + device.period)
    return state - forgotten - r * write.change_sum


def energy(state: State, write: Write, device: DeviceConstants) -> float:
    r"""Return a lower bound of loss plus work at this sample, in J: :math:`A - r |F(n)|`."""
    return state - device.half_resolution * write.force_sum


CERTIFIED = BoundingLaw(
    summary="certified for the physical energy",
    start=start,
    limit=limit,
    settle=settle,
    energy=energy,
    is_certified=True,
)

CERTIFIED_MEMORYLESS = BoundingLaw(
    summary="certified for the physical energy, surplus forgotten within 20 ms",
    start=start,
    limit=limit,
    settle=settle_memoryless,
    energy=energy,
    is_certified=True,
)
