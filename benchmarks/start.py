"""Time from the start of `forcebound launch stiff_wall` to the first force.

Read from the event of its recording at which the device had its first answer and let the force
engage. The first start may compile; it does not count.
"""

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from benchmarks.harness import Result, alternate, at
from forcebound.observe.measure import Round, Timing
from forcebound.run.results import RunResult

DURATION = 10.0
ASKED = "`forcebound launch stiff_wall` until the first force"
# Modules are compiled once, not again in each process.
AS_INSTALLED = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}


def run(duration: float, rate: float) -> Result:
    """Run the benchmark, once a second of ``duration``."""
    _start((0, 0))
    (found,) = alternate(duration, rate, {"start to force": _start})
    return [found], [at(found, "p50", 1.5e6, is_shown=True)]


def _start(_: Timing) -> Round:
    with tempfile.TemporaryDirectory(prefix="fb-") as folder:
        recording = Path(folder) / "run.mcap"
        words = ["launch", "stiff_wall", "--duration", "1s", "--record", str(recording)]
        began_ns = time.monotonic_ns()
        command = [sys.executable, "-m", "forcebound", *words]
        subprocess.run(command, check=True, capture_output=True, env=AS_INSTALLED)
        events = RunResult.from_recording(recording).events
    return Round([next(e.time_ns for e in events if e.event == "force_engages") - began_ns])
