"""Benchmark of injected delays: their error beyond the link's own latency.

A packet takes time also on a perfect link: encoding, sockets, waking up. So a perfect link runs in
turns with impaired ones, with a fresh pair of processes for each round
(:mod:`forcebound.benchmark.link_delay`). The error of a packet's delay is its time from node to
node, less the delay that the link drew for it, less the median time on the perfect link.
"""

import contextlib
import tempfile
from collections.abc import Callable
from typing import Any

from forcebound.benchmark.figures import Measured, beyond, plan, report
from forcebound.benchmark.graph_loop import settings_of
from forcebound.benchmark.link_delay import LINKS
from forcebound.benchmark.workers import READY, WARMUP, collect, conditions, module, started
from forcebound.config.loader import load

LAUNCH_FILE = "delayed_wall"
OWN = "own"
TARGETS_US = {"p50": 100.0, "p99": 500.0}
SUPERSEDED = 4  # times as long at most, since of reordered packets only the newest arrive


def run(duration: float, rate: float, progress: Callable[[str], None]) -> dict[str, Any]:
    """Run the benchmark; see :meth:`forcebound.benchmark.Benchmark.run`."""
    surroundings = conditions(settings_of(load(LAUNCH_FILE)))
    contestants = {name: Measured(_label(name)) for name in LINKS}
    rounds, count = plan(duration, len(contestants), rate)
    for number in range(rounds):
        for name, measured in contestants.items():
            progress(f"round {number + 1} of {rounds}: {measured.label}")
            _round(name, rate, count, measured)
    comparisons = {
        f"{name}_{share}": beyond(one, contestants[OWN], share, target)
        for name, one in contestants.items()
        for share, target in TARGETS_US.items()
        if name != OWN
    }
    return report("delay", duration, rate, contestants, comparisons, surroundings)


def _label(name: str) -> str:
    link = LINKS[name]
    if name == OWN:
        return "link's own latency"
    if link.jitter == 0.0:
        return f"{link.delay * 1e3:g} ms"
    return f"{link.delay * 1e3:g} ms ± {link.jitter * 1e3:g} ms {link.distribution}"


def _round(name: str, rate: float, count: int, measured: Measured) -> None:
    takes = READY + (WARMUP + count) / rate * SUPERSEDED
    with contextlib.ExitStack() as stack:
        folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="forcebound-"))
        arguments = (folder, LAUNCH_FILE, name, round(1e9 / rate), count)
        stack.enter_context(started(module("link_delay", "controller", *arguments)))
        collect(module("link_delay", "environment", *arguments), takes, measured)
