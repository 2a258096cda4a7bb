"""What runs on this machine: graphs, their processes, and what those use."""

import os
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from forcebound.errors import ConfigError, RunError
from forcebound.launch.run_directory import RunDocument
from forcebound.monitor.control import statuses
from forcebound.monitor.nodes import UNKNOWN
from forcebound.monitor.runs import running
from forcebound.network import sockets
from forcebound.processes import LAUNCHER, PROCESSES

INTERVAL = 0.5  # s, over which the use of the processor is taken
SILENT = "silent"  # nothing answers: it computes its result after the end, or is suspended
_TICKS = os.sysconf("SC_CLK_TCK")
_PAGE = os.sysconf("SC_PAGE_SIZE")


@dataclass(frozen=True)
class Listed:
    """One process of a graph.

    Attributes:
        node: Its name in the graph.
        state: As its launcher says (docs/protocol.md).
        pid: None: it does not run.
        processor: Share of one processor, 1 is all of it; None: not known.
        memory: In B, that no other process shares may be less; None: not known.
        restarts: How often it was started again.
        steps: Of its node since its start; None: not known, or it is none.
    """

    node: str
    state: str
    pid: int | None
    processor: float | None
    memory: int | None
    restarts: int
    steps: int | None


@dataclass(frozen=True)
class ListedGraph:
    """One graph of this user on this machine."""

    name: str  # launch file with its arguments
    run_dir: Path
    phase: str | None  # of the run; SILENT; None: an environment by itself
    core: int | None  # that its nodes share; None: any
    processes: tuple[Listed, ...]


def list_graphs(interval: float = INTERVAL, only: Path | None = None) -> list[ListedGraph]:
    """Return the graphs that run, with what their processes use over ``interval`` s.

    Args:
        interval: Between two looks at the processes.
        only: Run directory of the only graph to list; None: all.
    """
    known: dict[Path, tuple[RunDocument, str | None, dict[str, dict[str, Any]]]] = {}
    for run_dir in running() if only is None else (only,):
        with suppress(ConfigError, RunError, OSError):  # it has ended
            run = RunDocument.read(run_dir)
            known[run_dir] = (run, *_processes(run_dir, run))
    pids = {p["pid"] for _, _, nodes in known.values() for p in nodes.values() if p.get("pid")}
    before, start = {pid: processor_time(pid) for pid in pids}, time.monotonic()
    sockets.wait((), round(interval * 1e9))
    elapsed = time.monotonic() - start
    share = {pid: _share(before[pid], processor_time(pid), elapsed) for pid in pids}
    return [
        ListedGraph(
            run.file,
            run_dir,
            phase,
            run.core,
            tuple(_listed(name, process, share) for name, process in nodes.items()),
        )
        for run_dir, (run, phase, nodes) in known.items()
    ]


def _listed(name: str, process: dict[str, Any], share: dict[int, float | None]) -> Listed:
    pid = process.get("pid")
    return Listed(
        name,
        str(process.get("state", UNKNOWN)),
        pid,
        None if pid is None else share[pid],
        None if pid is None else _memory(pid),
        int(process.get("restarts", 0)),
        process.get("steps"),
    )


def _processes(run_dir: Path, run: RunDocument) -> tuple[str | None, dict[str, dict[str, Any]]]:
    answers = statuses(run_dir, (*PROCESSES, LAUNCHER))
    launcher = answers.pop(LAUNCHER, None)
    if launcher is None:
        return None if any(answers.values()) else SILENT, {name: {} for name in answers}
    nodes: dict[str, dict[str, Any]] = {name: dict(one) for name, one in launcher["nodes"].items()}
    for name, answer in answers.items():
        if name in nodes and answer is not None:
            nodes[name]["steps"] = answer.get("steps")
    nodes[LAUNCHER] = {"pid": run.launcher, "state": "running"}
    return str(launcher["phase"]), nodes


def processor_time(pid: int) -> float | None:
    """Processor time that a process has used, in s; None: it has ended."""
    try:
        stat = Path(f"/proc/{pid}/stat").read_text(errors="replace")
    except OSError:
        return None
    fields = stat.rpartition(")")[2].split()  # the name before it may hold anything
    return (int(fields[11]) + int(fields[12])) / _TICKS


def _share(before: float | None, after: float | None, elapsed: float) -> float | None:
    return None if before is None or after is None else (after - before) / elapsed


def _memory(pid: int) -> int | None:
    try:
        return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * _PAGE
    except OSError:
        return None
