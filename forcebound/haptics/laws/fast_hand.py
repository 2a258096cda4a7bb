"""A hand that is faster than stated: readings show it, and the ledger owes what it can have got.

``docs/theory.md``, section 3.2, lemma 12.
"""

import math

from forcebound.haptics.laws.ledger import Ledger
from forcebound.haptics.laws.timeline import acting_cost, cost_before, cost_within


def is_fast(ledger: Ledger) -> bool:
    """Return whether a reading shows more than the hand's speed while the last force acted."""
    square, acted = 0.0, min(ledger.age, ledger.since)
    for k in range(ledger.axes):
        move = ledger.reading[k] - ledger.axis[k].memory.reading
        square += move * move
    if ledger.is_dropped:
        acted = min(acted, ledger.held_limit * (1.0 + ledger.tolerance))
    way = ledger.hand_speed * max(acted, ledger.constants.period) + ledger.resolution
    return bool(square > way * way * (1.0 + 1e-9))  # sums are rounded


def owe(ledger: Ledger, least: float) -> None:
    """Take in what a faster hand can have got since the last reading that was taken in, in J.

    ``least`` is what the ledger had then. The forces before the next one cost as much as ever.
    """
    gain = 1.0 + ledger.gain
    decay = acting_cost(ledger, 0.5 * ledger.lag, gain)
    spent = ledger.spent + cost_before(ledger, gain, ledger.write_delay, True)
    if ledger.waiting > 0:
        decay = cost_within(ledger, 0.5 * ledger.lag, math.inf)
    spent += decay
    if spent > 0.0:
        ledger.fast_holds += 1
        least = max(least, -ledger.speed_leak, -ledger.largest_leak)
        ledger.speed_leak = max(ledger.speed_leak, spent - least)
