r"""The most energy that a hand can get out of one hold (``docs/theory.md``, section 3).

It can move by d against the force F; in the time T it then loses at least :math:`b d^2 / T` by
damping, and by friction at least :math:`f (d - z)_+`, where z is the play before friction is sure:
0 for rigid friction, twice the presliding for friction that yields first. So the hold costs

.. math:: \max_{d \ge 0} \big( |F| d - f (d - z)_+ - b d^2 / T \big)

Forces are magnitudes, in N; friction f in N, play z in m, damping b in N s/m, times in s.
"""

import math


def rigid_cost(force: float, friction: float, damping: float, duration: float) -> float:
    """Return :math:`(|F| - f)_+^2 T / (4b)`, in J: the cost of a hold with rigid friction."""
    excess = max(force - friction, 0.0)
    return excess * excess * duration / (4.0 * damping)


def rigid_force(energy: float, friction: float, damping: float, duration: float) -> float:
    r"""Return the largest force whose hold costs at most ``energy``, in N.

    .. math:: f + 2 \sqrt{b \max(E, 0) / T}

    In deficit it is f: friction dissipates all that such a force could give.
    """
    return friction + 2.0 * math.sqrt(damping / duration * max(energy, 0.0))


def hold_cost(force: float, friction: float, play: float, damping: float, duration: float) -> float:
    """Return the cost of a hold in which friction is sure only beyond a ``play`` (m), in J.

    The worst displacement lies before that play, beyond it, or at its end.
    """
    mobility = duration / (2.0 * damping)
    if force * mobility <= play:
        return 0.5 * force * force * mobility
    excess = force - friction
    if excess * mobility >= play:
        return 0.5 * excess * excess * mobility + friction * play
    return play * (force - 0.5 * play / mobility)


def lagging_cost(before: float, after: float, damping: float, duration: float, lag: float) -> float:
    r"""Return the cost of a hold that an amplifier approaches with a time constant ``lag``, in J.

    With :math:`E = e^{-T/\tau}` the force's excess over friction, ``before`` :math:`e_0` and
    ``after`` :math:`e_1`, is at most :math:`e(t) = e_1 (1 - E) + e_0 E`, and the cost

    .. math:: \frac{1}{4b} \Big( \int_0^T e^2 dt + \frac{\tau}{2} e(T)^2 \Big)

    whose last term is what the hand can get while the force decays after a cut (section 3.2 there).
    """
    left = math.exp(-duration / lag)
    once = lag * (1.0 - left)
    twice = 0.5 * lag * (1.0 - left * left)
    at_end = after * (1.0 - left) + before * left
    square = after * after * (duration - 2.0 * once + twice)
    square += 2.0 * before * after * (once - twice) + before * before * twice
    return (square + 0.5 * lag * at_end * at_end) / (4.0 * damping)
