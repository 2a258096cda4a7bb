"""The paper's less conservative law, which may spend all energy dissipated so far.

It remembers the energy dissipated in free motion, and can give it back at contact: stiff walls, and
oscillation after contact (the paper's memory effect). Its leaks are explained in
``docs/theory.md``: friction is counted twice, once in E1 and once as an estimate of the future, and
readings are taken for positions.
"""

import math
from collections.abc import Sequence
from itertools import pairwise

from forcebound.bounding.dissipation import Dissipation
from forcebound.bounding.law import BoundingLaw, State, observe_energy
from forcebound.bounding.sample import DeviceConstants, Sample


def limit(state: State, sample: Sample, device: DeviceConstants) -> tuple[State, float, float]:
    r"""Limit the force by the energy observed so far.

    .. math:: F_{max}(n) = \sqrt{4 B (E_1(n) + f_c |\Delta x(n)|)}

    with :math:`B = b / T` and E1 of :func:`observe_energy`. An argument of the root below 0, which
    the paper leaves open, gives :math:`F_{max} = 0`.

    Source: Eq. 11 and 14 of the paper; with f_c = 0 Eq. 35 and 36.
    """
    energy = observe_energy(state, sample, device)
    budget = energy + device.friction * sample.distance
    capability = device.damping / device.period
    return energy, math.sqrt(4.0 * capability * max(budget, 0.0)), 0.0


LESS_CONSERVATIVE = BoundingLaw(
    summary="less conservative, viscous damping and Coulomb friction",
    limit=limit,
)

LESS_CONSERVATIVE_VISCOUS = BoundingLaw(
    summary="less conservative, viscous damping alone",
    limit=limit,
    uses_friction=False,
)


def less_conservative_noncausal(
    positions: Sequence[float], commanded: Sequence[float], dissipation: Dissipation
) -> list[float]:
    r"""Return the force of the non-causal original of the law on a recorded trace, one axis.

    .. math:: F_{max}(n) = \sqrt{4 B (E_1(n) + f_c |\Delta x(n+1)|)}

    It needs the position of the next sample, so it serves to check the causal law offline (paper,
    Fig. 20). The last sample has no next one and is taken to rest.

    Args:
        positions: Position at each sample, in m, shape ``(n,)``.
        commanded: Commanded force at each sample, in N, shape ``(n,)``.
        dissipation: The device.

    Returns:
        Bounded force at each sample, in N, shape ``(n,)``.

    Raises:
        ValueError: If the lengths differ.

    Source: Eq. 11 to 13 of the paper.
    """
    if len(positions) != len(commanded):
        raise ValueError(f"got {len(positions)} positions but {len(commanded)} forces")
    damping, friction = dissipation.least_damping, dissipation.least_friction
    stiffness = damping / dissipation.period
    moves = [0.0, *(after - before for before, after in pairwise(positions)), 0.0]
    energy = force = 0.0
    forces: list[float] = []
    for n, wanted in enumerate(commanded):
        energy += stiffness * moves[n] ** 2 + friction * abs(moves[n])
        energy += force * moves[n]
        budget = energy + friction * abs(moves[n + 1])
        largest = min(math.sqrt(4.0 * stiffness * max(budget, 0.0)), dissipation.saturation)
        force = max(-largest, min(largest, wanted))
        forces.append(force)
    return forces
