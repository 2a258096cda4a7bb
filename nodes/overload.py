"""The warning that a servo misses many ticks: the machine is too slow or too busy for its rate."""

WINDOW_NS = 1_000_000_000
SHARE = 0.05  # of the ticks, missed in a window: more is a warning
REPEAT_NS = 10_000_000_000  # between two warnings


class Overload:
    """Watches the missed ticks of a servo.

    Args:
        period_ns: Sampling period, in ns.
    """

    def __init__(self, period_ns: int) -> None:
        self._ticks = WINDOW_NS / period_ns
        self._window_end_ns: int | None = None
        self._missed_before = 0
        self._next_warning_ns = 0

    def observe(self, time_ns: int, missed: int) -> str | None:
        """Return a warning if many ticks of the last second were missed; else None.

        Args:
            time_ns: Now, in ns.
            missed: Ticks missed so far.
        """
        end_ns = self._window_end_ns
        if end_ns is not None and time_ns < end_ns:
            return None
        lately = missed - self._missed_before
        self._window_end_ns = time_ns + WINDOW_NS
        self._missed_before = missed
        if end_ns is None or lately <= SHARE * self._ticks or time_ns < self._next_warning_ns:
            return None
        self._next_warning_ns = time_ns + REPEAT_NS
        return (
            f"missed {lately} of {self._ticks:.0f} ticks in the last second, so there is little"
            " force: something else uses this core, or the servo has no realtime scheduling;"
            " `forcebound doctor` names the cause"
        )
