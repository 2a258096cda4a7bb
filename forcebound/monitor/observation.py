"""What can be seen of a running graph from outside: the material of ``forcebound doctor``.

Each process is asked twice, with about two seconds of telemetry between, so that rates are known
besides counts. Nothing here judges; that is :mod:`forcebound.monitor.doctor`.
"""

import os
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from forcebound import realtime
from forcebound.config.graph import GraphConfig
from forcebound.errors import ConfigError, RunError
from forcebound.launch.live import RunDocument
from forcebound.monitor.control import PATIENCE, ask_all
from forcebound.monitor.delay import watch
from forcebound.monitor.nodes import UNKNOWN
from forcebound.monitor.runs import running
from forcebound.monitor.tuning import configuration
from forcebound.process import has_control
from forcebound.processes import LAUNCHER, PROCESSES
from forcebound.telemetry import TelemetryColumns

DURATION = 2.0  # s between the two answers of a process

SUSPENDED = ("T", "t")  # states in /proc/PID/stat: stopped by a signal, or by a debugger

_STATUS = {"request": "status"}


@dataclass(frozen=True)
class ProcessSeen:
    """One process of a graph.

    Attributes:
        state: What the launcher says of it, see ``docs/protocol.md``; or :data:`UNKNOWN`.
        pid: Its process id, if it is known.
        restarts: How often it was started anew.
        kernel_state: Its letter in ``/proc/PID/stat``; empty if it is not known.
        first: Its status, at first; None: no answer.
        last: Its status at the end; None: no answer.
        interval: Time between the two, in s.
    """

    state: str = UNKNOWN
    pid: int | None = None
    restarts: int = 0
    kernel_state: str = ""
    first: Mapping[str, Any] | None = None
    last: Mapping[str, Any] | None = None
    interval: float = DURATION

    @property
    def answers(self) -> bool:
        """Whether it answered when it was asked last."""
        return self.last is not None

    def status(self, *path: str) -> Any:
        """Return an entry of the last status; None if there is none."""
        return _entry(self.last, path)

    def growth(self, *path: str) -> int:
        """Return by how much a count of the status has grown between the answers.

        A count that is missing is 0. One that fell is that of a process that was started anew, and
        has grown from 0.
        """
        first, last = (int(_entry(status, path) or 0) for status in (self.first, self.last))
        return last - first if last >= first else last

    def rate(self, *path: str) -> float:
        """Return the growth of a count, in 1/s."""
        return self.growth(*path) / self.interval


@dataclass(frozen=True)
class RecordingSeen:
    """The file that a graph records to.

    Attributes:
        path: Where it is.
        rate: How fast it grows, in B/s.
        free: Room that is left on its disk, in B; None if that cannot be said.
    """

    path: str = ""
    rate: float = 0.0
    free: int | None = None


@dataclass(frozen=True)
class Observations:
    """A graph that runs, as seen from outside.

    Attributes:
        config: What it runs with now.
        processes: By name: those that its launcher runs, or that have a control socket.
        telemetry: Of some seconds; empty if none came.
        phase: Of the run, as its launcher says; None: no launcher answers.
        launcher: The launcher; None: the nodes were started by hand.
        recording: Where it records to.
        core: That the chain of nodes shares; None: any.
        cores: Number of cores that may be used.
        load: Mean number of processes that wanted to run in the last minute, on all cores.
        neighbours: Other graphs of this user, under SCHED_FIFO on the same core.
    """

    config: GraphConfig
    processes: Mapping[str, ProcessSeen]
    telemetry: TelemetryColumns
    phase: str | None = None
    launcher: ProcessSeen | None = None
    recording: RecordingSeen = field(default_factory=RecordingSeen)
    core: int | None = None
    cores: int = 1
    load: float = 0.0
    neighbours: tuple[str, ...] = ()


def observe(run_dir: Path, duration: float = DURATION) -> Observations:
    """Look at a running graph for some time.

    Args:
        run_dir: Of the run, as :func:`forcebound.monitor.runs.find` gives it.
        duration: How long, in s.

    Raises:
        ConfigError: If the run directory does not say what runs.
        RunError: If the graph ended meanwhile.
    """
    run = _read(run_dir)
    cores = realtime.stand_aside(run.core)  # who looks must not be the cause of what is seen
    try:
        names = [name for name in PROCESSES if has_control(run_dir, name)]
        size, first_time = _size(run.record), time.monotonic()
        first = ask_all(run_dir, [*names, LAUNCHER], _STATUS, PATIENCE)
        try:
            telemetry = watch(run_dir, duration)
        except RunError:
            telemetry = TelemetryColumns.from_packets([])
        except (OSError, ValueError):
            raise _ended(run_dir) from None
        interval = time.monotonic() - first_time
        names = [name for name in PROCESSES if has_control(run_dir, name)]
        last = ask_all(run_dir, [*names, LAUNCHER], _STATUS, PATIENCE)
        growth = _size(run.record) - size
    finally:
        os.sched_setaffinity(0, cores)
    _read(run_dir)  # it runs still
    told = last[LAUNCHER] or {}
    nodes: Mapping[str, Any] = told.get("nodes", {})
    processes = {
        name: _process(nodes.get(name, {}), first.get(name), last.get(name), interval)
        for name in PROCESSES
        if name in nodes or name in names
    }
    launcher = None
    if has_control(run_dir, LAUNCHER):
        seen = {"pid": run.launcher, "state": "running"}
        launcher = _process(seen, first[LAUNCHER], last[LAUNCHER], interval)
    return Observations(
        config=configuration(run_dir, serves=False),
        processes=processes,
        telemetry=telemetry,
        phase=told.get("phase"),
        launcher=launcher,
        recording=RecordingSeen(run.record, max(0, growth) / interval, _free(run.record)),
        core=run.core,
        cores=len(cores),
        load=os.getloadavg()[0],
        neighbours=_neighbours(run_dir, run.core),
    )


def _process(
    told: Mapping[str, Any],
    first: Mapping[str, Any] | None,
    last: Mapping[str, Any] | None,
    interval: float,
) -> ProcessSeen:
    pid = told.get("pid")
    return ProcessSeen(
        state=told.get("state", UNKNOWN),
        pid=pid,
        restarts=told.get("restarts", 0),
        kernel_state=_kernel_state(pid),
        first=first,
        last=last,
        interval=interval,
    )


def _read(run_dir: Path) -> RunDocument:
    try:
        return RunDocument.read(run_dir)
    except ConfigError:
        raise _ended(run_dir) from None


def _ended(run_dir: Path) -> RunError:
    return RunError(f"the graph in {run_dir} has ended meanwhile")


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
        disk = os.statvfs(Path(path).parent)
    except OSError:
        return None
    return disk.f_bavail * disk.f_frsize


def _neighbours(run_dir: Path, core: int | None) -> tuple[str, ...]:
    """Return the other graphs that want this core for themselves."""
    if core is None:
        return ()
    found = []
    for other in running():
        try:
            shares = other != run_dir and RunDocument.read(other).core == core
            if shares and configuration(other, serves=False).realtime.policy == "fifo":
                found.append(str(other))
        except ConfigError:
            continue  # it ended just now
    return tuple(found)


def _entry(status: Mapping[str, Any] | None, path: tuple[str, ...]) -> Any:
    entry: Any = status
    for name in path:
        entry = entry.get(name) if isinstance(entry, Mapping) else None
    return entry
