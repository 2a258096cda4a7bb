"""The hold limit that a servo chooses for itself: ``device: {hold_limit: auto}``.

A certified force is at most ``f_c + 2 sqrt(b G / T_max)`` for a ledger of G, so a short hold limit
T_max gives more force. A tick that comes later than T_max costs part of the ledger, so a long one
gives more force where ticks are late. The ledger is in joules, and T_max matters only when a limit
is computed; so T_max may be chosen before each hold.

How it is chosen. The servo counts the late intervals by their length, and old counts fade. From
them follows how many are to be expected within a horizon of 17 000 periods, in which a hand may
rest in a wall and bring no energy back. Among the rungs of a ladder, the limit L (in periods) with
the least

    1/2 ln L  +  price * (late intervals longer than L, expected within the horizon)

is chosen: the logarithm is the share of the force that the length costs, the price is the share
that one overrun costs. So a single overrun lengthens the limit at once where overruns are dear, and
many overruns do so where they are cheap. On a punctual clock the limit is the shortest rung.
"""

import math
from bisect import bisect_left

from forcebound.haptics.laws.dissipation import Watchdog

FLOOR = 1.02  # periods; the shortest limit: a punctual servo is late by less than this
FIXED = 1.25  # periods; for a device whose hold limit cannot be set
_MIDDLE = (1.03, 1.05, 1.08, 1.12, 1.18, FIXED, 1.4, 1.6, 2.0, 2.5, 3.2, 4.0, 5.0, 6.5, 8.0)
LADDER = (FLOOR, *_MIDDLE, 10.0)  # periods
FADING_TICKS = 250  # between two fadings
FADING = 0.985  # of the counts
HORIZON = FADING_TICKS / (1.0 - FADING)  # periods: what the counts remember
LEAST_SEEN = 500.0  # periods; a few late intervals at the beginning do not stand for a rate

# Share of the force that one overrun costs a pressed wall (docs/theory.md, section 3).
PRICES = {"guarding": 5e-5, "reporting": 0.0015, "silent": 0.5, "none": 0.0}


class HoldLimit:
    """The hold limit for the next hold, ``limit_ns``, learned from the lateness of the last."""

    def __init__(self, period_ns: int, watchdog: Watchdog) -> None:
        self._rungs = [round(ratio * period_ns) for ratio in LADDER]
        self._period_ns = period_ns
        self._costs = [0.5 * math.log(ratio) for ratio in LADDER]
        self._price = PRICES[watchdog]
        self.restart()

    def restart(self) -> None:
        """Forget all lateness."""
        self._late = [0.0] * len(self._rungs)  # intervals beyond this rung and not the next
        self._seen = 0.0  # periods in which they came
        self._ticks = 0
        self.limit_ns = self._rungs[0]

    def observe(self, interval_ns: int) -> bool:
        """Take in the interval between two writes, in ns; return whether the limit has changed."""
        self._ticks += 1
        self._seen += interval_ns / self._period_ns
        is_overrun = interval_ns > self.limit_ns
        if interval_ns > self._rungs[0]:
            self._late[bisect_left(self._rungs, interval_ns) - 1] += 1.0
        if self._ticks == FADING_TICKS:
            self._ticks = 0
            self._late = [FADING * count for count in self._late]
            self._seen *= FADING
        elif not is_overrun:
            return False
        before = self.limit_ns
        self.limit_ns = self._best()
        return self.limit_ns != before

    def _best(self) -> int:
        """Return the rung of least cost; of equal ones the shortest."""
        best, least = self._rungs[-1], math.inf
        overruns = 0.0
        price = self._price * HORIZON / max(self._seen, LEAST_SEEN)
        for rung, cost, late in zip(
            reversed(self._rungs), reversed(self._costs), reversed(self._late), strict=True
        ):
            overruns += late
            total = cost + price * overruns
            if total <= least:
                best, least = rung, total
        return best
