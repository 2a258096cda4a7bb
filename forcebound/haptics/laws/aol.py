"""The adjusting output-limiter (AOL), reconstructed; the paper compares with it.

Lee and Lee (IEEE Transactions on Control Systems Technology 17(4), 2009) is the source of the idea;
the paper does not print its equations. The paper's description (the same information as the less
conservative law, no causality problem, 5.9 % more force on the trace of Fig. 18) fits the exact
causal bound, so this is that bound and not a transcription.
"""

import math

from forcebound.haptics.laws.law import BoundingLaw, State, observe_energy
from forcebound.haptics.laws.sample import DeviceConstants, Sample


def limit(state: State, sample: Sample, device: DeviceConstants) -> tuple[State, float, float]:
    r"""Limit the force by the worst next move.

    .. math::

        F_{max}(n) = f_c + 2 \sqrt{B E_1(n)} \quad (E_1(n) \ge 0), \qquad 0 \quad (E_1(n) < 0)

    with E1 of :func:`observe_energy`: the largest force for which
    :math:`B d^2 + f_c d - |F| d + E_1(n) \ge 0` for every move :math:`d \ge 0` of the next
    sample.
    """
    energy = observe_energy(state, sample, device)
    if energy < 0.0:
        return energy, 0.0, 0.0
    capability = device.damping / device.period
    return energy, device.friction + 2.0 * math.sqrt(capability * energy), 0.0


AOL = BoundingLaw(
    summary="adjusting output-limiter (exact causal bound; reconstruction)",
    limit=limit,
)
