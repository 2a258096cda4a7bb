"""What coverage measures of long runs: their begin.

Tracing takes two thirds of the time of a run in virtual time, whose ticks are all alike.
"""

import sys

import pytest

from forcebound.simulation import Simulation

MEASURED_NS = 300_000_000  # virtual time


def measure_begins_of_runs(patch: pytest.MonkeyPatch) -> None:
    """Let nobody trace a run after its begin; what it does stays the same."""
    run = Simulation.run

    def run_measured_at_first(self: Simulation, until_ns: int) -> None:
        if self.time_ns < MEASURED_NS:
            run(self, min(until_ns, MEASURED_NS))
        tracer = sys.gettrace()
        sys.settrace(None)
        try:
            run(self, until_ns)
        finally:
            sys.settrace(tracer)
            _call()

    patch.setattr(Simulation, "run", run_measured_at_first)


def _call() -> None:
    """From the next call on, coverage's tracer sees again how all frames end, as it must."""
