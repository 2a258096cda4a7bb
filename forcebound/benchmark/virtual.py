"""Benchmark ``virtual``: the graph in virtual time, with one and with three axes.

The contestants run one after the other, a fifth of a second of virtual time each, round by round.
The load of the machine is in all alike, so ratios say more than times.
"""

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from forcebound.benchmark.figures import Measured, compare, judge, report
from forcebound.benchmark.workers import conditions
from forcebound.config.graph import GraphConfig
from forcebound.config.loader import load
from forcebound.launch.virtual import run_virtual

REAL_TIME_TARGETS: dict[str, float | None] = {
    "stiff_wall": 50.0,
    "three_axes": 30.0,
    "desktop_arm": None,
}
SECONDS, FEWEST = 0.2, 20  # of virtual time in a round; rounds


def run(duration: float, rate: float, progress: Callable[[str], None]) -> dict[str, Any]:
    """Run the benchmark; see :meth:`forcebound.benchmark.Benchmark.run`."""
    graphs = {name: _graph(name, rate) for name in REAL_TIME_TARGETS}
    measured = {name: Measured(f"tick, {name}") for name in graphs}
    for config in graphs.values():
        run_virtual(config, 0.1)  # compile
    began = time.perf_counter()
    rounds = 0
    while rounds < FEWEST or time.perf_counter() - began < duration:
        if rounds % FEWEST == 0:
            progress(f"round {rounds + 1}")
        rounds += 1
        for name, config in graphs.items():
            _round(config, measured[name])
    comparisons: dict[str, Any] = {}
    for name, target in REAL_TIME_TARGETS.items():
        speed = 1e9 / (measured[name].at("p50") * rate)
        what = f"times real time, {name}"
        comparisons[f"{name}_real_time"] = judge(what, speed, "times", target, at_least=True)
        if name != "stiff_wall":
            against = compare(measured[name], measured["stiff_wall"], "p50", None)
            comparisons[f"{name}_ratio"] = against
    surroundings = conditions() | {"a round": f"{SECONDS:g} s of virtual time of each"}
    return report("virtual", duration, rate, measured, comparisons, surroundings)


def _graph(name: str, rate: float) -> GraphConfig:
    config = load(name)
    device = config.device
    return replace(config, device=replace(device, servo=replace(device.servo, rate=rate)))


def _round(config: GraphConfig, measured: Measured) -> None:
    processor, began = time.process_time_ns(), time.perf_counter_ns()
    result = run_virtual(config, SECONDS)
    took = time.perf_counter_ns() - began
    ticks = SECONDS * config.device.servo.rate
    tick_ns = round(SECONDS * 1e9 / result.times_real_time / ticks)
    measured.add([tick_ns], 0, time.process_time_ns() - processor, took)
