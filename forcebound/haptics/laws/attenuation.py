"""What a motor that attenuates changes in a measured motion (``docs/theory.md``, section 3.10).

It gives any share of the force that acts, from the least share m to 1. Then the work is at least
that of the middle of these, less (1 - m)/2 of the force times the way: as if friction were less.
"""

import math

from forcebound.haptics.laws.ledger import Ledger
from forcebound.haptics.laws.sample import play
from forcebound.haptics.laws.waveform import penalty


def attenuated_price(ledger: Ledger, k: int, dt: float, move: float, mean: float) -> float:
    """Return what an attenuating motor can have given or failed to take, in J.

    It is beyond the work of the middle of all shares of the ``mean`` force, in N. The friction that
    is used up is not credited, and whenever less of it is used than before the play has a price
    (``docs/theory.md``, section 3.10).
    """
    axis = ledger.axis[k]
    one, motor = axis.constants, axis.motor
    rubbed = one.friction if one.presliding == 0.0 else 0.0
    distance = abs(move) + 2.0 * one.half_resolution
    unknown = 0.5 * (1.0 - ledger.least_share)
    away = unknown * motor.most
    if ledger.attenuates == 1 and ledger.age == ledger.since:  # one write: a share of its own
        away = unknown * abs(mean)
        price = max(away - rubbed, 0.0) * distance + penalty(motor, dt, 0.0, 1.0, move, one)
    else:
        changes = 0.0
        if motor.steps > 0.0:
            changes = (1.0 - unknown) ** 2 * max(motor.second - mean * motor.first, 0.0)
        price = lost_price(max(away - rubbed, 0.0), changes, dt, one.damping, distance)
    left = one.friction - min(away, rubbed)
    position = play(ledger.reading[k], axis.memory.play, one.half_play)
    price += (one.friction - left) * abs(position - axis.memory.play)
    price += (one.half_resolution + one.half_play) * max(left - axis.rubbed, 0.0)
    axis.rubbed = left
    return price


def lost_price(c: float, changes: float, dt: float, damping: float, distance: float) -> float:
    r"""Return the penalty of an axis whose motor leaves out what it likes at any time, in J.

    ``c`` is what it may add to or take from the middle, beyond friction, in N; ``changes`` is
    :math:`\Gamma`, in N² s, ``distance`` D, at most that in the interval.
    """
    lost = c * distance
    if 2.0 * damping * distance < c * dt:
        lost = damping * distance * distance / dt + c * c * dt / (4.0 * damping)
    return lost + (changes + 2.0 * c * math.sqrt(changes * dt)) / (4.0 * damping)
