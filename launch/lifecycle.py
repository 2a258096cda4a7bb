"""What the supervisor does when: a machine that turns events into actions and touches nothing.

::

    STARTING --all ready--> ENGAGING --device says so--> RUNNING --time is over--> STOPPING --> OVER
        |                       |                           |                        ^
        +--- a node ended, an interrupt, too slow ----------+------------------------+

Stopping goes group by group (:data:`STOP_ORDER`): the device first, so that the force is zero
before those that it depends on are gone, and the recorder last, so that it has everything. Who does
not stop in time is killed. The first failure is the one that is told; what follows from it is not.
"""

import signal
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum, auto
from typing import TypeAlias

STOP_ORDER: tuple[tuple[str, ...], ...] = (
    ("device",),
    ("controller", "environment"),
    ("recorder",),
)


@dataclass(frozen=True)
class Limits:
    """How long things may take, in ns."""

    start_ns: int = 60_000_000_000  # a first start compiles the plant, and there may be one core
    engage_ns: int = 2_000_000_000
    stop_ns: int = 2_000_000_000
    recorder_stop_ns: int = 10_000_000_000  # it may have much to write to a slow disk
    kill_ns: int = 2_000_000_000  # from SIGKILL to being gone


@dataclass(frozen=True)
class Reported:
    """A node answered a request for its status."""

    node: str
    waiting_for: tuple[str, ...]  # topics on which nothing has come; none: it is ready


@dataclass(frozen=True)
class Engaged:
    """The device has confirmed that the force engages."""


@dataclass(frozen=True)
class Ended:
    """A process is gone; ``status`` is its exit status, or minus the signal that ended it."""

    node: str
    status: int


@dataclass(frozen=True)
class Interrupted:
    """Somebody wants the run to end: Ctrl-C, SIGTERM, a closed terminal."""


Event: TypeAlias = Reported | Engaged | Ended | Interrupted


@dataclass(frozen=True)
class Engage:
    """Ask the device to let the force engage."""


@dataclass(frozen=True)
class Terminate:
    """Ask a node to stop (SIGTERM)."""

    node: str


@dataclass(frozen=True)
class Kill:
    """End a node that does not stop (SIGKILL)."""

    node: str


Action: TypeAlias = Engage | Terminate | Kill


class Phase(Enum):
    """Where a run is."""

    STARTING = auto()
    ENGAGING = auto()
    RUNNING = auto()
    STOPPING = auto()
    OVER = auto()


@dataclass(frozen=True)
class Failure:
    """Why a run failed; ``node`` is whom to blame, if it is one."""

    message: str
    node: str | None = None


class Lifecycle:
    """One run, from the start of its processes to the end of the last.

    Args:
        nodes: The processes, all started at ``time_ns``.
        duration_ns: How long to run with an engaged force; None: until interrupted.
        time_ns: Now, in ns.
        limits: How long things may take.

    Attributes:
        phase: Where the run is.
        failure: Why it failed; None if it has not.
        interrupted: Whether somebody ended it.
        deadline_ns: When :meth:`advance` must be called even without an event, in ns, or None.
    """

    def __init__(
        self, nodes: Sequence[str], duration_ns: int | None, time_ns: int, limits: Limits
    ) -> None:
        self.phase = Phase.STARTING
        self.failure: Failure | None = None
        self.interrupted = False
        self._interrupted_early = False
        self.deadline_ns: int | None = time_ns + limits.start_ns
        self._limits = limits
        self._duration_ns = duration_ns
        self._alive = set(nodes)
        self._waiting: dict[str, tuple[str, ...] | None] = dict.fromkeys(nodes)  # None: silent
        self._stopping: list[list[str]] = []  # groups that are left
        self._killed: set[str] = set()

    @property
    def not_ready(self) -> list[str]:
        """The nodes that are not ready yet."""
        return [node for node, waiting in self._waiting.items() if waiting != ()]

    def advance(self, time_ns: int, event: Event | None = None) -> list[Action]:
        """Take an event, or the passing of time; return what to do, in this order."""
        match event:
            case Reported(node, waiting_for):
                self._waiting[node] = waiting_for
            case Ended(node, status):
                return self._on_end(time_ns, node, status)
            case Interrupted():
                return self._on_interrupt(time_ns)
            case Engaged() if self.phase is Phase.ENGAGING:
                self.phase = Phase.RUNNING
                duration_ns = self._duration_ns
                self.deadline_ns = None if duration_ns is None else time_ns + duration_ns
        if self.phase is Phase.STARTING and not self.not_ready:
            self.phase = Phase.ENGAGING
            self.deadline_ns = time_ns + self._limits.engage_ns
            return [Engage()]
        if self.deadline_ns is not None and time_ns >= self.deadline_ns:
            return self._on_deadline(time_ns)
        return []

    def _on_end(self, time_ns: int, node: str, status: int) -> list[Action]:
        self._alive.discard(node)
        stopping = self.phase is Phase.STOPPING
        if node in self._killed:
            self._fail(f"{node} did not stop in time and was killed", node)
        elif not stopping:
            self._fail(f"{node} ended by itself, with {describe_status(status)}", node)
        elif status == -signal.SIGTERM and self._interrupted_early:
            pass  # it was told to stop before it was far enough to listen
        elif status != 0:
            self._fail(f"{node} stopped with {describe_status(status)}", node)
        return self._stop_next(time_ns) if stopping else self._stop(time_ns)

    def _on_interrupt(self, time_ns: int) -> list[Action]:
        if self.phase is not Phase.STOPPING:
            self.interrupted = True
            self._interrupted_early = self.phase is Phase.STARTING
            return self._stop(time_ns)
        # Impatience: nobody gets more time, except the device, which is about to write zero.
        return [self._kill(node) for node in sorted(self._alive - {"device"} - self._killed)]

    def _on_deadline(self, time_ns: int) -> list[Action]:
        limits = self._limits
        if self.phase is Phase.STARTING:
            reasons = "; ".join(self._missing(node) for node in self.not_ready)
            self._fail(f"not ready after {limits.start_ns * 1e-9:g} s: {reasons}")
            return self._stop(time_ns)
        if self.phase is Phase.ENGAGING:
            self._fail("device does not answer the request to engage", "device")
            return self._stop(time_ns)
        if self.phase is Phase.RUNNING:
            return self._stop(time_ns)
        late = [node for node in self._stopping[0] if node in self._alive]
        if all(node in self._killed for node in late):  # not even SIGKILL helps: leave it
            self._alive -= set(late)
            for node in late:
                self._fail(f"{node} cannot be killed", node)
            return self._stop_next(time_ns)
        self.deadline_ns = time_ns + limits.kill_ns
        return [self._kill(node) for node in late]

    def _stop(self, time_ns: int) -> list[Action]:
        known = {node for group in STOP_ORDER for node in group}
        others = [node for node in self._waiting if node not in known]
        self.phase = Phase.STOPPING
        self._stopping = [[], *(list(group) for group in STOP_ORDER[:-1]), others]
        self._stopping.append(list(STOP_ORDER[-1]))
        return self._stop_next(time_ns)

    def _stop_next(self, time_ns: int) -> list[Action]:
        """Go on to the next group if the present one is gone."""
        if self._alive.intersection(self._stopping[0]):
            return []
        while self._stopping and not self._alive.intersection(self._stopping[0]):
            self._stopping.pop(0)
        if not self._stopping:
            self.phase = Phase.OVER
            self.deadline_ns = None
            return []
        limits = self._limits
        is_recorder = "recorder" in self._stopping[0]
        self.deadline_ns = time_ns + (limits.recorder_stop_ns if is_recorder else limits.stop_ns)
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

    def _missing(self, node: str) -> str:
        waiting = self._waiting[node]
        if waiting is None:
            return f"{node} does not answer"
        return f"{node} has received nothing on {', '.join(waiting)}"


def describe_status(status: int) -> str:
    """Return an exit status, or minus the number of a signal, in words."""
    if status >= 0:
        return f"exit status {status}"
    import signal  # only its names

    try:
        return f"signal {signal.Signals(-status).name}"
    except ValueError:
        return f"signal {-status}"
