"""Requests to the processes of a run, and their answers: one class each.

A request is a msgpack map whose key ``request`` names its class, an answer one whose key ``answer``
does. ``docs/protocol.md``, Control, is the page about them.

To add a request: a class here, and its class in the ``requests`` of the node that takes it.
"""

from collections.abc import Mapping
from typing import Annotated, Any, Literal, TypeAlias

import msgspec
from msgspec import Meta, Struct

from forcebound.messages.events import TrialEvent
from forcebound.messages.packets import MAX_AXES, MAX_TEXT, TOPIC_OF, Event, Scene, Vector
from forcebound.roles import Fact

UNCERTAIN = (TOPIC_OF[Event], TOPIC_OF[Scene])  # topics on which no packet may ever come

EpisodeAction: TypeAlias = Literal["start", "keep", "discard"]

#: Parameters of a graph by name, as plain JSON values in SI units.
Parameters: TypeAlias = dict[str, Any]


class Request(Struct, frozen=True, tag_field="request", forbid_unknown_fields=True):
    """A request to one process."""


class GetStatus(Request, frozen=True, tag="status"):
    """Report how the process is doing."""


class StopProcess(Request, frozen=True, tag="stop"):
    """End the process, a device with zero force first."""


class Configure(Request, frozen=True, tag="configure"):
    """Continue with these parameters."""

    time_ns: int  # when they were written into the launch document; an older request is ignored
    parameters: Parameters  # all of the node, by name
    units: dict[str, str] = {}  # in which quantities of it were written, by name; for people


class Engage(Request, frozen=True, tag="engage"):
    """Permit forces from the next tick on."""


class Release(Request, frozen=True, tag="release"):
    """Write zero force until :class:`Engage`; the ledger goes on, the force returns by the ramp."""


class ResetWorld(Request, frozen=True, tag="reset_world"):
    """Let the world of the environment begin again."""


class Point(Request, frozen=True, tag="point"):
    """Move the pointer that a simulated hand follows."""

    target: Annotated[Vector, Meta(min_length=1, max_length=MAX_AXES)]  # m; the other axes stay


class EnvironmentDied(Request, frozen=True, tag="environment_died"):
    """The process of an environment has ended."""

    process: Annotated[str, Meta(min_length=1)]  # beginning of the environment's name


class StopNode(Request, frozen=True, tag="stop_node"):
    """Stop a node until :class:`StartNode`."""

    node: str


class StartNode(Request, frozen=True, tag="start_node"):
    """Start a node again."""

    node: str


class ResumeDevice(Request, frozen=True, tag="resume_device"):
    """Open a lost device again."""

    node: str = ""  # name of its process; empty: the one that is lost


class ConfigureNode(Request, frozen=True, tag="configure_node"):
    """Pass :class:`Configure` to a node that does not answer now."""

    node: str
    configure: Configure


class EmitEvent(Request, frozen=True, tag="emit_event"):
    """Emit an event of a study's session, as one of the launcher."""

    event: TrialEvent
    message: Annotated[str, Meta(max_length=MAX_TEXT)]
    data: dict[str, str] = {}


class MarkEpisode(Request, frozen=True, tag="mark_episode"):
    """Begin an episode of the recording, or keep or discard the open one; an event says so."""

    action: EpisodeAction
    is_question: bool = False  # whether it is only asked if that could be done


#: Requests that every node takes, besides those of its class; and those that the launcher takes.
OF_NODES: tuple[type[Request], ...] = (GetStatus, StopProcess, Configure)
OF_LAUNCHER: tuple[type[Request], ...] = (
    GetStatus,
    StopNode,
    StartNode,
    ResumeDevice,
    ConfigureNode,
    EmitEvent,
    MarkEpisode,
)


class _Answer(Struct, tag_field="answer"):
    """An answer of a process."""


class Refused(_Answer, tag="error"):
    """The request was refused, and had no effect."""

    error: str  # for people


class Accepted(_Answer, tag="accepted"):
    """The request was executed, or will be at once."""


class Engaged(_Answer, tag="engaged"):
    """Forces are permitted."""


class Pointed(_Answer, tag="pointed"):
    """The hand follows the pointer."""

    target: Vector  # m, within the reach of the hand
    time_ns: int  # on the device's clock, from when on it counts


class BounderReport(Struct, frozen=True, kw_only=True):
    """Counts of the bounder of a device since the force engaged."""

    overruns: int = 0  # holds longer than the hold limit
    refused_readings: int = 0
    late_writes: int = 0  # forces that took effect later after their reading than stated
    crowded_writes: int = 0  # forces that were zero, since too many before them did not act yet
    largest_allowance: float = 0.0  # J, the most that late holds can have leaked
    allowance_repaid: bool = True
    fast_holds: int = 0  # intervals with a force in which the hand was faster than stated
    speed_leak: float = 0.0  # J, the most that it can have got then
    hold_limit: float  # s, mean
    longest_hold_limit: float  # s
    longest_write_delay: float = 0.0  # s, from a reading until its force took effect
    device_time: float = 0.0  # s, mean, in the device's own reads and writes of a tick; 0: virtual
    device_misses: int = 0  # ticks that were missed while the device read or wrote

    def as_texts(self) -> dict[str, str]:
        """Return the fields as the data of an event."""
        return {name: str(value) for name, value in msgspec.structs.asdict(self).items()}

    @classmethod
    def from_texts(cls, data: Mapping[str, str]) -> "BounderReport | None":
        """Return what :meth:`as_texts` wrote; None: it is not that."""
        try:
            return msgspec.convert(data, cls, strict=False)
        except msgspec.ValidationError:
            return None


class RemoteStatus(Struct, kw_only=True):
    """The link of a node to another machine."""

    listens: bool
    address: str
    port: int
    connected: bool
    secure: bool = True
    peers: list[str] = []
    counts: dict[str, int] = {}  # notices by kind, also those that were not reported


class ProcessStatus(_Answer, kw_only=True):
    """Report of a process of a graph."""

    received: dict[str, int] = {}  # packets by topic
    rejected: dict[str, int] = {}  # packets by reason

    @property
    def waiting_for(self) -> tuple[str, ...]:
        """Topics on which no packet has come, and one must."""
        return tuple(t for t, count in self.received.items() if not count and t not in UNCERTAIN)


class NodeStatus(ProcessStatus, kw_only=True, tag="node"):
    """Report of a node."""

    steps: int = 0
    links: dict[str, dict[str, int]] = {}  # packets on impaired links, by topic and fate
    remotes: dict[str, RemoteStatus] = {}  # links to other machines, by hand
    realtime: list[Fact] = []  # what makes the process punctual, or could not be had


class DeviceStatus(NodeStatus, kw_only=True, tag="device"):
    """Status of a device."""

    engaged: bool
    law: str
    bounder: BounderReport
    deadline_misses: int = 0
    #: J, true energy of a simulated device when its law began, less its kinetic energy then. Under
    #: a certified law the energy does not fall below it.
    energy_before: float = 0.0


class ControllerStatus(NodeStatus, kw_only=True, tag="controller"):
    """Status of a controller."""

    environment: str | None = None  # that serves; None: none yet
    failures: int = 0  # calls that the controller's code failed to answer


class EnvironmentStatus(NodeStatus, kw_only=True, tag="environment"):
    """Status of an environment."""

    name: str
    refused_for: str | None = None  # the one that serves instead; None: this one, or none
    failures: int = 0  # queries that the environment's code failed to answer


class RecorderStatus(ProcessStatus, kw_only=True, tag="recorder"):
    """Status of a recorder."""

    recording: str  # "complete", or why it is not


class ProcessState(Struct, frozen=True):
    """State of one process, as the launcher knows it."""

    state: str
    pid: int | None = None  # None: it does not run
    restarts: int = 0


class Episodes(Struct):
    """Episodes of a run so far; they count from 0."""

    begun: int = 0
    kept: int = 0
    is_open: bool = False  # whether the last one has not ended


class LauncherStatus(_Answer, kw_only=True, tag="launcher"):
    """Status of a launcher."""

    phase: str
    nodes: dict[str, ProcessState] = {}
    episodes: Episodes = msgspec.field(default_factory=Episodes)


Answer: TypeAlias = (
    NodeStatus
    | DeviceStatus
    | ControllerStatus
    | EnvironmentStatus
    | RecorderStatus
    | LauncherStatus
    | Accepted
    | Engaged
    | Pointed
    | Refused
)
