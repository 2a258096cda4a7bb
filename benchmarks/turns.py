"""Lateness and loop delay of a running graph in turns: nobody looks, or somebody does."""

import os
import signal
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from benchmarks.harness import Figure, Measured, Result, compare
from forcebound.errors import RunError
from forcebound.monitor.measure import Round
from forcebound.recording import read

END_TIMEOUT_S = 120.0
ALONE = "nobody"
TARGET = 1.05  # times that of a turn in which nobody looks


class Turn(NamedTuple):
    """A part of a run: who looks, and when, in ns of the monotonic clock."""

    viewers: str
    begin_ns: int
    end_ns: int


@dataclass(frozen=True)
class Graph:
    """A running graph.

    Attributes:
        launcher: Its process.
        variables: Of the environment, for commands that look at it.
        address: Of its page; who has it may change the graph. Empty: there is no page.
    """

    launcher: "subprocess.Popen[Any]"
    variables: Mapping[str, str]
    address: str = ""

    @property
    def run_dir(self) -> Path:
        """Its run directory: others may run graphs here, too."""
        [found] = Path(self.variables["XDG_RUNTIME_DIR"]).glob("forcebound-*")
        return found

    def run_for(self, seconds: float) -> None:
        """Let it run for a time.

        Raises:
            RunError: If it ends before.
        """
        try:
            self.launcher.wait(seconds)
        except subprocess.TimeoutExpired:
            return
        raise RunError(f"the graph has ended, status {self.launcher.returncode}")


@contextmanager
def graph(folder: str, *words: str) -> Iterator[Graph]:
    """Run ``forcebound launch`` with ``words``, from the first force on."""
    variables = {**os.environ, "XDG_RUNTIME_DIR": folder}
    running = subprocess.Popen(
        [sys.executable, "-u", "-m", "forcebound", "launch", *words],
        env=variables,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert running.stderr is not None
    try:
        next(line for line in running.stderr if "ramping force up" in line)
        yield Graph(running, variables)
    finally:
        running.send_signal(signal.SIGINT)
        running.communicate(timeout=END_TIMEOUT_S)


def lateness(time_ns: Any, period_ns: float) -> Any:
    """Return how much later than the earliest of its turn each write is in its period, in ns."""
    angle = 2.0 * np.pi * (((time_ns - time_ns[0]) / period_ns) % 1.0)
    middle = np.angle(np.exp(1j * angle).mean())
    phase = np.angle(np.exp(1j * (angle - middle))) / (2.0 * np.pi) * period_ns
    return phase - np.percentile(phase, 1)


def servo(record: Path, turns: Sequence[Turn]) -> Result:
    """Return lateness of the writes and loop delay in each kind of turn, against nobody's."""
    recording = read(record)
    columns, period_ns = recording.telemetry, 1e9 / recording.launch["device"]["rate"]
    found: dict[tuple[str, str], Measured] = {}
    for viewers, begin_ns, end_ns in turns:
        here = (columns.time_ns >= begin_ns) & (columns.time_ns < end_ns)
        delay = columns.loop_delay[here]
        measured = {
            "lateness": lateness(columns.time_ns[here], period_ns),
            "loop delay": delay[np.isfinite(delay)] * 1e9,
        }
        for name, values in measured.items():
            one = found.setdefault((name, viewers), Measured(f"{name}, {viewers}"))
            one.rounds.append(Round(values.astype(int).tolist()))
    figures: list[Figure] = [
        compare(one, found[name, ALONE], share, TARGET)
        for (name, viewers), one in found.items()
        for share in ("p50", "p99")
        if viewers != ALONE
    ]
    return list(found.values()), figures
