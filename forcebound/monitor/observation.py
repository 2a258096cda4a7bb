"""Observation of a running graph from outside, for ``forcebound doctor``.

Each process is asked twice, with about two seconds of telemetry between, so that rates are known
besides counts. Nothing here judges; that is :mod:`forcebound.monitor.doctor`.
"""

import os
import shutil
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from forcebound import realtime
from forcebound.config.graph import GraphConfig
from forcebound.errors import ConfigError, RunError
from forcebound.launch.run_directory import RunDocument
from forcebound.monitor.control import statuses
from forcebound.monitor.delay import watch
from forcebound.monitor.nodes import UNKNOWN
from forcebound.monitor.runs import running, while_running
from forcebound.monitor.tuning import configuration
from forcebound.processes import LAUNCHER, PROCESSES
from forcebound.telemetry import TelemetryColumns

DURATION = 2.0  # s between the two answers of a process

SUSPENDED = ("T", "t")  # states in /proc/PID/stat: stopped by a signal, or by a debugger


@dataclass(frozen=True)
class ProcessSeen:
    """One process of a graph."""

    state: str = UNKNOWN  # as its launcher says, see docs/protocol.md
    pid: int | None = None
    restarts: int = 0
    kernel_state: str = ""  # its letter in /proc/PID/stat; empty: not known
    first: Mapping[str, Any] | None = None  # its status at the beginning; None: no answer
    last: Mapping[str, Any] | None = None  # that at the end
    interval: float = DURATION  # between the two, in s

    @property
    def answers(self) -> bool:
        """Whether it answered at the end."""
        return self.last is not None

    def status(self, *path: str) -> Any:
        """Return an entry of the last status; None if there is none."""
        return _entry(self.last, path)

    def growth(self, *path: str) -> int:
        """Return by how much a count of the status has grown between the answers.

        A missing count is 0. A count that fell is that of a process that was restarted: it has
        grown from 0.
        """
        first, last = (int(_entry(status, path) or 0) for status in (self.first, self.last))
        return last - first if last >= first else last

    def rate(self, *path: str) -> float:
        """Return the growth of a count, in 1/s."""
        return self.growth(*path) / self.interval


@dataclass(frozen=True)
class RecordingSeen:
    """The file that a graph records to."""

    path: str = ""
    rate: float = 0.0  # how fast it grows, in B/s
    free: int | None = None  # room left on its disk, in B; None: not known


@dataclass(frozen=True)
class Observations:
    """A running graph, as seen from outside."""

    config: GraphConfig  # what it runs with now
    processes: Mapping[str, ProcessSeen]  # by name: its launcher runs them, or they have control
    telemetry: TelemetryColumns  # of some seconds; empty if none came
    phase: str | None = None  # of the run, as its launcher says; None: no launcher answers
    launcher: ProcessSeen | None = None  # None: an environment by itself
    recording: RecordingSeen = field(default_factory=RecordingSeen)
    core: int | None = None  # that the chain of nodes shares; None: any
    cores: int = 1  # how many may be used
    load: float = 0.0  # mean number of processes that wanted to run in the last minute
    neighbours: tuple[str, ...] = ()  # this user's other graphs under SCHED_FIFO on the same core

    def process(self, name: str) -> ProcessSeen:
        """Return a process of this machine; one that is not here answers nothing."""
        return self.processes.get(name, ProcessSeen())


def observe(run_dir: Path, duration: float = DURATION) -> Observations:
    """Look at a running graph for ``duration`` s.

    Raises:
        ConfigError: If the run directory does not say what runs.
        RunError: If the graph ended meanwhile.
    """
    with while_running(run_dir):
        run = RunDocument.read(run_dir)
        cores = realtime.leave_core(run.core)  # looking must not disturb
        try:
            seen = _look(run_dir, run, duration)
        finally:
            os.sched_setaffinity(0, cores)
        RunDocument.read(run_dir)  # it still runs
        return replace(seen, cores=len(cores))


def _look(run_dir: Path, run: RunDocument, duration: float) -> Observations:
    size, start = _size(run.record), time.monotonic()
    first = statuses(run_dir, (*PROCESSES, LAUNCHER))
    try:
        telemetry = watch(run_dir, duration)
    except RunError:  # none came
        telemetry = TelemetryColumns.from_packets([])
    interval = time.monotonic() - start
    last = statuses(run_dir, (*PROCESSES, LAUNCHER))
    growth = _size(run.record) - size
    launched = last.get(LAUNCHER) or {}
    nodes: Mapping[str, Mapping[str, Any]] = launched.get("nodes", {})
    known = {name: nodes.get(name, {}) for name in PROCESSES if name in nodes or name in last}
    if LAUNCHER in last:
        known[LAUNCHER] = {"pid": run.launcher, "state": "running"}
    processes = {
        name: ProcessSeen(
            state=process.get("state", UNKNOWN),
            pid=process.get("pid"),
            restarts=process.get("restarts", 0),
            kernel_state=_kernel_state(process.get("pid")),
            first=first.get(name),
            last=last.get(name),
            interval=interval,
        )
        for name, process in known.items()
    }
    return Observations(
        config=configuration(run_dir, with_code=False),
        launcher=processes.pop(LAUNCHER, None),
        processes=processes,
        telemetry=telemetry,
        phase=launched.get("phase"),
        recording=RecordingSeen(run.record, max(0, growth) / interval, _free(run.record)),
        core=run.core,
        load=os.getloadavg()[0],
        neighbours=_neighbours(run_dir, run.core),
    )


def _kernel_state(pid: int | None) -> str:
    if pid is None:
        return ""
    try:
        stat = Path(f"/proc/{pid}/stat").read_text(errors="replace")
    except OSError:
        return ""
    return stat.rpartition(")")[2].split()[0]  # the name before it may hold anything


def _size(path: str) -> int:
    try:
        return os.stat(path).st_size
    except OSError:
        return 0


def _free(path: str) -> int | None:
    try:
        return shutil.disk_usage(Path(path).parent).free
    except OSError:
        return None


def _neighbours(run_dir: Path, core: int | None) -> tuple[str, ...]:
    """Return the other graphs that want this core for themselves."""
    if core is None:
        return ()
    found = []
    for other in (path for path, run in running().items() if path != run_dir and run.core == core):
        with suppress(ConfigError):  # it ended just now
            if configuration(other, with_code=False).realtime.policy == "fifo":
                found.append(str(other))
    return tuple(found)


def _entry(status: Mapping[str, Any] | None, path: tuple[str, ...]) -> Any:
    entry: Any = status
    for name in path:
        entry = entry.get(name) if isinstance(entry, Mapping) else None
    return entry
