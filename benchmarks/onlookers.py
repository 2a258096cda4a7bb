"""The commands that look at a running graph: lateness and loop delay of its servo with each.

In turns: nobody looks, then one command after the other does, its start and end included. The servo
must not notice.
"""

import subprocess
import sys
import tempfile
import time
from pathlib import Path

from benchmarks.harness import Result, note
from benchmarks.turns import ALONE, Graph, Turn, graph, servo

DURATION = 60.0
SECONDS = 3.0  # of each turn
COMMANDS = ("list --watch", "echo telemetry --json", "hz", "graph", "delay --links", "log")


def run(duration: float, rate: float) -> Result:
    """Run the benchmark, at the rate of the launch file."""
    turns = max(2, int(duration / SECONDS / (1 + len(COMMANDS))))
    with tempfile.TemporaryDirectory(prefix="fb-") as folder:
        record = Path(folder) / "run.mcap"
        words = ("stiff_wall", "--duration", "30min", "--record", str(record))
        with graph(folder, *words) as running:
            taken = [_turn(viewer, running) for _ in range(turns) for viewer in (ALONE, *COMMANDS)]
        return servo(record, taken)


def _turn(viewer: str, running: Graph) -> Turn:
    note(viewer)
    look = [sys.executable, "-m", "forcebound", *viewer.split(), "--duration", f"{SECONDS} s"]
    begin_ns = time.monotonic_ns()
    if viewer == ALONE:
        running.run_for(SECONDS)
    else:
        subprocess.run(look, env=running.variables, stdout=subprocess.DEVNULL, check=True)
    return Turn(viewer, begin_ns, time.monotonic_ns())
