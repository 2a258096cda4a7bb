"""Lateness and loop delay of a servo in turns: alone, and while somebody looks."""

import os
import signal
import statistics
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from forcebound.recording import read

PATIENCE = 60.0  # s
ALONE = "nobody"
TARGET_SHARE = 0.05  # more that a figure may be while somebody looks

Figures = Mapping[str, Mapping[str, float]]


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
            RuntimeError: If it ends meanwhile.
        """
        try:
            self.launcher.wait(seconds)
        except subprocess.TimeoutExpired:
            return
        raise RuntimeError(f"the graph has ended, status {self.launcher.returncode}")


@contextmanager
def graph(folder: str, record: Path) -> Iterator[Graph]:
    """Run a graph, and record it, from the first force on."""
    variables = {**os.environ, "XDG_RUNTIME_DIR": folder}
    words = ["launch", "stiff_wall", "--duration", "30min", "--record", str(record)]
    running = subprocess.Popen(
        [sys.executable, "-u", "-m", "forcebound", *words],
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
        running.communicate(timeout=PATIENCE)


def lateness(time_ns: Any, period_ns: float) -> Any:
    """Return how much later than the earliest of its turn each write is in its period, in us."""
    angle = 2.0 * np.pi * (((time_ns - time_ns[0]) / period_ns) % 1.0)
    middle = np.angle(np.exp(1j * angle).mean())
    phase = np.angle(np.exp(1j * (angle - middle))) / (2.0 * np.pi) * period_ns / 1e3
    return phase - np.percentile(phase, 1)


def servo(record: Path, turns: Sequence[Turn]) -> Figures:
    """Return the median over the turns of each kind, in us, by figure and kind of turn."""
    recording = read(record)
    columns, period_ns = recording.telemetry, 1e9 / recording.launch["device"]["rate"]
    found: dict[str, dict[str, list[float]]] = {}
    for viewers, begin_ns, end_ns in turns:
        here = (columns.time_ns >= begin_ns) & (columns.time_ns < end_ns)
        delay = columns.loop_delay[here]
        measured = {
            "lateness of the write": lateness(columns.time_ns[here], period_ns),
            "loop delay": delay[np.isfinite(delay)] * 1e6,
        }
        for name, values in measured.items():
            for share in (50, 99):
                kinds = found.setdefault(f"{name}, p{share}", {})
                kinds.setdefault(viewers, []).append(float(np.percentile(values, share)))
    return {
        name: {viewers: statistics.median(values) for viewers, values in kinds.items()}
        for name, kinds in found.items()
    }


def told(figures: Figures) -> Iterator[str]:
    """Give a line for each figure, with the change that each viewer makes."""
    for name, of in figures.items():
        alone = of[ALONE]
        changes = "".join(
            f"; {value:.1f} us ({value / alone - 1.0:+.1%}) with {viewers}"
            for viewers, value in of.items()
            if viewers != ALONE
        )
        yield f"{name}: {alone:.1f} us{changes} (target {TARGET_SHARE:.0%})"
