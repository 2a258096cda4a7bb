"""Time-domain passivity control, for comparison.

A passivity observer adds up the energy of the environment only, without the device's friction;
when it is negative, the passivity controller adds damping. Its known weakness, chatter at low
speed, is part of the comparison.

This is the only law that may apply *more* than the commanded force, or a force against it: the
damping is an added force. So of the promises in :mod:`forcebound.haptics.laws` only the
saturation holds for it (``adds_damping``).

Source: B. Hannaford and J.-H. Ryu, Time-domain passivity control of haptic interfaces, IEEE
Transactions on Robotics and Automation 18(1), 2002.
"""

import math

from forcebound.haptics.laws.law import BoundingLaw, State
from forcebound.haptics.laws.sample import DeviceConstants, Sample

# N s/m. A sampled damper α on a mass m overshoots at α > m/T: 75 N s/m for the 0.075 kg of a
# PHANToM Premium 1.5 at 1 kHz. Held well below, as is the authors' cap on α.
MAX_DAMPING = 30.0

# m/s. Below it the damping that one sample would need grows without bound.
MIN_SPEED = 1e-3


def limit(state: State, sample: Sample, device: DeviceConstants) -> tuple[State, float, float]:
    r"""Observe the energy; in deficit, add damping.

    .. math::

        W(n) &= W(n-1) + F_d(n-1) \Delta x(n) \\
        \alpha &= -W(n) / (v^2 T) \quad (W(n) < 0), \qquad 0 \quad (W(n) \ge 0)

    with :math:`v = \Delta x / dt`; :math:`v^2` has a floor and :math:`\alpha` a cap. The bounder
    then applies :math:`F_e + \alpha v` within the saturation.
    """
    balance = state + sample.work
    if balance >= 0.0:
        return balance, math.inf, 0.0
    speed = max(sample.distance / sample.dt, MIN_SPEED)
    return balance, math.inf, min(-balance / (speed * speed * device.period), MAX_DAMPING)


TDPA = BoundingLaw(
    summary="time-domain passivity observer and controller",
    limit=limit,
    adds_damping=True,
    exchanges=True,
)
