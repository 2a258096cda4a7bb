"""Supervisor: starts, monitors and ends the processes of a run.

:mod:`forcebound.run.lifecycle` decides; this module acts. One loop without threads sleeps until
a process writes a line, ends or answers, a signal arrives, or a deadline of the lifecycle.

No process survives the launcher: each gets a signal from the kernel when the launcher ends
(:mod:`forcebound.run.worker`), and what is left of its group when it has ended, such as a
stopped guardian, is killed. Each has a separate process group, so that Ctrl-C in the terminal
reaches only the launcher, which then stops them in order. A suspended one is woken to end.

The launcher answers requests on its control socket and publishes events like every
process.
"""

import selectors
import signal
import time
from collections import deque
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from pathlib import Path

from forcebound import realtime
from forcebound.ending import end_group
from forcebound.errors import RunError
from forcebound.graph.parameters import describe
from forcebound.graph.phases import ScheduledPhase
from forcebound.messages import control, packets
from forcebound.messages.codec import encode
from forcebound.messages.events import (
    EPISODE_BEGINS,
    EPISODE_ENDS,
    PARAMETERS_SET,
    PHASE_BEGINS,
    EventKind,
    EventLog,
)
from forcebound.messages.topology import ONE_HAND, Graph, endpoint
from forcebound.network.control import ControlServer
from forcebound.network.sockets import Network
from forcebound.roles import CONTROLLER, ENVIRONMENT, LAUNCHER, RECORDER, ROLES
from forcebound.run.actions import (
    Action,
    Announce,
    Ended,
    Engage,
    Engaged,
    Interrupted,
    Kill,
    LifecycleEvent,
    Reported,
    RunPhase,
    Start,
    Terminate,
    TimeLimits,
)
from forcebound.run.children import LAST_CHANCE, Child, OsSignals, name_begins
from forcebound.run.fork_server import ForkServer
from forcebound.run.lifecycle import STOPPED_EARLY, Lifecycle
from forcebound.run.screen import Screen, doing

REQUEST_INTERVAL_NS = 20_000_000  # between two requests to a node that is not ready
NONE_OPEN, ONE_OPEN = (
    "no episode is open: start one first",
    "an episode is open: keep or discard it",
)
NO_EPISODE = {"keep": NONE_OPEN, "discard": NONE_OPEN, "start": ONE_OPEN}
NOT_STARTED = 126  # exit status of a process that could not be started, as in a shell


@dataclass(eq=False)
class Supervisor:
    """Runs the processes of one run to their end.

    ``commands`` has the command line of each process by name, in the order in which they start.
    ``begin`` makes a phase hold, and returns requests by process. ``changes`` returns the
    parameters of a node that were changed since the run began; ``revert`` takes the last change
    back, for a node that failed, and returns what holds again. The processes start on
    ``start_cores``, which takes most of a second of each; none: those of the launcher, as for a
    process that restarts during a run. The others are as of
    :class:`~forcebound.run.lifecycle.Lifecycle`.
    """

    commands: Mapping[str, Sequence[str]]
    run_dir: Path
    duration_ns: int | None
    limits: TimeLimits | None = None
    screen: Screen = field(default_factory=Screen)
    phases: Sequence[ScheduledPhase] = ()
    begin: Callable[[ScheduledPhase], Mapping[str, control.Configure]] = lambda _: {}
    remote_topics: Collection[str] = ()
    changes: Callable[[str], control.Parameters] = lambda _: {}
    revert: Callable[[str], control.Parameters] = lambda _: {}
    start_cores: Collection[int] = ()
    graph: Graph = ONE_HAND
    server: ForkServer | None = None

    def __post_init__(self) -> None:
        self._coming = deque(self.phases)
        self._began_ns: int | None = None  # when the force engaged
        self._children: dict[str, Child] = {}
        self._running: set[str] = set()
        self._not_started: list[str] = []
        self._has_requests = False  # more than the last turn has answered
        self._events = EventLog(LAUNCHER)
        self._episodes = control.Episodes()

    def run(self) -> bool:
        """Start, monitor and end the processes; return whether the run was interrupted.

        Raises:
            RunError: If the lifecycle has a failure; the message has the last lines of its process.
                All processes have ended then, too.
        """
        with ExitStack() as stack:
            network = stack.enter_context(Network())
            graph, run_dir = self.graph, self.run_dir
            own_events = graph.sent(LAUNCHER, packets.Event)
            self._publish = network.publisher(endpoint(run_dir, own_events)).send
            server = network.control_server(
                endpoint(run_dir, graph.nodes[LAUNCHER]), control.OF_LAUNCHER
            )
            signals = stack.enter_context(OsSignals())
            self._selector = stack.enter_context(selectors.DefaultSelector())
            for descriptor in (signals.descriptor, server.descriptor):
                self._selector.register(descriptor, selectors.EVENT_READ)
            stack.callback(self._end_children)
            with realtime.on_cores(self.start_cores):
                for name in self.commands:
                    self._start(name)
            self._clients = {
                name: network.control_client(endpoint(run_dir, graph.nodes[name]))
                for name in self.commands
            }
            times = self.duration_ns, time.monotonic_ns(), self.limits or TimeLimits()
            lifecycle = Lifecycle(list(self.commands), *times, self.remote_topics, graph)
            self._loop(lifecycle, signals, server)
        if lifecycle.failure is not None:
            raise RunError(self._failure_message(lifecycle))
        return lifecycle.interrupted

    def _loop(self, lifecycle: Lifecycle, signals: OsSignals, server: ControlServer) -> None:
        requested_ns = 0

        def advance(event: LifecycleEvent | None) -> None:
            for action in lifecycle.advance(time.monotonic_ns(), event):
                self._do(action)

        def answer(request: control.Request) -> control.Answer:
            return self._answer(request, lifecycle, advance)

        began_ns = time.monotonic_ns()
        while lifecycle.phase is not RunPhase.OVER:
            now_ns = time.monotonic_ns()
            self.screen.status(doing(lifecycle, (now_ns - began_ns) * 1e-9))
            if now_ns - requested_ns >= REQUEST_INTERVAL_NS:
                requested_ns = now_ns
                self._ask(lifecycle)
            for key, _ in self._selector.select(self._timeout(lifecycle, now_ns)):
                if key.data is not None and not key.data.read():
                    self._selector.unregister(key.fd)
            events: list[LifecycleEvent | None] = [*self._answers(), *self._ends()]
            if signals.take():
                if not lifecycle.interrupted:
                    self.screen.show(LAUNCHER, "ending; the result follows in some seconds")
                events.append(Interrupted())
            awaited = self._awaited(lifecycle)
            for event in events or [None]:
                advance(event)
                if isinstance(event, Reported) and event.node in awaited:
                    words = f"{event.node} was restarted with changed parameters"
                    self._announce_parameters(words, self.changes(event.node))
            self._has_requests = server.serve(answer)
            if lifecycle.phase is RunPhase.RUNNING:
                self._begin_phases(time.monotonic_ns())

    def _begin_phases(self, now_ns: int) -> None:
        if self._began_ns is None:
            self._began_ns = now_ns
        while self._coming and now_ns >= self._began_ns + self._coming[0].start_ns:
            phase = self._coming.popleft()
            for name, request in self.begin(phase).items():
                if name in self._clients:  # a stopped one reads the document when it starts
                    self._clients[name].ask(request)
            self._emit(PHASE_BEGINS, phase.message, phase.data)

    def _start(self, name: str) -> None:
        # A new session also is a new share of the processor: a recorder needs none.
        own_session = self.graph.nodes[name].role != RECORDER
        child = Child(name, self.commands[name], self.screen.show, own_session, self.server)
        self._selector.register(child.descriptor, selectors.EVENT_READ, child)
        self._children[name] = child
        self._running.add(name)

    def _restart(self, name: str) -> None:
        former = self._children[name]
        with suppress(KeyError):  # it is there if the stream's end has not been read
            self._selector.unregister(former.descriptor)
        former.end()
        try:
            self._start(name)
        except OSError as error:  # out of memory or processes: treated as an end
            self.screen.show(name, f"cannot be started: {error.strerror}")
            self._not_started.append(name)

    def _end_children(self) -> None:
        with ExitStack() as stack:
            for child in self._children.values():
                stack.callback(child.end)

    def _timeout(self, lifecycle: Lifecycle, now_ns: int) -> float | None:
        if self._not_started or self._has_requests:
            return 0.0
        is_starting = lifecycle.phase in (RunPhase.STARTING, RunPhase.ENGAGING)
        if is_starting or lifecycle.returning or lifecycle.finishing or self._awaited(lifecycle):
            return REQUEST_INTERVAL_NS * 1e-9
        ends_ns = [] if lifecycle.deadline_ns is None else [lifecycle.deadline_ns]
        if self._coming and lifecycle.phase is RunPhase.RUNNING and self._began_ns is not None:
            ends_ns.append(self._began_ns + self._coming[0].start_ns)
        return max(0.0, (min(ends_ns) - now_ns) * 1e-9) if ends_ns else None

    def _ask(self, lifecycle: Lifecycle) -> None:
        names = lifecycle.not_ready if lifecycle.phase is RunPhase.STARTING else []
        for name in lifecycle.finishing:
            self._children[name].process.send_signal(signal.SIGCONT)  # it may be suspended since
        engaging = lifecycle.engaging
        returning = lifecycle.returning.difference(engaging)
        names = [*names, *returning, *lifecycle.finishing, *self._awaited(lifecycle)]
        for name in dict.fromkeys(names):
            self._clients[name].poll(control.GetStatus())
        for name in engaging:
            self._clients[name].poll(control.Engage())

    def _awaited(self, lifecycle: Lifecycle) -> list[str]:
        """Restarted nodes that have not answered yet."""
        return lifecycle.silent if lifecycle.phase is RunPhase.RUNNING else []

    def _answer(
        self,
        request: control.Request,
        lifecycle: Lifecycle,
        advance: Callable[[LifecycleEvent], None],
    ) -> control.Answer:
        """Return the answer to a request of the launcher's control socket."""
        match request:
            case control.StopNode() | control.StartNode() | control.ResumeDevice():
                refusal = lifecycle.refusal(request)
                if refusal is not None:
                    return control.Refused(refusal)
                advance(request)
            case control.ConfigureNode(node, configure):
                if node not in self._clients:
                    return control.Refused(f"the launcher of this graph does not run {node!r}")
                # This request waits for a suspended node; a request of the client ends with it.
                self._clients[node].ask(configure)
            case control.EmitEvent(event, message, data):
                self._emit(event, message, data)
            case control.MarkEpisode():
                if lifecycle.phase is not RunPhase.RUNNING:
                    return control.Refused(
                        "episodes need a graph that runs, with its force engaged"
                    )
                if self._episodes.is_open == (request.action == "start"):
                    return control.Refused(NO_EPISODE[request.action])
                if not request.is_question:
                    self._mark(request.action)
        return control.LauncherStatus(
            episodes=self._episodes,
            phase=lifecycle.phase.name.lower(),
            nodes={
                name: control.ProcessState(
                    lifecycle.state(name),
                    child.process.pid if name in self._running else None,
                    lifecycle.restarts.counts[name],
                )
                for name, child in self._children.items()
            },
        )

    def _mark(self, action: control.EpisodeAction) -> None:
        """Begin an episode, or end the open one."""
        found = self._episodes
        found.is_open, is_kept = action == "start", action == "keep"
        found.begun += found.is_open
        found.kept += is_kept
        data = {"episode": str(found.begun - 1)}
        if found.is_open:
            self._emit(EPISODE_BEGINS, f"episode {found.begun - 1} begins", data)
        else:
            words = f"episode {found.begun - 1} is {'kept' if is_kept else 'discarded'}"
            self._emit(EPISODE_ENDS, words, data | {"kept": str(is_kept).lower()})

    def _answers(self) -> list[LifecycleEvent]:
        events: list[LifecycleEvent] = []
        for name, client in self._clients.items():
            match client.answer():
                case control.ProcessStatus() as status:
                    events.append(Reported(name, status.waiting_for))
                case control.Engaged():
                    events.append(Engaged(name))
        return events

    def _ends(self) -> list[LifecycleEvent]:
        events: list[LifecycleEvent] = [Ended(name, NOT_STARTED) for name in self._not_started]
        self._not_started.clear()
        for name in sorted(self._running):
            child = self._children[name]
            status = child.process.poll()
            if status is not None:
                end_group(child.process.pid, LAST_CHANCE)
                self._running.discard(name)
                child.read()  # its last lines, for the message of the failure
                is_restarted = ROLES[self.graph.nodes[name].role].is_restarted
                if is_restarted and status not in (0, *STOPPED_EARLY, -signal.SIGKILL):
                    words = f"{name} failed after a change, and gets the values before"
                    self._announce_parameters(words, self.revert(name))
                if self.graph.nodes[name].role == ENVIRONMENT:
                    self._report_death(child.process.pid)
                events.append(Ended(name, status))
        return events

    def _report_death(self, pid: int) -> None:
        """Report the end of an environment's process to the controllers."""
        for name, client in self._clients.items():
            if self.graph.nodes[name].role == CONTROLLER:
                client.ask(control.EnvironmentDied(name_begins(pid)))

    def _do(self, action: Action) -> None:
        match action:
            case Engage(name):
                self._clients[name].ask(control.Engage())
            case Kill(name):
                self._children[name].process.kill()
            case Terminate(name):
                self._children[name].request_end()
            case Start(name):
                self._restart(name)
            case Announce():
                self._announce(action)

    def _announce(self, action: Announce) -> None:
        data = {"node": action.node} | ({"status": action.status} if action.status else {})
        self._emit(action.event, action.message, data, is_fault=action.is_fault)

    def _announce_parameters(self, words: str, values: control.Parameters) -> None:
        """Publish the values of parameters that a restarted node has read, or is to read."""
        if values:
            data = {name: str(value) for name, value in values.items()}
            self._emit(PARAMETERS_SET, f"{words}: {describe(values, {})}", data)

    def _emit(
        self, event: EventKind, message: str, data: Mapping[str, str], *, is_fault: bool = False
    ) -> None:
        time_ns = time.monotonic_ns()
        self._publish(encode(self._events.emit(time_ns, event, message, data, is_fault=is_fault)))

    def _failure_message(self, lifecycle: Lifecycle) -> str:
        failure = lifecycle.failure
        assert failure is not None
        tail = self._children[failure.node].tail if failure.node is not None else ()
        last = "".join(f"\n  {line}" for line in tail)
        return f"{failure.message}{'; its last lines:' if last else ''}{last}"
