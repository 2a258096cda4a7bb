"""The harness of all benchmarks: contestants in turns, their figures, and their targets.

Each benchmark runs its reference in the same run, alternately: on a shared machine the same program
may be five times slower a minute later, but ratios of neighbouring rounds mean something.
"""

import os
import platform
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path
from typing import NamedTuple

from forcebound.errors import RunError
from forcebound.observe.measure import Round, Timing, percentile, plan
from forcebound.realtime import Settings, choose_core, permits_fifo

HERE = Path(__file__).parent
Contestant = Callable[[Timing], Round]


@dataclass
class Measured:
    """All rounds of one contestant, which ``label`` names in tables."""

    label: str
    rounds: list[Round] = field(default_factory=list)

    def at(self, share: str) -> float:
        """Return a percentile of all rounds together, in ns; see :func:`percentile`."""
        return percentile(self.rounds, share)

    @property
    def missed(self) -> int:
        """Instants of all rounds that were skipped, or had no answer in time."""
        return sum(one.missed for one in self.rounds)

    @property
    def processor_share(self) -> float | None:
        """Share of one processor that it used; None: not measured."""
        elapsed_ns = sum(one.elapsed_ns for one in self.rounds)
        return sum(one.processor_ns for one in self.rounds) / elapsed_ns if elapsed_ns else None


class Figure(NamedTuple):
    """A figure with its target; ``lowest`` and ``highest``: of two neighbouring rounds."""

    what: str
    value: float
    unit: str = ""
    target: float | None = None  # None: only for information
    at_least: bool = False  # whether a larger value is better
    lowest: float | None = None
    highest: float | None = None

    @property
    def reached(self) -> bool | None:
        """Whether the target is reached; None: there is none."""
        if self.target is None:
            return None
        return self.value >= self.target if self.at_least else self.value <= self.target


Result = tuple[list[Measured], list[Figure]]


def alternate(
    duration: float, rate: float, contestants: Mapping[str, Contestant], rounds: int | None = None
) -> list[Measured]:
    """Run contestants in turns, for ``duration`` s together; return them in their order.

    Args:
        duration: Without the start of the contestants.
        rate: Of their exchanges, in Hz.
        contestants: By label.
        rounds: Of each; None: about one a second.
    """
    number, timing = plan(duration, len(contestants), rate)
    found = [Measured(label) for label in contestants]
    for turn in range(rounds or number):
        for measured in found:
            note(f"round {turn + 1} of {rounds or number}: {measured.label}")
            measured.rounds.append(contestants[measured.label](timing))
    note("")
    return found


def compare(
    ours: Measured, other: Measured, share: str = "p50", target: float | None = None
) -> Figure:
    """Return the ratio of a percentile to that of a reference with as many rounds."""
    what = f"{ours.label} / {other.label}, {share.replace('_', '.')}"
    return _against(
        what,
        "",
        ours,
        other,
        target,
        lambda a, b: max(percentile(a, share), 1) / max(percentile(b, share), 1),
    )


def beyond(ours: Measured, base: Measured, share: str, target: float | None) -> Figure:
    """Return what a percentile is beyond the median of a baseline, in us."""
    what = f"{ours.label}, {share} beyond {base.label}"
    return _against(
        what,
        "us",
        ours,
        base,
        target,
        lambda a, b: (percentile(a, share) - percentile(b, "p50")) / 1e3,
    )


def _against(
    what: str,
    unit: str,
    ours: Measured,
    other: Measured,
    target: float | None,
    relation: Callable[[list[Round], list[Round]], float],
) -> Figure:
    pairs = zip(ours.rounds, other.rounds, strict=True)
    each = [relation([a], [b]) for a, b in pairs if a.times_ns and b.times_ns]
    value = relation(ours.rounds, other.rounds)
    return Figure(what, value, unit, target, lowest=min(each), highest=max(each))


def at(measured: Measured, share: str, target_us: float | None = None) -> Figure:
    """Return a percentile, in us."""
    what = f"{measured.label}, {share.replace('_', '.')}"
    return Figure(what, measured.at(share) / 1e3, "us", target_us)


def missed(measured: Measured, target: float | None = 0.0) -> Figure:
    """Return how many instants were missed."""
    return Figure(f"{measured.label}, missed", measured.missed, "ticks", target)


def timed(work: Callable[[], object]) -> int:
    """Return how long one call takes, in ns."""
    begun_ns = time.monotonic_ns()
    work()
    return time.monotonic_ns() - begun_ns


def note(text: str) -> None:
    """Show what is being measured, on a terminal."""
    if sys.stderr.isatty():
        sys.stderr.write(f"\r\x1b[K{text}")
        sys.stderr.flush()


def chain(policy: str = "") -> Settings:
    """Return the settings of a punctual process here: the core of the nodes, the best class."""
    best = "fifo" if permits_fifo() else "other"
    return Settings(policy=policy or best, core=choose_core("auto"))


def compiled(source: str, folder: str, name: str = "", *flags: str) -> Path:
    """Compile a C file of this folder and return the program or library.

    Raises:
        RunError: If there is no C compiler, or if it fails.
    """
    compiler = shutil.which("gcc") or shutil.which("cc") or shutil.which("clang")
    if compiler is None:
        raise RunError("no C compiler (gcc, cc, clang) on PATH; for example: apt install gcc")
    target = Path(folder) / (name or Path(source).stem)
    command = [compiler, "-O2", *flags, "-o", str(target), str(HERE / source), "-lm"]
    built = subprocess.run(command, capture_output=True, text=True)
    if built.returncode:
        raise RunError(f"{compiler} could not build {source}:\n{built.stderr.strip()}")
    return target


def conditions() -> dict[str, str]:
    """Return date, commit, machine, versions, permissions and load."""
    git = ["git", "-C", str(HERE), "describe", "--always", "--dirty", "--abbrev=12"]
    commit = subprocess.run(git, capture_output=True, text=True).stdout.strip()
    processor = next(
        (
            line.partition(": ")[2].strip()
            for line in Path("/proc/cpuinfo").read_text().splitlines()
            if line.startswith("model name")
        ),
        platform.machine(),
    )
    return {
        "date": datetime.now(UTC).date().isoformat(),
        "commit": commit or "unknown",
        "processor": f"{len(os.sched_getaffinity(0))} cores of {processor}",
        "kernel": f"{platform.system()} {platform.release()}",
        "scheduling": "SCHED_FIFO permitted" if permits_fifo() else "ordinary",
        "load average": f"{os.getloadavg()[0]:.2f}",
        "versions": f"Python {platform.python_version()}, pyzmq {metadata.version('pyzmq')}",
    }
