"""What coverage measures of what takes long: of runs their begin, of compilation nothing.

Tracing takes two thirds of the time of a run in virtual time, whose ticks are all alike, and nearly
half of that of numba, which is written in Python.
"""

import sys
from collections.abc import Callable
from functools import cache, partial
from typing import Any

import pytest

from forcebound import compiled
from forcebound.run.simulation import Simulation

MEASURED_NS = 300_000_000  # virtual time


def measure_begins_of_runs(patch: pytest.MonkeyPatch) -> None:
    """Let nobody trace a run after its begin; what it does stays the same."""
    run = Simulation.run

    def run_measured_at_first(self: Simulation, until_ns: int) -> None:
        if self.time_ns < MEASURED_NS:
            run(self, min(until_ns, MEASURED_NS))
        _untraced(run, self, until_ns)

    patch.setattr(Simulation, "run", run_measured_at_first)


def measure_no_compilation(patch: pytest.MonkeyPatch) -> None:
    """Let nobody trace numba while it compiles a kernel."""
    make = compiled._compiled

    @cache
    def make_compiled_untraced(function: Callable[..., Any], parallel: bool, fast: bool) -> Any:
        kernel = make(function, parallel, fast)
        kernel.compile = partial(_untraced, kernel.compile)
        return kernel

    patch.setattr(compiled, "_compiled", make_compiled_untraced)


def _untraced(function: Callable[..., Any], *arguments: Any) -> Any:
    tracer = sys.gettrace()
    sys.settrace(None)
    try:
        return function(*arguments)
    finally:
        sys.settrace(tracer)
        _call()


def _call() -> None:
    """From the next call on, coverage's tracer sees again how all frames end, as it must."""
