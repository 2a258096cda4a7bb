"""Contestant of the servo benchmark: wake-ups on an absolute schedule; see ``pacing.c``.

::

    python -m forcebound.benchmark.pacing CORE POLICY PERIOD_NS COUNT
"""

import sys
import time

from forcebound.benchmark.workers import WARMUP, Stopwatch, enter_contestant
from forcebound.realtime import Settings, enter, freeze_garbage, wait_until


def main(core: int, policy: str, period_ns: int, count: int) -> None:
    """Wake up ``count`` times and write each lateness to standard output."""
    enter_contestant()
    settings = Settings(policy=policy, core=core)
    enter(settings, "device")
    freeze_garbage()
    spin_ns = settings.spin_ns
    late_ns = [0] * (WARMUP + count)
    skipped, watch = 0, Stopwatch()
    next_ns = time.monotonic_ns() + period_ns
    for index in range(WARMUP + count):
        if index == WARMUP:
            skipped, watch = 0, Stopwatch()
        late = wait_until(next_ns, spin_ns) - next_ns
        late_ns[index] = late
        skipped += late // period_ns
        next_ns += period_ns * (1 + late // period_ns)
    watch.write_times(late_ns[WARMUP:], skipped)


if __name__ == "__main__":
    main(int(sys.argv[1]), sys.argv[2], int(sys.argv[3]), int(sys.argv[4]))
