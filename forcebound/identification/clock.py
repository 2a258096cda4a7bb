"""Clocks of an identification: the real one, and that of a simulated device."""

import time
from typing import Protocol

from forcebound import realtime

SPIN_NS = 30_000


class Clock(Protocol):
    """Time, in ns, and waiting for it."""

    def now(self) -> int:
        """Return the time."""
        ...

    def wait_until(self, time_ns: int) -> None:
        """Return at this time, or at once if it has passed."""
        ...


class RealClock:
    """The monotonic clock of this machine."""

    def now(self) -> int:
        """Return the time; see :class:`Clock`."""
        return time.monotonic_ns()

    def wait_until(self, time_ns: int) -> None:
        """Wait; see :class:`Clock`."""
        realtime.wait_until(time_ns, SPIN_NS)


class VirtualClock:
    """A time that passes only while somebody waits for it."""

    def __init__(self) -> None:
        self._now_ns = 0

    def now(self) -> int:
        """Return the time; see :class:`Clock`."""
        return self._now_ns

    def wait_until(self, time_ns: int) -> None:
        """Let the time pass; see :class:`Clock`."""
        self._now_ns = max(self._now_ns, time_ns)
