"""The paper's less conservative law, which may spend all energy dissipated so far.

It remembers the energy dissipated in free motion, and can give it back at contact: stiff walls, and
oscillation after contact (the paper's memory effect). Its leaks are explained in
``docs/theory.md``: friction is counted twice, once in E1 and once as an estimate of the future, and
readings are taken for positions.
"""

import math
from dataclasses import replace

from forcebound.haptics.laws.law import BoundingLaw, State, observe_energy
from forcebound.haptics.laws.sample import DeviceConstants, Sample


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

LESS_CONSERVATIVE_VISCOUS = replace(
    LESS_CONSERVATIVE, summary="less conservative, viscous damping alone", uses_friction=False
)
