"""What a motor that attenuates changes in a measured motion (``docs/theory.md``, section 3.10).

It gives any share of the force that acts. Then the work is at least that of half the force, less
half the force times the way: as if friction were less by that half.
"""

import math

from forcebound.haptics.laws.ledger import Ledger
from forcebound.haptics.laws.sample import play
from forcebound.haptics.laws.waveform import Motor, penalty


def attenuated_price(ledger: Ledger, k: int, dt: float, move: float, mean: float) -> float:
    """Return what an attenuating motor can have given or failed to take, in J.

    It is beyond the work of half the ``mean`` force, in N. The friction which that uses up is not
    credited, and whenever less of it is used than before the play has a price
    (``docs/theory.md``, section 3.10).
    """
    axis = ledger.axis[k]
    one, motor = axis.constants, axis.motor
    rubbed = one.friction if one.presliding == 0.0 else 0.0
    distance = abs(move) + 2.0 * one.half_resolution
    half = 0.5 * motor.most
    if ledger.attenuates == 1 and ledger.age == ledger.since:  # one write: a share of its own
        half = 0.5 * abs(mean)
        price = max(half - rubbed, 0.0) * distance + penalty(motor, dt, 0.0, 1.0, move, one)
    else:
        price = lost_price(motor, dt, rubbed, one.damping, distance, mean)
    left = one.friction - min(half, rubbed)
    position = play(ledger.reading[k], axis.memory.play, one.half_play)
    price += (one.friction - left) * abs(position - axis.memory.play)
    price += (one.half_resolution + one.half_play) * max(left - axis.rubbed, 0.0)
    axis.rubbed = left
    return price


def lost_price(
    motor: Motor, dt: float, rubbed: float, damping: float, distance: float, mean: float
) -> float:
    r"""Return the penalty of an axis whose motor leaves out what it likes, in J.

    With :math:`c = (|F|/2 - f)_+`, ``rubbed`` f and ``distance`` D, at most that in the interval
    (``docs/theory.md``, section 3.10). ``mean`` is that of the force, in N.
    """
    c = max(0.5 * motor.most - rubbed, 0.0)
    changes = 0.0  # Γ
    if motor.steps > 0.0:
        changes = 0.25 * max(motor.second - mean * motor.first, 0.0)
    lost = c * distance
    if 2.0 * damping * distance < c * dt:
        lost = damping * distance * distance / dt + c * c * dt / (4.0 * damping)
    return lost + (changes + 2.0 * c * math.sqrt(changes * dt)) / (4.0 * damping)
