"""Phases, time limits, events and actions of a lifecycle."""

import signal
from dataclasses import dataclass
from enum import Enum, auto
from typing import TypeAlias

from forcebound.messages.control import ResumeDevice, StartNode, StopNode
from forcebound.messages.events import EventKind
from forcebound.roles import LOST

#: What a user may ask of a launcher during a run; it is an event, if nothing is against it.
NodeRequest: TypeAlias = StopNode | StartNode | ResumeDevice


@dataclass(frozen=True)
class TimeLimits:
    """Time limits, in ns."""

    start_ns: int = 180_000_000_000  # a first start compiles for 10 s of processor time
    engage_ns: int = 2_000_000_000
    stop_ns: int = 2_000_000_000
    recorder_stop_ns: int = 30_000_000_000  # without an answer: the disk or the machine is slow
    kill_ns: int = 2_000_000_000  # from SIGKILL to the end of the process


class RunPhase(Enum):
    """Phase of a run, from start to end."""

    STARTING = auto()
    ENGAGING = auto()
    RUNNING = auto()
    STOPPING = auto()
    OVER = auto()


@dataclass(frozen=True)
class Failure:
    """Failure of a run; ``node`` is the node that caused it, if one did."""

    message: str
    node: str | None = None


@dataclass(frozen=True)
class _OfNode:
    node: str


@dataclass(frozen=True)
class Reported(_OfNode):
    """A node answered a request for its status."""

    waiting_for: tuple[str, ...]  # topics without a packet yet; none: it is ready


class Engaged(_OfNode):
    """A device has confirmed that the force engages."""


@dataclass(frozen=True)
class Ended(_OfNode):
    """A process has ended; ``status`` is its exit status, or minus the signal that ended it."""

    status: int


@dataclass(frozen=True)
class Interrupted:
    """Request to end the run: Ctrl-C, SIGTERM, a closed terminal."""


LifecycleEvent: TypeAlias = Reported | Engaged | Ended | Interrupted | NodeRequest


class Engage(_OfNode):
    """Let a device engage the force."""


class Terminate(_OfNode):
    """Stop a node (SIGTERM)."""


class Kill(_OfNode):
    """End a node that does not stop (SIGKILL)."""


class Start(_OfNode):
    """Start a node."""


@dataclass(frozen=True)
class Announce:
    """Publish an event of a process."""

    event: EventKind
    node: str
    message: str
    is_fault: bool = False
    status: str = ""  # exit status, in words


Action: TypeAlias = Engage | Terminate | Kill | Start | Announce


def describe_status(status: int) -> str:
    """Return an exit status, or minus the number of a signal, in words."""
    if status == LOST:
        return f"exit status {status} (its device is lost)"
    if status >= 0:
        return f"exit status {status}"
    try:
        return f"signal {signal.Signals(-status).name}"
    except ValueError:
        return f"signal {-status}"
