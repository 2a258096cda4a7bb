"""What runs on this machine: graphs, their processes, and what those use."""

import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from forcebound.errors import ConfigError, RunError
from forcebound.messages.control import NodeStatus
from forcebound.network import sockets
from forcebound.observe.runs import running
from forcebound.observe.snapshot import GraphStatus, Process, snapshot, use_of
from forcebound.roles import LAUNCHER

INTERVAL = 0.5  # s, over which the use of the processor is taken
SILENT = "silent"  # nothing answers: it computes its result after the end, or is suspended


@dataclass(frozen=True)
class Listed:
    """One process of a graph."""

    node: str  # its name in the graph
    state: str  # as its launcher says (docs/protocol.md)
    pid: int | None  # None: it does not run
    processor: float | None  # share of one, 1 is all of it; None: not known
    memory: int | None  # in B, that no other process shares may be less; None: not known
    restarts: int
    steps: int | None  # of its node since its start; None: not known, or it is none


@dataclass(frozen=True)
class ListedGraph:
    """One graph of this user on this machine."""

    name: str  # launch file with its arguments
    run_dir: Path
    phase: str | None  # of the run; SILENT; None: an environment by itself
    core: int | None  # that its nodes share; None: any
    processes: tuple[Listed, ...]


def list_graphs(interval: float = INTERVAL, only: Path | None = None) -> list[ListedGraph]:
    """Return the graphs that run, or ``only`` one, with what processes use over ``interval`` s."""
    graphs: list[GraphStatus] = []
    for run_dir in running() if only is None else (only,):
        with suppress(ConfigError, RunError, OSError):  # it has ended
            graphs.append(snapshot(run_dir))
    start = time.monotonic()
    sockets.wait((), round(interval * 1e9))
    return [_listed(graph, time.monotonic() - start) for graph in graphs]


def _listed(graph: GraphStatus, elapsed: float) -> ListedGraph:
    processes = graph.processes | ({} if graph.launcher is None else {LAUNCHER: graph.launcher})
    phase = graph.phase
    if phase is None and not any(one.answer for one in graph.processes.values()):
        phase = SILENT
    listed = tuple(_process(name, one, elapsed) for name, one in processes.items())
    return ListedGraph(graph.run.file, graph.run_dir, phase, graph.run.core, listed)


def _process(name: str, process: Process, elapsed: float) -> Listed:
    then, now = process.use, use_of(process.pid)
    share = None
    if then is not None and now is not None:
        share = (now.processor_time - then.processor_time) / elapsed
    steps = process.answer.steps if isinstance(process.answer, NodeStatus) else None
    memory = None if now is None else now.memory
    return Listed(name, process.state, process.pid, share, memory, process.restarts, steps)
