"""The adjusting output-limiter (AOL) that the paper compares with, reconstructed.

Lee and Lee (IEEE Transactions on Control Systems Technology 17(4), 2009) is the source of the idea;
the paper does not print its equations. What the paper says of it - the same information as the less
conservative law, no causality problem, 5.9 % more force on the trace of Fig. 18 - is what the exact
causal bound gives, so this is that bound and not a transcription.
"""

import math

from forcebound.bounding.law import BoundingLaw, keep, read_state, start_empty


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
    r"""Limit the force by the worst next move; arguments in :mod:`forcebound.bounding.law`.

    .. math::

        E_1(n) &= E_1(n-1) + B \Delta x(n)^2 + f_c |\Delta x(n)| + F_d(n-1) \Delta x(n) \\
        F_{max}(n) &= f_c + 2 \sqrt{B E_1(n)} \quad (E_1(n) \ge 0), \qquad 0 \quad (E_1(n) < 0)

    the largest force for which :math:`B d^2 + f_c d - |F| d + E_1(n) \ge 0` for every move
    :math:`d \ge 0` of the next sample.
    """
    stiffness = damping / period
    energy = state + stiffness * distance * distance + friction * distance + work
    if energy < 0.0:
        return energy, 0.0, 0.0
    return energy, friction + 2.0 * math.sqrt(stiffness * energy), 0.0


AOL = BoundingLaw(
    summary="adjusting output-limiter (exact causal bound; reconstruction)",
    start=start_empty,
    limit=limit,
    settle=keep,
    energy=read_state,
)
