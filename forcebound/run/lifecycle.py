"""Lifecycle of a run: a state machine that turns events into actions, without side effects.

::

    STARTING --all ready--> ENGAGING --confirmed------> RUNNING --time is over--> STOPPING --> OVER
        |                       |                           |                        ^
        +--- a node ended, an interrupt, too slow ----------+------------------------+

While RUNNING, and only then, the end of a controller or an environment does not end the run: it is
restarted (:mod:`forcebound.run.restarts`), with zero force after the age limit. They may also be
stopped and started on request; a node stopped on request stays stopped until a start request. A
device that is lost and may wait (exit status ``LOST``) is started again when the user says that it
is in order, and only then; its force engages again. None of this delays the end of the run.

Stopping goes group by group (:mod:`forcebound.roles`): the device first, the recorder last. A
process that does not stop in time is killed; a recorder that answers has more time. Only the first
failure is reported.
"""

import signal
from collections.abc import Collection, Sequence

from forcebound.messages.control import ResumeDevice, StartNode, StopNode
from forcebound.messages.topology import HAND, ONE_HAND, Graph
from forcebound.roles import DEVICE, ENVIRONMENT, LOST, RECORDER, ROLES, STOP_GROUPS, Role
from forcebound.run.actions import (
    Action,
    Announce,
    Ended,
    Engage,
    Engaged,
    Failure,
    Interrupted,
    Kill,
    LifecycleEvent,
    NodeRequest,
    Reported,
    RunPhase,
    Start,
    Terminate,
    TimeLimits,
    describe_status,
)
from forcebound.run.restarts import GIVE_UP_DEATHS, GIVE_UP_NS, Restarts
from forcebound.stop import INTERRUPTED

ADVICE = (
    "the device is lost: zero force. Plug it in, switch it on, hold it in its home pose if it has"
    " one; then run {} in another terminal. Ctrl-C ends the run"
)
STOPPED_EARLY = (INTERRUPTED, -signal.SIGTERM)  # exit status of a node that was not ready yet


def resume_command(hand: str) -> str:
    """Return the command that lets a hand's lost device be opened again, between backticks."""
    return "`forcebound device resume`" if hand == HAND else f"`forcebound device resume {hand}`"


class Lifecycle:
    """One run, from the start of its processes at ``time_ns`` to the end of the last.

    ``duration_ns`` counts from the engagement of the force; None: until interrupted. The start has
    no time limit while only ``remote_topics`` are missing, which arrive once an environment on
    another machine answers.
    """

    def __init__(
        self,
        nodes: Sequence[str],
        duration_ns: int | None,
        time_ns: int,
        limits: TimeLimits,
        remote_topics: Collection[str] = (),
        graph: Graph = ONE_HAND,
    ) -> None:
        self._graph = graph
        self.phase = RunPhase.STARTING
        self._remote_topics = frozenset(remote_topics)
        self.failure: Failure | None = None  # the first
        self.interrupted = False  # the run was ended on request
        self._asked = False  # somebody asked for the end, perhaps after it
        self._phase_end_ns: int | None = time_ns + limits.start_ns
        self._limits = limits
        self._duration_ns = duration_ns
        self._alive = set(nodes)
        self._waiting: dict[str, tuple[str, ...] | None] = dict.fromkeys(nodes)  # None: silent
        self._stopping: list[list[str]] = []  # remaining groups
        self._killed: set[str] = set()
        self._held: set[str] = set()  # stopped on request, not to be restarted
        self._leaving: dict[str, int] = {}  # stopping on request; killed at this time, in ns
        self._engaged: set[str] = set()
        self.lost: set[str] = set()  # devices, until the user resumes them
        self.returning: set[str] = set()  # resumed devices whose force has not engaged yet
        self.restarts = Restarts()

    def _role(self, node: str) -> Role:
        return ROLES[self._graph.nodes[node].role]

    def _of_role(self, role: str) -> list[str]:
        return [node for node in self._waiting if self._graph.nodes[node].role == role]

    @property
    def engaging(self) -> list[str]:
        """Ready devices that have not yet confirmed that their force engages."""
        if self.phase is RunPhase.ENGAGING:
            return [node for node in self._of_role(DEVICE) if node not in self._engaged]
        if self.phase is RunPhase.RUNNING:
            return [node for node in sorted(self.returning) if self._waiting[node] == ()]
        return []

    @property
    def deadline_ns(self) -> int | None:
        """When :meth:`advance` must be called even without an event, in ns, or None."""
        times_ns = [] if self._phase_end_ns is None else [self._phase_end_ns]
        if self.phase is RunPhase.RUNNING:
            times_ns += self.restarts.due_ns.values()
            times_ns += [end for node, end in self._leaving.items() if node not in self._killed]
        return min(times_ns, default=None)

    @property
    def silent(self) -> list[str]:
        """Running nodes that have not answered since their start."""
        return [node for node in sorted(self._alive) if self._waiting[node] is None]

    @property
    def finishing(self) -> list[str]:
        """Recorders that still write what has come; each answer gives them more time."""
        stopping = self._stopping[0] if self._stopping else []
        return [node for node in self._of_role(RECORDER) if node in self._alive & {*stopping}]

    def state(self, node: str) -> str:
        """Return the state of a node, in one word."""
        if node in self._alive:
            if node in self._leaving:
                return "stopping"
            return "starting" if self._waiting[node] is None else "running"
        if node in self.restarts.due_ns:
            return "restarting"
        if node in self.lost:
            return "lost"
        return "stopped" if node in self._held else "ended"

    def refusal(self, request: NodeRequest) -> str | None:
        """Return why this request of a user cannot be fulfilled now; None if it can."""
        if isinstance(request, ResumeDevice):
            devices = self._of_role(DEVICE)
            if request.node in self.lost or (not request.node and len(self.lost) == 1):
                return None
            if self.lost and not request.node:
                return f"which device? {' and '.join(sorted(self.lost))} are lost"
            device = request.node or devices[0]
            if device not in devices:
                return f"no device {device!r} in this graph; its devices are {', '.join(devices)}"
            return f"the {device} is not lost: it is {self.state(device)}"
        node = request.node
        if node not in self._waiting:
            known = ", ".join(self._waiting)
            if node in self._graph.nodes and self._role(node).is_restarted:
                return f"the launcher of this graph does not run its {node}; it runs {known}"
            return f"no node {node!r} in this graph; its nodes are {known}"
        if not self._role(node).is_restarted:
            return f"a run ends without its {node}; to end it, press Ctrl-C at its launcher"
        if self.phase is not RunPhase.RUNNING:
            phase = self.phase.name.lower()
            return (
                f"the run is {phase}; nodes stop and start only while it is running; try again then"
            )
        return None

    @property
    def not_ready(self) -> list[str]:
        """The nodes that are not ready yet."""
        return [node for node, waiting in self._waiting.items() if waiting != ()]

    def advance(self, time_ns: int, event: LifecycleEvent | None = None) -> list[Action]:
        """Take an event, or the passing of time; return the actions, in order."""
        match event:
            case Reported(node, waiting_for):
                self._waiting[node] = waiting_for
                if node in self.finishing and node not in self._killed:
                    self._phase_end_ns = time_ns + self._limits.recorder_stop_ns
            case Ended(node, status):
                return self._on_end(time_ns, node, status)
            case Interrupted():
                return self._on_interrupt(time_ns)
            case StopNode(node) if self.refusal(event) is None:
                return self._on_stop_request(time_ns, node)
            case StartNode(node) if self.refusal(event) is None:
                return self._on_start_request(node)
            case ResumeDevice(node) if self.phase is RunPhase.RUNNING and not self.refusal(event):
                device = node or next(iter(self.lost))
                self.lost.discard(device)
                self.returning.add(device)
                self.restarts.counts[device] += 1
                return self._start(device)
            case Engaged(node) if self.phase is RunPhase.RUNNING:
                self.returning.discard(node)
            case Engaged(node) if self.phase is RunPhase.ENGAGING:
                self._engaged.add(node)
                if not self.engaging:
                    self.phase = RunPhase.RUNNING
                    duration_ns = self._duration_ns
                    self._phase_end_ns = None if duration_ns is None else time_ns + duration_ns
        if self.phase is RunPhase.STARTING and not self.not_ready:
            self.phase = RunPhase.ENGAGING
            self._phase_end_ns = time_ns + self._limits.engage_ns
            return [Engage(node) for node in self.engaging]
        if (
            self.phase is RunPhase.STARTING
            and self._phase_end_ns is not None
            and self._awaits_remote()
        ):
            self._phase_end_ns = None
            command = "`forcebound node environment FILE`"
            if self._graph.hands != (HAND,):
                command += ", or with a hand there `forcebound launch FILE --hand NAME`"
            message = f"waiting for a remote environment; on its machine: {command}"
            return [Announce("environment_awaited", self._graph.of_role(ENVIRONMENT), message)]
        if self._phase_end_ns is not None and time_ns >= self._phase_end_ns:
            return self._on_deadline(time_ns)
        if self.phase is RunPhase.RUNNING:
            engaging: list[Action] = []
            if isinstance(event, Reported) and event.node in self.engaging:
                engaging.append(Engage(event.node))
            late = [
                self._kill(node)
                for node, end_ns in self._leaving.items()
                if end_ns <= time_ns and node not in self._killed
            ]
            return [*engaging, *late, *self._start_due(time_ns)]
        return []

    def missing(self, node: str) -> str:
        """Return in words what a node lacks that is not ready."""
        waiting = self._waiting[node]
        if waiting is None:
            return f"{node} does not answer"
        return f"{node} has received nothing on {', '.join(waiting)}"

    def _awaits_remote(self) -> bool:
        """True if only packets that depend on a remote environment are missing."""
        waiting = [self._waiting[node] for node in self.not_ready]
        return bool(self._remote_topics) and all(
            topics is not None and self._remote_topics.issuperset(topics) for topics in waiting
        )

    def _on_stop_request(self, time_ns: int, node: str) -> list[Action]:
        self._held.add(node)
        self.restarts.due_ns.pop(node, None)
        if node not in self._alive or node in self._leaving:
            return []
        self._leaving[node] = time_ns + self._limits.stop_ns
        return [Terminate(node)]

    def _on_start_request(self, node: str) -> list[Action]:
        if node not in self._held:
            return []
        self._held.discard(node)
        return [] if node in self._alive else self._start(node)  # or when the old process has ended

    def _start_due(self, time_ns: int) -> list[Action]:
        return [action for node in self.restarts.take_due(time_ns) for action in self._start(node)]

    def _start(self, node: str) -> list[Action]:
        self._alive.add(node)
        self._waiting[node] = None
        return [Start(node), Announce("process_started", node, f"{node} was restarted")]

    def _on_death(self, time_ns: int, node: str, status: int) -> list[Action]:
        """Restart a node that ended while running, or give up."""
        words = describe_status(status)
        message = f"{node} ended unexpectedly, with {words}"
        death = Announce("process_ended", node, message, is_fault=True, status=words)
        if self.restarts.plan(node, time_ns):
            return [death, *self._start_due(time_ns)]
        often = f"{GIVE_UP_DEATHS} times within {GIVE_UP_NS * 1e-9:g} s"
        self._fail(f"{node} ended unexpectedly {often}, the last time with {words}", node)
        return [death, *self._stop(time_ns)]

    def _on_departure(self, node: str, status: int, is_early: bool) -> list[Action]:
        """Take the end of a node that was stopped; start it if that was requested since."""
        words = describe_status(status)
        message = f"{node} stopped on request, with {words}"
        is_fault = status != 0 and not (status in STOPPED_EARLY and is_early)
        if node in self._killed:  # suspended or hung, as the request allows for
            message = f"{node} did not stop in time on request and was killed"
            is_fault = False
        del self._leaving[node]
        self._killed.discard(node)
        gone = Announce("process_ended", node, message, is_fault, words)
        return [gone] if node in self._held else [gone, *self._start(node)]

    def _on_end(self, time_ns: int, node: str, status: int) -> list[Action]:
        self._alive.discard(node)
        is_early = self._waiting[node] is None  # possibly too early to handle a signal
        stopping = self.phase is RunPhase.STOPPING
        if self.phase is RunPhase.RUNNING and self._role(node).is_restarted:
            if node in self._leaving:
                return self._on_departure(node, status, is_early)
            return self._on_death(time_ns, node, status)
        if self.phase is RunPhase.RUNNING and status == LOST:
            self.lost.add(node)
            self.returning.discard(node)
            hand = self._graph.nodes[node].hand or HAND
            advice = ADVICE.format(resume_command(hand))
            return [Announce("device_lost", node, advice, is_fault=True)]
        if node in self._leaving:
            pass  # the run ended first
        elif stopping and is_early and status in (*STOPPED_EARLY, -signal.SIGKILL):
            pass  # still starting, possibly compiling, without force so far
        elif node in self._killed:
            self._fail(f"{node} did not stop in time and was killed", node)
        elif not stopping:
            self._fail(f"{node} ended unexpectedly, with {describe_status(status)}", node)
        elif status != 0:
            self._fail(f"{node} stopped with {describe_status(status)}", node)
        return self._stop_next(time_ns) if stopping else self._stop(time_ns)

    def _on_interrupt(self, time_ns: int) -> list[Action]:
        if self.phase is not RunPhase.STOPPING:
            self.interrupted = self._asked = True
            return self._stop(time_ns)
        if not self._asked:  # it came just after the planned end: the recorder is to finish
            self._asked = True
            return []
        # A second interrupt kills all except the devices, which are about to write zero.
        devices = self._of_role(DEVICE)
        return [self._kill(node) for node in sorted(self._alive - {*devices} - self._killed)]

    def _on_deadline(self, time_ns: int) -> list[Action]:
        limits = self._limits
        if self.phase is RunPhase.STARTING:
            reasons = "; ".join(self.missing(node) for node in self.not_ready)
            starved = set(self.not_ready) - set(self._of_role(RECORDER))
            if starved and not self.silent:  # the device has priority on the core of the loop
                reasons += "; is the rate of the device too high for this machine?"
            self._fail(f"not ready after {limits.start_ns * 1e-9:g} s: {reasons}")
            return self._stop(time_ns)
        if self.phase is RunPhase.ENGAGING:
            silent = self.engaging[0]
            self._fail(f"{silent} does not answer the request to engage", silent)
            return self._stop(time_ns)
        if self.phase is RunPhase.RUNNING:
            return self._stop(time_ns)
        late = [node for node in self._stopping[0] if node in self._alive]
        if all(node in self._killed for node in late):  # not even SIGKILL works: give up
            self._alive -= set(late)
            for node in late:
                self._fail(f"{node} cannot be killed", node)
            return self._stop_next(time_ns)
        self._phase_end_ns = time_ns + limits.kill_ns
        return [self._kill(node) for node in late]

    def _stop(self, time_ns: int) -> list[Action]:
        self.phase = RunPhase.STOPPING
        groups = [
            [node for node in reversed(self._waiting) if self._role(node).stop_group == group]
            for group in STOP_GROUPS
        ]
        self._stopping = [[], *groups]
        return self._stop_next(time_ns)

    def _stop_next(self, time_ns: int) -> list[Action]:
        """Stop the next group if the present one has ended."""
        if self._alive.intersection(self._stopping[0]):
            return []
        while self._stopping and not self._alive.intersection(self._stopping[0]):
            self._stopping.pop(0)
        if not self._stopping:
            self.phase = RunPhase.OVER
            self._phase_end_ns = None
            return []
        limits = self._limits
        is_recorder = any(node in self._stopping[0] for node in self._of_role(RECORDER))
        self._phase_end_ns = time_ns + (limits.recorder_stop_ns if is_recorder else limits.stop_ns)
        return [
            Terminate(node)
            for node in self._stopping[0]
            if node in self._alive and node not in self._killed
        ]

    def _kill(self, node: str) -> Kill:
        self._killed.add(node)
        return Kill(node)

    def _fail(self, message: str, node: str | None = None) -> None:
        if self.failure is None:
            self.failure = Failure(message, node)
