"""No bound: what the others are compared with (paper, Fig. 7).

The force passes within the saturation. The state is the energy observer of the paper's Eq. 6, so
that a recording shows what a law would have seen.
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
    r"""Observe the energy, limit nothing; arguments in :mod:`forcebound.bounding.law`.

    .. math:: E_1(n) = E_1(n-1) + B \Delta x(n)^2 + f_c |\Delta x(n)| + F_d(n-1) \Delta x(n)

    Source: Eq. 6 and 11 of the paper.
    """
    energy = state + damping / period * distance * distance + friction * distance + work
    return energy, math.inf, 0.0


NONE = BoundingLaw(
    summary="no bound but the saturation",
    start=start_empty,
    limit=limit,
    settle=keep,
    energy=read_state,
)
