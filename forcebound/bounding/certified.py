r"""The certified law: a bound that holds for the physical energy, whatever force is asked for.

It relies on the stated b, f_c, the resolution Δ = 2r of the reading (\|x(t_n) - q(n)\| <= r), the
measured period dt, and a device that by itself drops a force older than T_max. The state is the
ledger A. Between samples, with e = x - q and y the play operator, it keeps the invariant

    loss + work at t_n  >=  A + F(n-1)·e(n) + f_c |x(n) - y(n)|

1. *In a hold.* By Cauchy-Schwarz a displacement d within T_max costs at least B d² + f_c\|d\|, so
   the energy in it is at least G + B d² + f_c\|d\| + F·d >= G - (\|F\| - f_c)₊²/(4B), where
   G = A - r Σ_i\|F_i(n-1)\|.
2. *Readings for positions.* Summation by parts turns Σ F·Δx into Σ F·Δq + F(n-1)·e(n) -
   Σ ΔF(k)·e(k): a price r Σ_i\|ΔF_i\| for a change of force, not r\|F\| for every sample.
3. *Friction.* When y moves by m, it moves towards x: \|x - y\| grows by at most (path of x) - m.
   So f_c m may be credited; the unknown \|x(0) - y(0)\| <= r √axes is paid at the start.
4. *In deficit* \|F\| <= f_c: friction eats all that such a force could give.

What is easily missed: after an overrun (dt > T_max) the play operator must *start again* at the
reading, for the price f_c r √axes of a start. Letting it follow the reading without credit is not
enough. The friction of the cut hold is already used up in step 1, but \|x - y\| may have grown by
2r in it, and step 3 would credit that path a second time: f_c Δ for each overrun
(``tests/test_certified_law.py`` walks the path on which this leaks). The factor √axes is the length
of a vector of n errors of at most r.
"""

import math

from forcebound.bounding.law import BoundingLaw

FORGETTING = 0.020  # s, in which the memoryless law forgets 63 % of a surplus; chosen in
#                     docs/theory.md: with more of it, contacts begin to bounce


def start(
    damping: float,
    friction: float,
    half_resolution: float,
    period: float,
    hold_limit: float,
    axes: float,
) -> float:
    r"""Return the ledger at the first reading, in J: :math:`A = -f_c r \sqrt{axes}`."""
    return -friction * half_resolution * math.sqrt(axes)


def limit(
    state: float,
    asked: float,
    elapsed: float,
    distance: float,
    viscous_path: float,
    path: float,
    work: float,
    held: float,
    held_sum: float,
    damping: float,
    friction: float,
    half_resolution: float,
    period: float,
    hold_limit: float,
    axes: float,
) -> tuple[float, float, float]:
    r"""Bring the ledger up to this sample; arguments in :mod:`forcebound.bounding.law`.

    .. math::

        A &\mathrel{+}= b \max(|\Delta q| - 2r, 0)^2 / dt + f_c |y' - y| + F(n-1) \Delta q \\
        F_{max} &= f_c + 2 \sqrt{B \max(A - r |F(n-1)|, 0)}

    with :math:`B = b / T_{max}`. If :math:`dt > T_{max}` the hold was cut at an unknown position:

    .. math:: A \mathrel{-}= (|F(n-1)| - f_c)_+^2 / (4B) + r |F(n-1)| + f_c r \sqrt{axes}

    and from there F(n-1) = 0 and y' = q(n).
    """
    stiffness = damping / hold_limit
    if elapsed > hold_limit:
        excess = max(held - friction, 0.0)
        ledger = state - excess * excess / (4.0 * stiffness) - half_resolution * held_sum
        ledger -= friction * half_resolution * math.sqrt(axes)
        surplus = max(ledger, 0.0)
    else:
        ledger = state + damping * viscous_path + friction * path + work
        surplus = max(ledger - half_resolution * held_sum, 0.0)
    return ledger, friction + 2.0 * math.sqrt(stiffness * surplus), 0.0


def settle(
    state: float,
    applied: float,
    change_sum: float,
    held_sum: float,
    damping: float,
    friction: float,
    half_resolution: float,
    period: float,
    hold_limit: float,
    axes: float,
) -> float:
    r"""Pay for the change of force: :math:`A \mathrel{-}= r |F(n) - F(n-1)|`."""
    return state - half_resolution * change_sum


def settle_memoryless(
    state: float,
    applied: float,
    change_sum: float,
    held_sum: float,
    damping: float,
    friction: float,
    half_resolution: float,
    period: float,
    hold_limit: float,
    axes: float,
) -> float:
    r"""Forget part of what this force does not need, then pay for its change.

    .. math::

        N &= r |F(n-1)| + (|F(n)| - f_c)_+^2 / (4B) \\
        A &= \min\Big(A, N + \frac{\tau}{\tau + T} (A - N)\Big) - r |F(n) - F(n-1)|

    Giving energy up is always safe: A remains a lower bound.
    """
    excess = max(applied - friction, 0.0)
    needed = half_resolution * held_sum + excess * excess * hold_limit / (4.0 * damping)
    surplus = max(state - needed, 0.0)
    forgotten = surplus * period / (FORGETTING + period)
    return state - forgotten - half_resolution * change_sum


def energy(
    state: float,
    held: float,
    held_sum: float,
    damping: float,
    friction: float,
    half_resolution: float,
    period: float,
    hold_limit: float,
    axes: float,
) -> float:
    r"""Return a lower bound of loss plus work at this sample, in J: :math:`A - r |F(n)|`."""
    return state - half_resolution * held_sum


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
