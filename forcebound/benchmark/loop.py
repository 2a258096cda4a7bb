"""Benchmark of the four-hop loop: the real graph against bare pyzmq.

Device, controller, environment, controller, device. Contestants run alternately, with fresh
processes for each round:

1. ``graph``: the nodes of the launch file, as the launcher places and schedules them
   (:mod:`forcebound.benchmark.graph_loop`);
2. ``bare``: bare pyzmq with the graph's sockets and options, the same bytes and the same placement
   (:mod:`forcebound.benchmark.bare_loop`), for the cost of the graph's own work;
3. ``default``: the same without placement, for the gain of placement.

No recorder listens to the loop, as in any run without ``--record``: such a run records only
telemetry, which the device sends after the loop is closed.
"""

import contextlib
import tempfile
from collections.abc import Callable
from typing import Any

from forcebound.benchmark.figures import Measured, compare, judge, plan, report
from forcebound.benchmark.graph_loop import settings_of
from forcebound.benchmark.workers import READY, WARMUP, collect, conditions, module, started
from forcebound.config.loader import load
from forcebound.processes import NODES

LAUNCH_FILE = "stiff_wall"
# Limit -> percentile -> largest ratio of the graph to it; None: for information.
TARGETS: dict[str, dict[str, float | None]] = {
    "bare": {"p50": 1.25, "p99": 1.5, "p99_9": None},
    "default": {"p50": 0.7, "p99": None, "p99_9": 0.2},
}


def run(duration: float, rate: float, progress: Callable[[str], None]) -> dict[str, Any]:
    """Run the benchmark; see :meth:`forcebound.benchmark.Benchmark.run`."""
    settings = settings_of(load(LAUNCH_FILE))
    surroundings = conditions(settings)
    core = -1 if settings.core is None else settings.core
    contestants = {
        "graph": Measured(f"graph of {LAUNCH_FILE}"),
        "bare": Measured("bare pyzmq, same sockets and placement"),
        "default": Measured("bare pyzmq, default placement"),
    }
    rounds, count = plan(duration, len(contestants), rate)
    timing = (round(1e9 / rate), count)
    programs: dict[str, tuple[str, tuple[object, ...]]] = {  # module, arguments after the folder
        "graph": ("graph_loop", (LAUNCH_FILE, *timing)),
        "bare": ("bare_loop", (core, settings.policy, *timing)),
        "default": ("bare_loop", (-1, "other", *timing)),
    }
    takes = READY + (WARMUP + count) / rate
    for number in range(rounds):
        for name, measured in contestants.items():
            progress(f"round {number + 1} of {rounds}: {measured.label}")
            _round(*programs[name], takes, measured)
    return report("loop", duration, rate, contestants, _compare(contestants), surroundings)


def _round(name: str, arguments: tuple[object, ...], takes: float, measured: Measured) -> None:
    with contextlib.ExitStack() as stack:
        folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="forcebound-"))
        *others, device = (module(name, role, folder, *arguments) for role in NODES)
        for command in others:
            stack.enter_context(started(command))
        collect(device, takes, measured)


def _compare(contestants: dict[str, Measured]) -> dict[str, dict[str, Any]]:
    graph = contestants["graph"]
    compared = {
        f"{limit}_{name}": compare(graph, contestants[limit], name, target)
        for limit, targets in TARGETS.items()
        for name, target in targets.items()
    }
    compared["missed"] = judge(f"{graph.label}, ticks missed", graph.missed, "ticks", 0.0)
    return compared
