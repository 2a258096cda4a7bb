"""Benchmark of a device on a serial port: the driver's round trip against a bare pyserial loop.

The board is an emulated ODrive at rest, in a process of its own, the same one for all contestants
(:mod:`forcebound.benchmark.device_line`), which run alternately:

1. ``driver``: a reading by the driver, checksum, checks and guardian included;
2. ``bare``: the same bytes with pyserial, for the cost of the driver's own work;
3. ``line``: the same bytes through a pseudo-terminal with nothing behind it, for the cost of the
   kernel's part, whose worker has ordinary priority;
4. ``tick``: a tick of the device node: a reading and a write, bounded, published.
"""

import contextlib
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from forcebound.benchmark.figures import Measured, compare, judge, plan, report
from forcebound.benchmark.workers import WARMUP, collect, conditions, module, started
from forcebound.errors import RunError
from forcebound.realtime import choose_core

KIND = "odrive"
ROUND_TRIP_TARGET = 1.2  # ratio to bare pyserial, p50
START = 60.0  # s, for a process that may have to compile
LATE_NS = 300_000  # an exchange that takes longer is late


def run(duration: float, rate: float, progress: Callable[[str], None]) -> dict[str, Any]:
    """Run the benchmark; see :meth:`forcebound.benchmark.Benchmark.run`."""
    surroundings = conditions()
    policy, core = surroundings["policies"][-1], choose_core("auto")
    contestants = {
        "driver": Measured("reading by the driver"),
        "bare": Measured("bare pyserial"),
        "line": Measured("pseudo-terminal alone"),
        "tick": Measured(f"tick at {rate:.0f} Hz"),
    }
    rounds, count = plan(duration, len(contestants), rate)
    takes = START + (WARMUP + count) / rate
    with contextlib.ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="forcebound-")))
        port = folder / KIND
        stack.enter_context(_serving(_emulator(port), port))
        arguments = (folder, core, policy, round(1e9 / rate), count)
        for number in range(rounds):
            for role, measured in contestants.items():
                progress(f"round {number + 1} of {rounds}: {measured.label}")
                with contextlib.ExitStack() as answering:
                    used = port
                    if role == "tick":
                        command = module("servo_tick", "controller", *arguments)
                        answering.enter_context(started(command))
                    elif role == "line":
                        used = folder / f"echo{number}"
                        command = module("device_line", "echo", used, *arguments)
                        answering.enter_context(_serving(command, used))
                    collect(module("device_line", role, used, *arguments), takes, measured)
    surroundings |= {"core": core, "policy": policy, "device": f"emulated {KIND}"}
    return report("device", duration, rate, contestants, _compare(contestants), surroundings)


def _compare(contestants: dict[str, Measured]) -> dict[str, dict[str, Any]]:
    driver, bare, line, tick = contestants.values()
    late = {
        f"{name}_late": judge(
            f"{one.label}, later than {LATE_NS / 1e6:g} ms", _late_share(one), "%", None
        )
        for name, one in contestants.items()
        if one is not tick
    }
    return {
        "round_trip_p50": compare(driver, bare, "p50", ROUND_TRIP_TARGET),
        "round_trip_p99": compare(driver, bare, "p99", None),
        "line_p99": compare(driver, line, "p99", None),
        **late,
        "tick_p99": judge(f"{tick.label}, p99", tick.at("p99") / 1e3, "us", None),
        "tick_missed": judge(f"{tick.label}, ticks missed", tick.missed, "ticks", 0.0),
    }


def _late_share(measured: Measured) -> float:
    """Return the share of late exchanges, in %."""
    times_ns = measured.all_times()
    return 100.0 * sum(time_ns > LATE_NS for time_ns in times_ns) / len(times_ns)


def _emulator(port: Path) -> list[str]:
    """Return the command that starts it."""
    values = port.with_suffix(".json")
    values.write_text('{"mechanism": {}, "operator": null}')  # nobody holds it
    command = [sys.executable, "-m", "forcebound", "emulate", KIND, "--link", str(port)]
    return [*command, "--values", str(values)]


@contextlib.contextmanager
def _serving(command: list[str], port: Path) -> Iterator[None]:
    """Run a process that makes a port, from when the port is there."""
    with started(command) as process:
        end = time.monotonic() + START
        while not port.is_symlink():
            if process.poll() is not None or time.monotonic() > end:
                raise RunError(f"nobody serves {port}; try: {' '.join(command[1:])}")
            time.sleep(0.05)
        yield
