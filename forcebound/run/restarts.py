"""Restart policy: back off, then give up."""

from collections import Counter, deque

BACK_OFF_NS = (0, 200_000_000, 500_000_000, 1_000_000_000, 2_000_000_000)  # the last one repeats
GIVE_UP_DEATHS = 5  # ends of one node ...
GIVE_UP_NS = 10_000_000_000  # ... within this time; a longer life resets the back-off


class Restarts:
    """Unexpected ends and planned restarts of a run's processes, by name."""

    def __init__(self) -> None:
        self.due_ns: dict[str, int] = {}  # when one that is down starts again
        self.counts: Counter[str] = Counter()
        self._deaths: dict[str, deque[int]] = {}
        self._in_a_row: Counter[str] = Counter()

    def plan(self, node: str, time_ns: int) -> bool:
        """Record an end and plan the restart; return False to give up."""
        deaths = self._deaths.setdefault(node, deque(maxlen=GIVE_UP_DEATHS))
        if deaths and time_ns - deaths[-1] >= GIVE_UP_NS:
            self._in_a_row[node] = 0
        wait_ns = BACK_OFF_NS[min(self._in_a_row[node], len(BACK_OFF_NS) - 1)]
        self._in_a_row[node] += 1
        deaths.append(time_ns)
        if len(deaths) == GIVE_UP_DEATHS and time_ns - deaths[0] < GIVE_UP_NS:
            return False
        self.due_ns[node] = time_ns + wait_ns
        return True

    def take_due(self, time_ns: int) -> list[str]:
        """Return the processes that are due for a restart, and count them."""
        due = [node for node, due_ns in self.due_ns.items() if due_ns <= time_ns]
        for node in due:
            del self.due_ns[node]
            self.counts[node] += 1
        return due
