"""The paper's more conservative law: energy dissipated before and not needed is discarded.

The state is β, the share of the dissipation capability B = b/T that the last force needed, in N/m.
Because nothing is remembered beyond one sample, a wall does not oscillate after contact; it is
softer: a saturated viscous wall shows exactly 2B.
"""

import math
from dataclasses import replace

from forcebound.haptics.laws.law import BoundingLaw, State
from forcebound.haptics.laws.sample import DeviceConstants, Sample, Write

# Smallest share of B that β may take: far below any force that matters, far above underflow. A β
# above the required one keeps Eq. 21 satisfied as long as it is at most B.
SMALLEST_SHARE = 1e-30


def start(device: DeviceConstants) -> State:
    """Return β at the start: B, in N/m (paper, after Eq. 30)."""
    return device.damping / device.period


def limit(state: State, sample: Sample, device: DeviceConstants) -> tuple[State, float, float]:
    r"""Limit the force by what the last hold has left.

    .. math::

        \gamma &= 2 \beta(n-1) \Delta x(n) + F_d(n-1) \\
        \rho &= 4 \beta(n-1) f_c |\Delta x(n)| \\
        \beta(n) &= \min(B, \beta(n-1) F_e^2 / (\gamma^2 + \rho)) \\
        F_{max} &= \sqrt{\beta(n) / \beta(n-1) \cdot (\gamma^2 + \rho)}

    In several axes :math:`\gamma` is a vector and :math:`\gamma^2` its square. Cases that the paper
    leaves open: :math:`F_e = 0` or :math:`\gamma^2 + \rho = 0` give :math:`F_{max} = 0` and
    :math:`\beta = B`, since Eq. 21 then holds for any β.

    Eq. 25 as printed has :math:`4 \beta(i-1) f_c |\Delta x|` where its derivation, Eq. 21, gives
    :math:`4 \beta(i) f_c |\Delta x|`; Eq. 30, used here, agrees with the derivation.

    Source: Eq. 26 to 31 of the paper; with f_c = 0 Eq. 37 to 40.
    """
    capability = device.damping / device.period
    gamma_square = (
        (2.0 * state * sample.distance) ** 2 + 4.0 * state * sample.work + sample.held * sample.held
    )
    rho = 4.0 * state * device.friction * sample.distance
    square = max(gamma_square, 0.0) + rho  # below 0 by rounding only
    commanded = sample.commanded
    if commanded == 0.0 or square == 0.0:
        return capability, 0.0, 0.0
    needed = max(state * commanded * commanded / square, SMALLEST_SHARE * capability)
    needed = min(capability, needed)
    return needed, math.sqrt(needed / state * square), 0.0


def energy(state: State, write: Write, device: DeviceConstants) -> float:
    r"""Return the energy that the law has kept, in J: :math:`F_d(n)^2 / (4 \beta(n))`.

    All else has been given up: the sum of Eq. 20 is zero (paper, after Eq. 25).
    """
    return write.square / (4.0 * state)


MORE_CONSERVATIVE = BoundingLaw(
    summary="more conservative, viscous damping and Coulomb friction",
    start=start,
    limit=limit,
    energy=energy,
)

MORE_CONSERVATIVE_VISCOUS = replace(
    MORE_CONSERVATIVE, summary="more conservative, viscous damping alone", uses_friction=False
)
