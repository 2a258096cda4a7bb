"""Packets: one frozen class each, and the table of topics.

The classes are msgspec structs: compiled code creates, encodes and checks them, because each tick
needs four. Creating a packet checks nothing; decoding does.

Every packet carries ``seq`` (counts from 0 at its sender) and ``time_ns`` (the sender's own
monotonic clock). An answer echoes ``device_seq`` and ``device_time_ns`` of the device state that it
answers, so a loop delay is measured on the device's clock alone. ``hand`` names the hand to whose
loop a packet belongs.

Vectors are tuples of 1 to 6 floats, one per axis; the objects of a scene are in space, whatever the
axes. Positions grow *into* the environment; a force is positive when it *resists* motion in the
positive direction (``docs/theory.md``, section 1).
"""

from collections.abc import Mapping
from typing import Annotated, Any, Final, Literal, NamedTuple, TypeAlias, get_type_hints

from msgspec import Meta, Struct

VERSION: Final = 4  # of the wire format; every packet carries it

MAX_AXES = 6
MAX_COUNT = 2**63 - 1  # the largest 64-bit integer that every language has
MAX_LENGTH = 64  # of any array or map on the wire
MAX_NAME = 64  # characters of a name
NAMES = ("hand", "environment", "node", "event")  # keys whose text is printable, on one line
MAX_TEXT = 500  # characters of a text for people

Vector: TypeAlias = tuple[float, ...]
Point: TypeAlias = tuple[float, float, float]  # m, in space, whatever number of axes a device has
Quaternion: TypeAlias = tuple[float, float, float, float]  # w x y z; of length 1: an orientation

# The same types with the limits that the decoder checks.
_Count: TypeAlias = Annotated[int, Meta(ge=0, le=MAX_COUNT)]
_Vector: TypeAlias = Annotated[Vector, Meta(min_length=1, max_length=MAX_AXES)]
_Name: TypeAlias = Annotated[str, Meta(min_length=1, max_length=MAX_NAME)]
_Text: TypeAlias = Annotated[str, Meta(max_length=MAX_TEXT)]
_Digest: TypeAlias = Annotated[str, Meta(pattern="^[0-9a-f]{64}$")]
_Texts: TypeAlias = Annotated[Mapping[str, _Text], Meta(max_length=MAX_LENGTH)]
_Vectors: TypeAlias = Annotated[Mapping[str, _Vector], Meta(max_length=MAX_LENGTH)]
_Counts: TypeAlias = Annotated[Mapping[str, _Count], Meta(max_length=MAX_LENGTH)]


class Contact(NamedTuple):
    """Where a virtual tip touches what it cannot enter."""

    proxy: Vector  # m, where the tip would be if it could enter nothing; one entry per axis
    normal: Vector  # outward unit normal there, same shape


Shape: TypeAlias = Literal["plane", "sphere", "box", "cylinder", "mesh", "points", "path"]


class SceneObject(Struct, frozen=True, omit_defaults=True, gc=False):
    """One thing that a display may draw.

    ``size``, in m, depends on the shape: of a sphere its radius; of a box its edges along its own
    x, y and z; of a cylinder its radius, and its length along its own z; of a mesh the length of
    its file's unit; of the others nothing. A plane passes through ``position``, its own z is its
    outward normal. The points of a path are joined in their order.
    """

    name: _Name  # no other object of the scene has it
    shape: Shape
    position: Point = (0.0, 0.0, 0.0)  # m, of the object's centre or origin
    orientation: Quaternion = (1.0, 0.0, 0.0, 0.0)  # of the object's own axes
    size: Annotated[Vector, Meta(max_length=3)] = ()
    is_removed: bool = False  # whether it is cut out of the others: a hole, a cavity
    is_fixed: bool = True  # whether it stays where it is
    file: _Text | None = None  # of a mesh or points; a path on the environment's machine
    digest: _Digest | None = None  # sha256 of the file
    points: Annotated[tuple[Point, ...], Meta(max_length=MAX_LENGTH)] = ()  # m, of a path


class _Wire(Struct, frozen=True, kw_only=True, tag_field="packet", gc=False):
    """Common keys of all packets on the wire: ``packet``, ``version`` and ``hand``.

    A reader ignores keys that it does not know, and a key with a default may be missing: so a field
    with a default can be added to a packet without a new version.
    """

    version: Literal[4] = VERSION
    hand: Annotated[str, Meta(max_length=MAX_NAME)] = ""  # empty: of the only hand, or of all


class DeviceState(_Wire, frozen=True, tag="device_state"):
    """Readings of the device at the start of a tick."""

    seq: _Count  # tick number, counts from 0
    time_ns: _Count  # ns, device's clock, when the position was read
    elapsed: float  # s since the force engaged for the first time; 0 before
    position: _Vector  # m
    velocity: _Vector  # m/s, filtered backward difference
    force: _Vector  # N, held by the motor at time_ns
    orientation: Quaternion | None = None  # of the tip, of a device that senses it
    buttons: _Count | None = None  # bit i: button i is down; of a device that has any


class EnvironmentQuery(_Wire, frozen=True, tag="environment_query"):
    """Query of the controller to the environment."""

    seq: _Count
    time_ns: _Count
    device_seq: _Count
    device_time_ns: _Count
    elapsed: float  # s, of the device state
    position: _Vector  # m
    velocity: _Vector  # m/s
    environment: _Name | None  # the serving one; None: none, the first that replies will serve
    orientation: Quaternion | None = None  # as in the device state
    buttons: _Count | None = None


class EnvironmentReply(_Wire, frozen=True, tag="environment_reply"):
    """Reply of the environment to a query."""

    seq: _Count
    time_ns: _Count
    device_seq: _Count
    device_time_ns: _Count
    query_seq: _Count
    query_time_ns: _Count
    force: _Vector  # N
    environment: _Name  # name of the sender; no other process has it
    proxy: _Vector | None = None  # m, of an environment that tells contacts; None: free motion
    normal: _Vector | None = None  # outward unit normal at the proxy; None if the proxy is

    @property
    def contact(self) -> Contact | None:
        """The contact that the environment tells; None: free motion, or it tells none."""
        if self.proxy is None or self.normal is None:
            return None
        return Contact(self.proxy, self.normal)


class ForceCommand(_Wire, frozen=True, tag="force_command"):
    """Force command of the controller to the device."""

    seq: _Count
    time_ns: _Count
    device_seq: _Count
    device_time_ns: _Count
    force: _Vector  # N
    reply_time_ns: _Count | None = None  # ns, device_time_ns of the environment's reply in use


class Telemetry(_Wire, frozen=True, tag="telemetry"):
    """Telemetry of one tick of the device, at the instant of writing."""

    seq: _Count  # tick number
    time_ns: _Count  # ns, device's clock, when the force was written
    elapsed: float  # s since the force engaged for the first time; 0 before
    position: _Vector  # m, reading that the bounder used
    commanded_force: _Vector  # N, after age limit and engage ramp, before saturation and law
    applied_force: _Vector  # N, written to the motor; of an arm what its torques give at the tip
    force_limit: float  # N, largest magnitude that law and saturation allowed
    estimated_energy: float  # J, ledger of the law; its meaning depends on the law
    true_energy: float | None  # J, ground truth of a simulated device; None on hardware
    true_position: _Vector | None  # m, unquantised position of a simulated device
    hand_force: _Vector | None  # N, ground truth of a simulated device
    engagement: float  # 0 to 1, factor of the engage ramp
    device_seq: _Count | None  # tick whose state the force answers; None while there is no answer
    loop_delay: float | None  # s from that state to this write
    deadline_misses: _Count  # ticks skipped so far
    rejected: _Counts  # packets rejected so far, by reason
    read_ns: _Count | None = None  # ns, device's clock, when the position was read
    write_ns: _Count | None = None  # ns, device's clock, from when on the force acts
    joints: _Vector | None = None  # rad, reading of an arm
    torques: _Vector | None = None  # N m, written to the motors of an arm
    cut_ns: _Count | None = None  # ns, when the watchdog dropped the force before this one
    cut_position: _Vector | None = None  # m (of an arm rad), reading then
    ahead_ns: _Count | None = None  # ns, by which the bounder's clock is ahead of the device's
    reply_age: float | None = None  # s, from the state that the reply in use answers to this write


class Scene(_Wire, frozen=True, tag="scene"):
    """What there is to draw, and where the virtual tips are."""

    seq: _Count
    time_ns: _Count
    objects: Annotated[tuple[SceneObject, ...], Meta(max_length=MAX_LENGTH)]
    proxies: _Vectors = {}  # m, by hand; a hand in free motion has none


class Event(_Wire, frozen=True, tag="event"):
    """Event of a graph: a fault, a change, the beginning of a phase."""

    seq: _Count
    time_ns: _Count
    node: _Name  # process that sent it
    event: _Name  # kind of event, one word: "environment_refused", "parameter_set"
    is_fault: bool  # whether it is a fault
    message: _Text  # for people
    data: _Texts  # for programs, by name


Packet: TypeAlias = (
    DeviceState | EnvironmentQuery | EnvironmentReply | ForceCommand | Telemetry | Scene | Event
)


#: Packets by their name on the wire, which is also that of their topic.
TOPICS: dict[str, type[Packet]] = {
    "device_state": DeviceState,
    "environment_query": EnvironmentQuery,
    "environment_reply": EnvironmentReply,
    "force_command": ForceCommand,
    "telemetry": Telemetry,
    "scene": Scene,
    "event": Event,
}

TOPIC_OF: dict[type[Packet], str] = {packet: topic for topic, packet in TOPICS.items()}


def field_types(packet: type[Packet]) -> dict[str, Any]:
    """Return the names of the fields of ``packet``, in order, with their types.

    The types are the plain ones (``int``, ``Vector | None``, without limits); ``version`` belongs
    to the wire and is left out.
    """
    hints = get_type_hints(packet)
    return {name: hints[name] for name in packet.__struct_fields__ if name != "version"}
