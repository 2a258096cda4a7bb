"""Observation of a running graph from outside, for ``forcebound doctor``.

Each process is asked twice, with about two seconds of telemetry between, so that rates are known
besides counts. Nothing here judges; that is :mod:`forcebound.observe.doctor`.
"""

import os
import shutil
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Generic, TypeVar

from forcebound import realtime
from forcebound.errors import ConfigError
from forcebound.graph.graph import GraphConfig
from forcebound.messages.control import ProcessStatus
from forcebound.messages.topology import HAND, Graph, node_name
from forcebound.observe.delay import watch
from forcebound.observe.runs import running, while_running
from forcebound.observe.snapshot import UNKNOWN, Process, snapshot
from forcebound.observe.tuning import configuration
from forcebound.recordings.telemetry import TelemetryColumns
from forcebound.run.run_directory import RunDocument

DURATION = 2.0  # s between the two answers of a process

SUSPENDED = ("T", "t")  # states in /proc/PID/stat: stopped by a signal, or by a debugger

S = TypeVar("S", bound=ProcessStatus)


@dataclass(frozen=True)
class Seen(Generic[S]):
    """One process of a graph, asked twice."""

    state: str = UNKNOWN  # as its launcher says, see docs/protocol.md
    pid: int | None = None
    restarts: int = 0
    kernel_state: str = ""  # its letter in /proc/PID/stat; empty: not known
    first: S | None = None  # its status at the beginning; None: no answer
    last: S | None = None  # that at the end
    interval: float = DURATION  # between the two, in s

    def growth(self, count: Callable[[S], int]) -> int:
        """Return by how much a count of the status has grown between the answers.

        A count that fell is that of a process that was restarted: it has grown from 0.
        """
        first, last = (0 if one is None else count(one) for one in (self.first, self.last))
        return last - first if last >= first else last

    def rate(self, count: Callable[[S], int]) -> float:
        """Return the growth of a count, in 1/s."""
        return self.growth(count) / self.interval

    def rate_of(self, topic: str) -> float:
        """Return how often packets of a topic came, in 1/s."""
        return self.received(topic) / self.interval

    def received(self, topic: str) -> int:
        """Return how many packets of a topic came between the answers."""
        return self.growth(lambda status: status.received.get(topic, 0))


@dataclass(frozen=True)
class RecordingSeen:
    """The file that a graph records to."""

    path: str = ""
    rate: float = 0.0  # how fast it grows, in B/s
    free: int | None = None  # room left on its disk, in B; None: not known


@dataclass(frozen=True)
class Observations:
    """One hand's part of a running graph, and what belongs to all, as seen from outside."""

    config: GraphConfig  # what it runs with now
    graph: Graph  # with this hand alone
    processes: Mapping[str, Seen[Any]]  # by name: its launcher runs them, or they have control
    telemetry: TelemetryColumns  # of some seconds; empty if none came
    phase: str | None = None  # of the run, as its launcher says; None: no launcher answers
    launcher: Seen[Any] | None = None  # None: an environment by itself
    recording: RecordingSeen = field(default_factory=RecordingSeen)
    core: int | None = None  # that the chain of nodes shares; None: any
    cores: int = 1  # how many may be used
    load: float = 0.0  # mean number of processes that were ready to run in the last minute
    hand: str = HAND  # its name
    neighbours: tuple[str, ...] = ()  # this user's other graphs under SCHED_FIFO on the same core

    def name(self, role: str) -> str:
        """Return the name of the hand's process with a role, also of one on another machine."""
        return node_name(self.hand, role)

    def process(self, name: str) -> Seen[Any]:
        """Return a process of this machine; one that is not here answers nothing."""
        return self.processes.get(name, Seen())

    def of(self, kind: type[S]) -> Seen[S]:
        """Return the process that reports this kind of status; one without answers if none does."""
        return next((one for one in self.processes.values() if isinstance(one.last, kind)), Seen())


def observe(run_dir: Path, duration: float = DURATION) -> list[Observations]:
    """Look at a running graph for ``duration`` s; return what is seen of each hand.

    Raises:
        ConfigError: If no graph runs there.
        RunError: If the graph has ended.
    """
    cores = os.sched_getaffinity(0)
    core = RunDocument.read(run_dir).core
    with while_running(run_dir), realtime.on_cores(cores - {core}):  # looking must not disturb
        return [replace(one, cores=len(cores)) for one in _look(run_dir, duration)]


def _look(run_dir: Path, duration: float) -> Iterator[Observations]:
    start = time.monotonic()
    first = snapshot(run_dir)
    size = _size(first.run.record)
    telemetry = watch(run_dir, duration, first.run.graph.hands)
    interval = time.monotonic() - start
    last = snapshot(run_dir)
    run, nobody = last.run, Process(UNKNOWN)

    def seen(now: Process, then: Process) -> Seen[Any]:
        kernel_state = "" if now.use is None else now.use.kernel_state
        answers = then.answer, now.answer
        return Seen(now.state, now.pid, now.restarts, kernel_state, *answers, interval)

    config = configuration(run_dir, with_code=False)
    launcher = None if last.launcher is None else seen(last.launcher, nobody)
    rate, free = max(0, _size(run.record) - size) / interval, _free(run.record)
    load, neighbours = os.getloadavg()[0], _neighbours(run_dir, run.core)
    none = TelemetryColumns.from_packets([])
    for hand in run.graph.hands or config.hands:  # an environment alone serves hands elsewhere
        graph = run.graph.of(hand)
        yield Observations(
            config=config.of(hand),
            graph=graph,
            launcher=launcher,
            processes={
                name: seen(process, first.processes.get(name, nobody))
                for name, process in last.processes.items()
                if name in graph.nodes
            },
            telemetry=telemetry.get(hand, none),
            phase=last.phase,
            recording=RecordingSeen(run.record, rate, free),
            core=run.core,
            load=load,
            hand=hand,
            neighbours=neighbours,
        )


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
    """Return the other graphs that use this core under SCHED_FIFO."""
    if core is None:
        return ()
    found = []
    for other in (path for path, run in running().items() if path != run_dir and run.core == core):
        with suppress(ConfigError):  # it ended just now
            if configuration(other, with_code=False).realtime.policy == "fifo":
                found.append(str(other))
    return tuple(found)
