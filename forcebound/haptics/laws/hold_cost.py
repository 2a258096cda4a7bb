r"""The most energy that a hand can get out of one hold (``docs/theory.md``, section 3).

It can move by d against the force F; in the time T it then loses at least :math:`b d^2 / T` by
damping, and by friction at least :math:`f (d - z)_+`, where z is the play before friction is sure:
0 for rigid friction, twice the presliding for friction that yields first. So the hold costs

.. math:: \max_{0 \le d \le D} \big( |F| d - f (d - z)_+ - b d^2 / T \big)

D is its ``reach``: how far a hand of a stated speed gets, in m; else it is infinite.
Forces are magnitudes, in N; friction f in N, play z in m, damping b in N s/m, times in s.
"""

import math


def rigid_cost(
    force: float, friction: float, damping: float, duration: float, reach: float = math.inf
) -> float:
    r"""Return the cost of a hold with rigid friction, in J.

    It is :math:`(|F| - f)_+^2 T / (4b)`, or less if the hand does not reach that far.
    """
    excess = max(force - friction, 0.0)
    if excess * duration > 2.0 * damping * reach:
        return (excess - damping * reach / duration) * reach
    return excess * excess * duration / (4.0 * damping)


def rigid_force(
    energy: float,
    friction: float,
    damping: float,
    duration: float,
    reach: float = math.inf,
    besides: float = 0.0,
) -> float:
    r"""Return the largest force whose hold costs at most ``energy``, in N.

    .. math:: f + 2 \sqrt{b \max(E, 0) / T}, \quad\text{if } E > b D^2 / T \quad f + b D / T + E / D

    In deficit it is f: friction dissipates all that such a force could give. The force may act
    ``besides``, for that time more, on any hand; then that is a part of the cost.
    """
    beyond = energy + damping * reach * reach / duration
    if energy * duration * duration > damping * reach * reach * (duration + besides):
        root = math.sqrt(reach * reach + besides / damping * beyond)
        return friction + 2.0 * beyond / (root + reach)
    return friction + 2.0 * math.sqrt(damping / (duration + besides) * max(energy, 0.0))


def hold_cost(
    force: float,
    friction: float,
    play: float,
    damping: float,
    duration: float,
    reach: float = math.inf,
) -> float:
    """Return the cost of a hold in which friction is sure only beyond a ``play`` (m), in J.

    The worst displacement lies before that play, beyond it, or at its end; or it is the reach.
    """
    mobility = duration / (2.0 * damping)
    if min(force * mobility, max((force - friction) * mobility, play)) > reach:
        return reach * (force - 0.5 * reach / mobility) - friction * max(reach - play, 0.0)
    if force * mobility <= play:
        return 0.5 * force * force * mobility
    excess = force - friction
    if excess * mobility >= play:
        return 0.5 * excess * excess * mobility + friction * play
    return play * (force - 0.5 * play / mobility)


def lagging_cost(
    before: float,
    after: float,
    damping: float,
    duration: float,
    lag: float,
    reach: float = math.inf,
) -> float:
    r"""Return the cost of a hold that an amplifier approaches with a time constant ``lag``, in J.

    With :math:`E = e^{-T/\tau}` the force's excess over friction, ``before`` :math:`e_0` and
    ``after`` :math:`e_1`, is at most :math:`e(t) = e_1 (1 - E) + e_0 E`, and the cost

    .. math:: \frac{1}{4b} \Big( \int_0^T e^2 dt + \frac{\tau}{2} e(T)^2 \Big)

    whose last term is what the hand can get while the force decays after a cut (section 3.2 there).
    With a ``reach`` the larger of both, held for all that time, may cost less (lemma 11 there).
    """
    left = math.exp(-duration / lag)
    once = lag * (1.0 - left)
    twice = 0.5 * lag * (1.0 - left * left)
    at_end = after * (1.0 - left) + before * left
    square = after * after * (duration - 2.0 * once + twice)
    square += 2.0 * before * after * (once - twice) + before * before * twice
    cost = (square + 0.5 * lag * at_end * at_end) / (4.0 * damping)
    if reach == math.inf:
        return cost
    excess = max(before, after)
    decay = rigid_cost(excess, 0.0, damping, 0.5 * lag)
    return min(cost, rigid_cost(excess, 0.0, damping, duration, reach) + decay)
