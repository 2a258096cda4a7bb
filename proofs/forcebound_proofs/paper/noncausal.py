"""The non-causal originals of the paper's laws, on a recorded trace of one axis.

They need the position of the next sample, so they serve to check the causal laws offline. The last
sample has no next one and is taken to rest. ``positions`` are in m and ``commanded`` forces in N,
one of each sample; the result is the bounded force of each, in N.
"""

import math
from collections.abc import Sequence
from itertools import pairwise

from forcebound.haptics.laws.dissipation import Dissipation
from forcebound.haptics.laws.more_conservative import SMALLEST_SHARE


def less_conservative_noncausal(
    positions: Sequence[float], commanded: Sequence[float], dissipation: Dissipation
) -> list[float]:
    r"""Return the forces of the less conservative law (paper, Fig. 20).

    .. math:: F_{max}(n) = \sqrt{4 B (E_1(n) + f_c |\Delta x(n+1)|)}

    Source: Eq. 11 to 13 of the paper.
    """
    damping, friction = dissipation.least_damping, dissipation.least_friction
    stiffness = damping / dissipation.period
    moves = _moves(positions)
    energy = force = 0.0
    forces: list[float] = []
    for n, demand in enumerate(commanded):
        energy += stiffness * moves[n] ** 2 + friction * abs(moves[n])
        energy += force * moves[n]
        budget = energy + friction * abs(moves[n + 1])
        largest = min(math.sqrt(4.0 * stiffness * max(budget, 0.0)), dissipation.saturation)
        force = max(-largest, min(largest, demand))
        forces.append(force)
    return forces


def more_conservative_noncausal(
    positions: Sequence[float], commanded: Sequence[float], dissipation: Dissipation
) -> list[float]:
    r"""Return the forces of the more conservative law (paper, Fig. 21).

    :math:`\rho = 4 \beta(n-1) f_c |\Delta x(n+1)|` in place of :math:`|\Delta x(n)|`.

    Source: Eq. 26 to 30 of the paper.
    """
    damping, friction = dissipation.least_damping, dissipation.least_friction
    capability = damping / dissipation.period
    moves = _moves(positions)
    beta, force = capability, 0.0
    forces: list[float] = []
    for n, demand in enumerate(commanded):
        demand = max(-dissipation.saturation, min(dissipation.saturation, demand))
        gamma = 2.0 * beta * moves[n] + force
        rho = 4.0 * beta * friction * abs(moves[n + 1])
        square = gamma * gamma + rho
        largest, needed = 0.0, capability
        if demand != 0.0 and square != 0.0:
            needed = max(beta * demand * demand / square, SMALLEST_SHARE * capability)
            needed = min(capability, needed)
            largest = math.sqrt(needed / beta * square)
        beta = needed
        force = max(-largest, min(largest, demand))
        forces.append(force)
    return forces


def _moves(positions: Sequence[float]) -> list[float]:
    """Return how far each sample is from the one before, and the next of the last one, in m."""
    return [0.0, *(after - before for before, after in pairwise(positions)), 0.0]
