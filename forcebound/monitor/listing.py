"""What runs on this machine: graphs, their processes, and what those use."""

import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from forcebound.errors import ConfigError, RunError
from forcebound.messages.control import NodeStatus, ProcessState
from forcebound.monitor.runs import running
from forcebound.monitor.snapshot import GraphStatus, Use, snapshot, use_of
from forcebound.network import sockets
from forcebound.roles import LAUNCHER

INTERVAL = 0.5  # s, over which the use of the processor is taken
SILENT = "silent"  # nothing answers: it computes its result after the end, or is suspended


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
    graphs: list[tuple[GraphStatus, dict[str, ProcessState]]] = []
    for run_dir in running() if only is None else (only,):
        with suppress(ConfigError, RunError, OSError):  # it has ended
            graph = snapshot(run_dir)
            launcher = {LAUNCHER: ProcessState("running", graph.run.launcher)}
            graphs.append((graph, graph.processes | (launcher if graph.launcher else {})))
    pids = {process.pid for _, processes in graphs for process in processes.values()}
    before, start = {pid: use_of(pid) for pid in pids}, time.monotonic()
    sockets.wait((), round(interval * 1e9))
    elapsed = time.monotonic() - start

    def listed(name: str, process: ProcessState, graph: GraphStatus) -> Listed:
        then, now = before[process.pid], use_of(process.pid)
        status = graph.answers.get(name)
        return Listed(
            name,
            process.state,
            process.pid,
            _share(then, now, elapsed),
            None if now is None else now.memory,
            process.restarts,
            status.steps if isinstance(status, NodeStatus) else None,
        )

    return [
        ListedGraph(
            graph.run.file,
            graph.run_dir,
            _phase(graph),
            graph.run.core,
            tuple(listed(name, process, graph) for name, process in processes.items()),
        )
        for graph, processes in graphs
    ]


def _phase(graph: GraphStatus) -> str | None:
    if graph.launcher is not None:
        return graph.launcher.phase
    return None if graph.answers else SILENT


def _share(then: Use | None, now: Use | None, elapsed: float) -> float | None:
    if then is None or now is None:
        return None
    return (now.processor_time - then.processor_time) / elapsed
