"""Time from the start of ``forcebound launch`` to the first force, in s.

::

    python benchmarks/start.py [ROUNDS]

Each round starts a graph and reads from its recording when the device got its first answer and let
the force engage. Events carry the machine's monotonic clock, as the time of the start does. The
first round may compile; it does not count.
"""

import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from forcebound.launch.results import RunResult

LAUNCH_FILE = "stiff_wall"

# Modules are compiled once, not again in each process.
AS_INSTALLED = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}


def seconds_to_force(folder: Path) -> float:
    """Start a graph once; return the time until the force engages, in s."""
    recording = folder / "run.mcap"
    words = ["launch", LAUNCH_FILE, "--duration", "0.2s", "--record", str(recording), "--overwrite"]
    began_ns = time.monotonic_ns()
    command = [sys.executable, "-m", "forcebound", *words]
    subprocess.run(command, check=True, capture_output=True, env=AS_INSTALLED)
    events = RunResult.from_recording(recording).events
    return (next(e.time_ns for e in events if e.event == "force_engages") - began_ns) * 1e-9


def main(rounds: int) -> None:
    """Print the median and the range of some rounds."""
    with tempfile.TemporaryDirectory() as folder:
        _, *times = [seconds_to_force(Path(folder)) for _ in range(rounds + 1)]
    median = statistics.median(times)
    sys.stdout.write(
        f"start to force: median {median:.2f} s, {min(times):.2f} to {max(times):.2f} s\n"
    )


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 5)
