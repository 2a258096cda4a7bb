"""An energy tank at the hand: the passivity layer of two-layer control, for comparison.

The hand fills the tank by what it puts in, every force is paid from it, and a level controller adds
damping while it is low. Its known weaknesses are part of the comparison: the force of the next
interval is limited with the *last* velocity, a difference of readings, so a hand that speeds up
overdraws the tank; neither the encoder nor the length of the hold is counted; the energy of the
start is given away. The level is then negative, the force 0, and only damping acts. Passive in its
own account alone: it is no certified law. ``numbers``: ``initial_level`` (0 to 1 J),
``target_level`` (0.01 to 1 J), ``refill`` (up to 30 N s/m, divided by the target level).

Its damping is an added force, so of the promises in :mod:`forcebound.haptics.laws` only the
saturation holds (``adds_damping``).

Source: M. Franken, S. Stramigioli, S. Misra, C. Secchi, A. Macchelli, Bilateral telemanipulation
with time delays: a two-layer approach combining passivity and transparency, IEEE Transactions on
Robotics 27(4), 2011. Its text could not be had; the equations are those on which two public
implementations of it agree (the repositories nicolamarchiotto/Physical-Human-Body-Interaction,
with a report, and creminem94/pHRI). Left out, since it could not be verified or belongs to the
remote side: the tank there, and with it the energy sent and received, which is 0 here; the optional
limit by a function of the level. The continuous tank (F. Ferraguti et al., IEEE Transactions on
Robotics 31(5), 2015) is the same account in continuous time.
"""

import math

from forcebound.haptics.laws.law import BoundingLaw, State
from forcebound.haptics.laws.sample import DeviceConstants, Sample


def start(device: DeviceConstants) -> State:
    """Return the level at the start, in J."""
    return device.initial_level


def limit(state: State, sample: Sample, device: DeviceConstants) -> tuple[State, float, float]:
    r"""Pay the last force from the tank, and limit the next one to what is left.

    .. math::

        H(n) &= H(n-1) + F_d(n-1) \Delta x(n) \\
        F_{max} &= 0 \quad (H(n) \le 0), \qquad H(n) / (|v| T) \quad (H(n) > 0) \\
        d &= \alpha (H_d - H(n)) \quad (H(n) < H_d), \qquad 0 \quad (H(n) \ge H_d)

    with :math:`v = \Delta x / dt`, level H and its target :math:`H_d` in J, and damping d; the
    damping force :math:`d v` is added to the limited one.
    """
    level = state + sample.work
    largest = 0.0
    if level > 0.0:
        move = sample.distance / sample.dt * device.period
        largest = level / move if move > 0.0 else math.inf
    return level, largest, device.refill * max(device.target_level - level, 0.0)


ENERGY_TANK = BoundingLaw(
    summary="energy tank with a level controller (two-layer passivity)",
    start=start,
    limit=limit,
    adds_damping=True,
    numbers=(("initial_level", 0.0), ("target_level", 0.1), ("refill", 50.0)),
)
