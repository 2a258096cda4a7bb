"""The state of a running graph: its processes, their answers, and what they use."""

import os
from pathlib import Path
from typing import NamedTuple, TypeVar

from msgspec import Struct

from forcebound.graph.graph import GraphConfig
from forcebound.messages.control import (
    Answer,
    ControllerStatus,
    EnvironmentStatus,
    GetStatus,
    LauncherStatus,
    ProcessState,
    ProcessStatus,
)
from forcebound.messages.topology import is_bound
from forcebound.observe.control import ask_all
from forcebound.roles import ENVIRONMENT, LAUNCHER
from forcebound.run.run_directory import RunDocument

STATUS_TIMEOUT = 1.0  # s; a node answers between two steps, so within milliseconds
UNKNOWN = "unknown"  # state of a process that no launcher watches, or whose launcher is silent

S = TypeVar("S", bound=ProcessStatus)


class Use(NamedTuple):
    """What a process uses of the machine."""

    kernel_state: str  # its letter in /proc/PID/stat
    processor_time: float  # s, since its start
    memory: int  # B; that no other process shares may be less


class Process(Struct, frozen=True):
    """A process of a running graph at one time."""

    state: str  # as its launcher says, see docs/protocol.md
    pid: int | None = None  # None: it does not run, or is not known
    restarts: int = 0
    answer: Answer | None = None  # to a request for its status; None: it gave none
    use: Use | None = None  # None: it does not run, or is not known


class GraphStatus(Struct, frozen=True):
    """A running graph at one time."""

    run_dir: Path
    run: RunDocument
    launcher: Process | None  # None: an environment by itself
    processes: dict[str, Process]  # that the launcher runs, or that have a control socket

    @property
    def phase(self) -> str | None:
        """The phase of the run; None: no launcher answers."""
        answer = None if self.launcher is None else self.launcher.answer
        return answer.phase if isinstance(answer, LauncherStatus) else None

    def status_of(self, kind: type[S]) -> S | None:
        """Return the status of the process that reports this kind; None: it does not answer."""
        answers = (process.answer for process in self.processes.values())
        return next((answer for answer in answers if isinstance(answer, kind)), None)

    def nodes_here(self, config: GraphConfig) -> frozenset[str]:
        """Return the nodes that belong to this machine, whether they run or not."""
        loop = frozenset(self.run.graph.loop)
        found = loop & self.processes.keys()
        if self.phase is not None:
            return found
        environment = {self.run.graph.of_role(ENVIRONMENT)}
        if not self.run.is_graph:
            return frozenset(environment)
        is_here = all(hand.remote is None for hand in config.hands.values())
        return loop if is_here else loop - (environment - found)


def snapshot(run_dir: Path) -> GraphStatus:
    """Return the state of a running graph.

    Raises:
        ConfigError: If no graph runs there.
    """
    run = RunDocument.read(run_dir)
    nodes = run.graph.nodes
    known = [name for name, node in nodes.items() if is_bound(run_dir, node)]
    answers = ask_all(run_dir, dict.fromkeys(known, GetStatus()), STATUS_TIMEOUT)
    status = answers.get(LAUNCHER)
    states = dict.fromkeys(answers, ProcessState(UNKNOWN))
    states |= status.nodes if isinstance(status, LauncherStatus) else {}
    states[LAUNCHER] = ProcessState("running", run.launcher)

    def process(name: str) -> Process:
        one = states[name]
        return Process(one.state, one.pid, one.restarts, answers.get(name), use_of(one.pid))

    launcher = process(LAUNCHER) if LAUNCHER in known else None
    processes = {name: process(name) for name in nodes if name in states and name != LAUNCHER}
    return GraphStatus(run_dir, run, launcher, processes)


def other_environment(graph: GraphStatus) -> str | None:
    """Return the environment that serves in place of the one here; None: there is none."""
    own, controller = graph.status_of(EnvironmentStatus), graph.status_of(ControllerStatus)
    if own is None:
        return None
    if not graph.run.is_graph:
        return own.refused_for
    serving = None if controller is None else controller.environment
    return None if serving == own.name else serving


def use_of(pid: int | None) -> Use | None:
    """Return what a process uses; None: it has ended."""
    try:
        stat = Path(f"/proc/{pid}/stat").read_text(errors="replace")
    except OSError:
        return None
    fields = stat.rpartition(")")[2].split()  # the name before it may hold anything
    ticks = int(fields[11]) + int(fields[12])
    return Use(
        fields[0], ticks / os.sysconf("SC_CLK_TCK"), int(fields[21]) * os.sysconf("SC_PAGE_SIZE")
    )
