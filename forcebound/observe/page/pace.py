"""How often pages get a picture, a servo comes first; and how often they may send a message."""

SLOWEST = 8  # times as long at most, while ticks are missed
LATE = 0.01  # share of missed ticks in a second from which on pages back off
MOST_MESSAGES = 500  # a second, from a page; one that drags a hand sends a message a picture
FLOOD = 2000  # messages that did not count, after which a page is no page
BURST = 0.2  # s, whose messages may come at once
CALM = 2  # seconds without, after which they come back by one step


class Pace:
    """How much slower pages are than they could be, since a servo that misses ticks comes first.

    ``slowness`` is 1 on a machine that keeps up; it doubles, up to ``SLOWEST``, after each second
    in which many ticks were missed, and halves after each calm time.
    """

    def __init__(self, period: float) -> None:
        self.slowness = 1
        self._most = LATE / period  # missed ticks in a second
        self._begin = (0, 0.0)  # missed ticks and time, s, of this second
        self._calm = 0  # seconds

    def note(self, misses: int, now: float) -> None:
        """Take in how many ticks were missed so far."""
        missed, seconds = misses - self._begin[0], now - self._begin[1]
        if seconds < 1.0:
            return
        self._begin = misses, now
        is_late = self._most * seconds < missed
        self._calm = 0 if is_late else self._calm + 1
        if is_late:
            self.slowness = min(2 * self.slowness, SLOWEST)
        elif self._calm % CALM == 0:
            self.slowness = max(self.slowness // 2, 1)


class Limit:
    """Which messages of one page count: those of a flood do not."""

    def __init__(self) -> None:
        self._next = 0.0  # s, from when on a message counts
        self._refused = 0

    @property
    def is_flooded(self) -> bool:
        """Whether so many did not count that the page must go."""
        return self._refused > FLOOD

    def permits(self, now: float) -> bool:
        """Return whether a message that comes at ``now``, in s, counts."""
        due = max(self._next, now - BURST)
        is_permitted = due <= now
        if is_permitted:
            self._next = due + 1.0 / MOST_MESSAGES
        self._refused += not is_permitted
        return is_permitted
