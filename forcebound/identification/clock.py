"""Clocks of an identification: the real one, and that of a simulated device."""

import time

from forcebound import realtime

SPIN_NS = 30_000


class Clock:
    """The monotonic clock of this machine, in ns."""

    def now(self) -> int:
        """Return the time."""
        return time.monotonic_ns()

    def wait_until(self, time_ns: int) -> None:
        """Return at this time, or at once if it has passed."""
        realtime.wait_until(time_ns, SPIN_NS)


class VirtualClock(Clock):
    """A time that passes only while somebody waits for it."""

    def __init__(self) -> None:
        self._now_ns = 0

    def now(self) -> int:
        """Return the time."""
        return self._now_ns

    def wait_until(self, time_ns: int) -> None:
        """Let the time pass."""
        self._now_ns = max(self._now_ns, time_ns)
