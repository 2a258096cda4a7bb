r"""The certified law: a bound on the physical energy, for any commanded force.

It relies on a :class:`~forcebound.bounding.Dissipation` and on nothing else. The state is the
ledger A. With e = x - q (\|e\| <= r), F̄ the mean force of an interval, y_i the play operator of
axis i, P_i its path and D_i = \|x_i - y_i\|, it keeps between samples the invariant

    loss + work at t_n  >=  A + F̄(n-1)·e(n) + f_c (‖P(n) + D(n)‖ - ‖P(n)‖)

whose last term, for one axis, is f_c \|x(n) - y(n)\|.

1. *In a hold.* By Cauchy-Schwarz a displacement d within T costs at least b d²/T + f_c\|d\|, so the
   energy in it is at least G - cost(F, T), with G = A - Σ_i r_i\|F̄_i(n-1)\| and the cost of
   :mod:`~forcebound.bounding.hold_cost`. The bounder lets no force be larger than that.
2. *Readings for positions.* Summation by parts turns Σ F̄·Δx into Σ F̄·Δq + F̄(n-1)·e(n) -
   Σ ΔF̄(k)·e(k): a price Σ_i r_i\|ΔF̄_i\| for a change of force, not r\|F\| for every sample.
3. *Friction.* When y_i moves by m, it moves towards x_i: D_i grows by at most \|Δx_i\| - m. So
   each x_i has gone at least P_i + D_i - r, and by Minkowski's inequality the path ∫\|v\| dt is at
   least ‖P + D‖ - r √axes: the growth of f_c ‖P‖ may be credited, f_c r √axes is paid at the start.
   Friction of each axis by itself: the same, axis by axis.
4. *Damping.* In any window of readings from t_j to t_n the way is at least \|Δ\| with Δ_i =
   max(\|q_i(n) - q_i(j)\| - 2r, 0), so by Cauchy-Schwarz ∫\|v\|² dt >= \|Δ\|²/(t_n - t_j) in it. If
   V_j is a lower bound up to t_j, then V_j + b\|Δ\|²/(t_n - t_j) is one up to t_n, and so is the
   largest of several such: from the last sample and from two anchors, which move on every eight
   samples (:func:`~forcebound.bounding.sample.viscous_loss`). One sample alone loses 2r each time:
   a hand at 35 mm/s moves 0.035 mm a millisecond, and with 2r = 0.03 mm a fiftieth of its loss is
   left.
5. *Changes within an interval*, such as a cut, cost their penalty
   (:mod:`~forcebound.bounding.waveform`). Points 2 to 4 bound the loss of the straight way from
   reading to reading, the penalty that of the detours; so no part of the loss counts twice.
6. *In deficit* \|F\| <= f_c: friction dissipates all that such a force could give.
7. *The memoryless variant* and the *cap* only discard energy, so A remains a lower bound.
"""

import math

from forcebound.bounding.law import BoundingLaw, State
from forcebound.bounding.sample import DeviceConstants, Sample, Write

FORGETTING = 0.020  # s, in which the memoryless law forgets 62 % of a surplus: the longest for
#                     which contacts turn no oftener than with the paper's law (docs/theory.md, 3)


def start(device: DeviceConstants) -> State:
    r"""Return the ledger at the first reading, in J: :math:`A = -f_c r \sqrt{axes}`."""
    return -device.start_price


def limit(state: State, sample: Sample, device: DeviceConstants) -> tuple[State, float, float]:
    r"""Bring the ledger up to this sample.

    .. math::

        A \mathrel{+}= V' - V + f_c |y' - y| + \bar F \Delta q - \mathrm{penalty}
            - r |\bar F(n-1) - \bar F(n-2)|

    but at most to the cap. What limits the force is that a hold may cost :func:`energy` at most.
    """
    ledger = state - sample.change_price
    ledger += sample.viscous_loss + sample.friction_loss + sample.work - sample.penalty
    return min(ledger, device.energy_cap + sample.held_price), math.inf, 0.0


def settle_memoryless(state: State, write: Write, device: DeviceConstants) -> State:
    r"""Forget part of what this force does not need.

    .. math:: A \mathrel{-}= \frac{T}{\tau + T} (G - \mathrm{cost}(F(n), T_{max}))_+

    Giving energy up is always safe: A remains a lower bound.
    """
    return state - max(write.surplus, 0.0) * device.period / (FORGETTING + device.period)


def energy(state: State, write: Write, device: DeviceConstants) -> float:
    r"""Return a lower bound of loss plus work at this sample, in J.

    .. math:: G = A - r |\bar F(n-1)|
    """
    return state - write.held_price


CERTIFIED = BoundingLaw(
    summary="certified for the physical energy",
    start=start,
    limit=limit,
    limits_holds=True,
    energy=energy,
    is_certified=True,
)

CERTIFIED_MEMORYLESS = BoundingLaw(
    summary="certified for the physical energy, surplus forgotten within 20 ms",
    start=start,
    limit=limit,
    limits_holds=True,
    settle=settle_memoryless,
    energy=energy,
    is_certified=True,
)
