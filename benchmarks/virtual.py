"""The graph in virtual time: ticks with one axis, with three, and with an arm in joint space."""

import time
from dataclasses import replace
from functools import partial

from benchmarks.harness import Figure, Result, alternate, compare
from forcebound.graph.graph import GraphConfig
from forcebound.graph.loader import load
from forcebound.observe.measure import Round, Timing
from forcebound.run.virtual import run_virtual

DURATION = 12.0
ASKED = "graph in virtual time: `forcebound simulate stiff_wall`"
TARGETS = {"stiff_wall": 50.0, "three_axes": 30.0, "desktop_arm": None}  # times real time
SECONDS = 0.2  # of virtual time in a run


def run(duration: float, rate: float) -> Result:
    """Run the benchmark."""
    graphs = {name: _graph(name, rate) for name in TARGETS}
    for config in graphs.values():
        run_virtual(config, 0.1)  # compile
    contestants = {name: partial(_ticks, config) for name, config in graphs.items()}
    found = alternate(duration, rate, contestants)
    speeds = [
        Figure(f"times real time, {one.label}", 1e9 / (one.at("p50") * rate), "", target, True)
        for one, target in zip(found, TARGETS.values(), strict=True)
    ]
    speeds[0] = speeds[0]._replace(shown="real time")
    return found, speeds + [compare(one, found[0]) for one in found[1:]]


def _graph(name: str, rate: float) -> GraphConfig:
    config = load(name)
    servo = replace(config.only.servo, rate=rate)
    return config.with_hand(servo=servo)


def _ticks(config: GraphConfig, timing: Timing) -> Round:
    """Return the mean time of a tick in each run, for as long as the round is."""
    end, times_ns = time.monotonic() + timing[0] * timing[1] * 1e-9, list[int]()
    while not times_ns or time.monotonic() < end:
        times_real_time = run_virtual(config, SECONDS).times_real_time
        assert times_real_time is not None
        times_ns.append(round(timing[0] / times_real_time))
    return Round(times_ns)
