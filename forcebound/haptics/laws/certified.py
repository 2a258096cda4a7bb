r"""The certified law: a bound on the physical energy, for any commanded force.

It relies on a :class:`~forcebound.haptics.laws.Dissipation` and on nothing else. The state is the
ledger A. With e = x - q (\|e\| <= r), F̄ the mean force of an interval, y_i the play operator of
axis i, P_i its path and D_i = \|x_i - y_i\|, it keeps between samples the invariant

    loss + work at t_n  >=  A + F̄(n-1)·e(n) + f_c (‖P(n) + D(n)‖ - ‖P(n)‖)

whose last term, for one axis, is f_c \|x(n) - y(n)\|. The proof is in ``docs/theory.md``, section
3.
"""

import math
from dataclasses import replace

from forcebound.haptics.laws.law import BoundingLaw, State
from forcebound.haptics.laws.sample import DeviceConstants, Sample, Write

FORGETTING = 0.020  # s, in which the fading law forgets 62 % of a surplus: the longest for
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


def settle_fading(state: State, write: Write, device: DeviceConstants) -> State:
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
    exchanges=True,
)

CERTIFIED_FADING = replace(
    CERTIFIED,
    summary="certified for the physical energy, surplus forgotten within 20 ms",
    settle=settle_fading,
)
