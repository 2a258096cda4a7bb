"""Exchanges at a steady pace, measured: one a period, as those of a servo."""

import time
from collections.abc import Callable

from forcebound.benchmark.workers import WARMUP, Stopwatch
from forcebound.realtime import wait_until


def pace(exchange: Callable[[], int | None], spin_ns: int, period_ns: int, count: int) -> None:
    """Measure exchanges and write them to standard output; those of the warm-up do not count.

    One is missed if it takes longer than a period, or has no answer. The next then begins at the
    next instant in the future.

    Args:
        exchange: Returns how long it took, in ns; None: no answer came.
        spin_ns: Of the waits, in ns.
        period_ns: Between two instants, in ns.
        count: Of exchanges.
    """
    times_ns: list[int] = []
    missed, watch = 0, Stopwatch()
    next_ns = time.monotonic_ns() + period_ns
    for index in range(-WARMUP, count):
        if index == 0:
            times_ns.clear()
            missed, watch = 0, Stopwatch()
        wait_until(next_ns, spin_ns)
        took_ns = exchange()
        if took_ns is not None:
            times_ns.append(took_ns)
        missed += took_ns is None or took_ns > period_ns
        next_ns += period_ns * max(1, 1 + (time.monotonic_ns() - next_ns) // period_ns)
    watch.write_times(times_ns, missed)


def timed(exchange: Callable[[], object]) -> Callable[[], int]:
    """Return the exchange with its duration, in ns, as its answer."""

    def measured() -> int:
        begun_ns = time.monotonic_ns()
        exchange()
        return time.monotonic_ns() - begun_ns

    return measured
