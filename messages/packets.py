"""Packets: one frozen class each, and the table of topics.

The classes are msgspec structs: compiled code creates, encodes and checks them, because each tick
needs four. Creating a packet checks nothing; decoding does. Only the objects of a scene, which no
tick needs, are checked when they are made, too.

Every packet carries ``seq`` (counts from 0 at its sender) and ``time_ns`` (the sender's
monotonic clock). An answer echoes ``device_seq`` and ``device_time_ns`` of the device state that it
answers, so a loop delay is measured on the device's clock alone. ``hand`` names the hand to whose
loop a packet belongs.

To add a field: a line in its class, at the end and with a default, so that older programs stay
compatible; what fills it; its row in ``docs/protocol.md``. Codec, recordings, schemas, tables and
``forcebound echo`` take it from here; ``tests/golden_packets.py`` holds its bytes.

Vectors are tuples of 1 to 8 floats, one per axis: in m and N, or in rad and N m where the axis is
an angle (:mod:`forcebound.axes`). The objects of a scene are in space, whatever the axes. Positions
grow *into* the environment; a force is positive when it *resists* motion in the positive direction
(``docs/theory.md``, section 1).
"""

import reprlib
from collections.abc import Mapping
from functools import cache
from itertools import chain
from math import isfinite
from typing import Annotated, Any, Final, Literal, NamedTuple, TypeAlias, get_type_hints

from msgspec import UNSET, Meta, Struct, UnsetType
from msgspec.inspect import type_info

VERSION: Final = 5  # of the wire format; every packet carries it

MAX_AXES = 8
MAX_COUNT = 2**63 - 1  # the largest 64-bit integer that every language has
MAX_ENERGY = 1e5  # J, that a ledger gives in its life
MAX_LENGTH = 64  # of any array or map on the wire
MAX_NAME = 64  # characters of a name
NAMES = ("hand", "environment", "node", "event")  # keys whose text is printable, on one line
MAX_TEXT = 500  # characters of a text for people
MAX_SIGNALS = 128  # of a packet, which holds no more than 8192 bytes: an arm and five boxes
SIGNAL_NAME = "^[A-Za-z][A-Za-z0-9_]{0,31}$"  # it becomes part of names of columns

Vector: TypeAlias = tuple[float, ...]
Point: TypeAlias = tuple[float, float, float]  # m, in space, whatever number of axes a device has
Quaternion: TypeAlias = tuple[float, float, float, float]  # w x y z; of length 1: an orientation


def _means(meaning: str, unit: str = "") -> Meta:
    """Return the meaning of a field, for schemas and tables; a count, share or text has no unit."""
    return Meta(description=meaning, extra_json_schema={"unit": unit})


# The same types with the limits that the decoder checks.
_Count: TypeAlias = Annotated[int, Meta(ge=0, le=MAX_COUNT)]
_Energy: TypeAlias = Annotated[float, Meta(ge=0.0, le=MAX_ENERGY)]
_Vector: TypeAlias = Annotated[Vector, Meta(min_length=1, max_length=MAX_AXES)]
_Name: TypeAlias = Annotated[str, Meta(min_length=1, max_length=MAX_NAME)]
_Text: TypeAlias = Annotated[str, Meta(max_length=MAX_TEXT)]
_Digest: TypeAlias = Annotated[str, Meta(pattern="^[0-9a-f]{64}$")]
_Texts: TypeAlias = Annotated[Mapping[str, _Text], Meta(max_length=MAX_LENGTH)]
_Vectors: TypeAlias = Annotated[Mapping[str, _Vector], Meta(max_length=MAX_LENGTH)]
_Counts: TypeAlias = Annotated[Mapping[str, _Count], Meta(max_length=MAX_LENGTH)]
_SignalName: TypeAlias = Annotated[str, Meta(pattern=SIGNAL_NAME)]
_Numbers: TypeAlias = Annotated[Mapping[_SignalName, float], Meta(max_length=MAX_SIGNALS)]
# Without signals, or without a sensor, the key is not sent.
_Signals: TypeAlias = Annotated[_Numbers | UnsetType, _means("published by the sender, by name")]
_Measured: TypeAlias = Annotated[
    _Vector | UnsetType, _means("of the hand on the tip, by a sensor; signs of hand_force", "N")
]


class Contact(NamedTuple):
    """Contact of a virtual tip with what it cannot enter."""

    proxy: Vector  # m, where the tip would be if it could enter nothing; one entry per axis
    normal: Vector  # outward unit normal there, same shape


Shape: TypeAlias = Literal["plane", "sphere", "box", "cylinder", "mesh", "points", "path"]


class SceneObject(Struct, frozen=True, omit_defaults=True, gc=False):
    """One thing that a display may draw.

    ``size``, in m, depends on the shape: of a sphere its radius; of a box its edges along its
    x, y and z; of a cylinder its radius, and its length along its z; of a mesh the length of
    its file's unit; of the others nothing. A plane passes through ``position``, its z is its
    outward normal. The points of a path are joined in their order.

    Raises:
        ValueError: If a number is not finite, or a name has a control character.
    """

    name: _Name  # no other object of the scene has it
    shape: Shape
    position: Point = (0.0, 0.0, 0.0)  # m, of the object's centre or origin
    orientation: Quaternion = (1.0, 0.0, 0.0, 0.0)  # of the object's axes
    size: Annotated[Vector, Meta(max_length=3)] = ()
    is_removed: bool = False  # whether it is cut out of the others: a hole, a cavity
    is_fixed: bool = True  # whether it stays where it is
    file: _Text | None = None  # of a mesh or points; a path on the environment's machine
    digest: _Digest | None = None  # sha256 of the file
    points: Annotated[tuple[Point, ...], Meta(max_length=MAX_LENGTH)] = ()  # m, of a path

    def __post_init__(self) -> None:
        if not (self.name.isprintable() and (self.file or "").isprintable()):
            raise ValueError(f"expected printable text on one line, got {reprlib.repr(self.name)}")
        numbers = (self.position, self.orientation, self.size, *self.points)
        if not all(map(isfinite, chain.from_iterable(numbers))):
            raise ValueError(f"expected finite numbers, got {reprlib.repr(numbers)} of {self.name}")


class _Wire(Struct, frozen=True, kw_only=True, tag_field="packet", gc=False):
    """Common keys of all packets on the wire: ``packet``, ``version`` and ``hand``.

    A reader ignores keys that it does not know, and a key with a default may be missing: so a field
    with a default can be added to a packet without a new version.
    """

    version: Literal[5] = VERSION
    hand: Annotated[
        str,
        Meta(max_length=MAX_NAME),
        _means("to whose loop it belongs; hand: the only one, or all"),
    ] = "hand"


class DeviceState(_Wire, frozen=True, tag="device_state"):
    """Readings of the device at the start of a tick."""

    seq: Annotated[_Count, _means("tick number, from 0")]
    time_ns: Annotated[_Count, _means("device's clock, when the position was read", "ns")]
    elapsed: Annotated[float, _means("since the force engaged for the first time; 0 before", "s")]
    position: Annotated[_Vector, _means("reading; grows into the environment", "m")]
    velocity: Annotated[_Vector, _means("filtered backward difference of the readings", "m/s")]
    force: Annotated[_Vector, _means("held by the motor at time_ns", "N")]
    orientation: Annotated[Quaternion | None, _means("unit quaternion w x y z of the tip")] = None
    buttons: Annotated[_Count | None, _means("bit i: button i of the device is down")] = None
    signals: _Signals = UNSET
    measured_force: _Measured = UNSET


class EnvironmentQuery(_Wire, frozen=True, tag="environment_query"):
    """Query of the controller to the environment."""

    seq: Annotated[_Count, _means("count of this packet at its sender, from 0")]
    time_ns: Annotated[_Count, _means("sender's monotonic clock", "ns")]
    device_seq: Annotated[_Count, _means("seq of the device state that is answered")]
    device_time_ns: Annotated[_Count, _means("time_ns of the device state that is answered", "ns")]
    elapsed: Annotated[float, _means("since the force engaged for the first time; 0 before", "s")]
    position: Annotated[_Vector, _means("where the environment is evaluated", "m")]
    velocity: Annotated[_Vector, _means("where the environment is evaluated", "m/s")]
    environment: Annotated[_Name | None, _means("that serves; none: the first to reply does")]
    orientation: Annotated[Quaternion | None, _means("unit quaternion w x y z of the tip")] = None
    buttons: Annotated[_Count | None, _means("bit i: button i of the device is down")] = None
    measured_force: _Measured = UNSET
    signals: _Signals = UNSET


class EnvironmentReply(_Wire, frozen=True, tag="environment_reply"):
    """Reply of the environment to a query."""

    seq: Annotated[_Count, _means("count of this packet at its sender, from 0")]
    time_ns: Annotated[_Count, _means("sender's monotonic clock", "ns")]
    device_seq: Annotated[_Count, _means("seq of the device state that is answered")]
    device_time_ns: Annotated[_Count, _means("time_ns of the device state that is answered", "ns")]
    query_seq: Annotated[_Count, _means("seq of the query that is answered")]
    query_time_ns: Annotated[_Count, _means("time_ns of the query, controller's clock", "ns")]
    force: Annotated[_Vector, _means("of the environment; resists motion if positive", "N")]
    environment: Annotated[_Name, _means("name of the sender; no other process has it")]
    proxy: Annotated[
        _Vector | None, _means("where the tip would be if it could enter nothing; none: free", "m")
    ] = None
    normal: Annotated[_Vector | None, _means("outward unit normal at the proxy")] = None
    signals: _Signals = UNSET

    @property
    def contact(self) -> Contact | None:
        """The contact that the environment reports; None: free motion, or it reports none."""
        if self.proxy is None or self.normal is None:
            return None
        return Contact(self.proxy, self.normal)


class ForceCommand(_Wire, frozen=True, tag="force_command"):
    """Force command of the controller to the device."""

    seq: Annotated[_Count, _means("count of this packet at its sender, from 0")]
    time_ns: Annotated[_Count, _means("sender's monotonic clock", "ns")]
    device_seq: Annotated[_Count, _means("seq of the device state that is answered")]
    device_time_ns: Annotated[_Count, _means("time_ns of the device state that is answered", "ns")]
    force: Annotated[_Vector, _means("commanded; the device may apply less", "N")]
    reply_time_ns: Annotated[
        _Count | None,
        _means("device_time_ns of the environment's reply in use, device's clock", "ns"),
    ] = None
    signals: _Signals = UNSET


class Telemetry(_Wire, frozen=True, tag="telemetry"):
    """Telemetry of one tick of the device, at the instant of writing."""

    seq: Annotated[_Count, _means("tick number, from 0")]
    time_ns: Annotated[_Count, _means("device's clock, when the force was written", "ns")]
    elapsed: Annotated[float, _means("since the force engaged for the first time; 0 before", "s")]
    position: Annotated[_Vector, _means("reading that the bounder used", "m")]
    commanded_force: Annotated[_Vector, _means("after age limit and ramp, before saturation", "N")]
    applied_force: Annotated[
        _Vector, _means("written to the motor; of an arm, that at its tip", "N")
    ]
    force_limit: Annotated[float, _means("largest magnitude that law and saturation allowed", "N")]
    estimated_energy: Annotated[float, _means("in the ledger of the law, which defines it", "J")]
    true_energy: Annotated[float | None, _means("from the hand into a simulated device", "J")]
    true_position: Annotated[_Vector | None, _means("unquantised, of a simulated device", "m")]
    hand_force: Annotated[_Vector | None, _means("of a simulated hand on its device", "N")]
    engagement: Annotated[float, _means("factor of the engage ramp, 0 to 1")]
    device_seq: Annotated[
        _Count | None, _means("tick whose state the force answers; none: no answer")
    ]
    loop_delay: Annotated[float | None, _means("from the answered state to this write", "s")]
    deadline_misses: Annotated[_Count, _means("ticks skipped so far")]
    rejected: Annotated[_Counts, _means("packets rejected so far, by reason")]
    read_ns: Annotated[
        _Count | None, _means("device's clock, when the position was read", "ns")
    ] = None
    write_ns: Annotated[_Count | None, _means("device's clock, when the force begins", "ns")] = None
    joints: Annotated[_Vector | None, _means("angles of an arm, as read", "rad")] = None
    torques: Annotated[_Vector | None, _means("written to the motors of an arm", "N m")] = None
    cut_ns: Annotated[_Count | None, _means("when the watchdog dropped the force before", "ns")] = (
        None
    )
    cut_position: Annotated[
        _Vector | None, _means("reading at cut_ns; of an arm its angles", "m")
    ] = None
    ahead_ns: Annotated[
        _Count | None, _means("by which the bounder's clock is ahead of the device's", "ns")
    ] = None
    reply_age: Annotated[
        float | None, _means("from the state that the reply in use answers to this write", "s")
    ] = None
    given_energy: Annotated[
        float | None, _means("to the energy_partner since the force engaged", "J")
    ] = None
    received_energy: Annotated[float | None, _means("likewise from it", "J")] = None
    velocity: Annotated[
        _Vector | None, _means("filtered backward difference of the readings", "m/s")
    ] = None


class EnergyTransfer(_Wire, frozen=True, tag="energy_transfer"):
    """Energy that the bounder of a hand has given to that of its energy_partner.

    Totals, not amounts: so a packet that is lost, late, doubled or overtaken changes nothing.
    """

    seq: Annotated[_Count, _means("count of this packet at its sender, from 0")]
    time_ns: Annotated[_Count, _means("sender's monotonic clock", "ns")]
    ledger: Annotated[_Count, _means("number of the sender's ledger, which grows; 0: none yet")]
    given: Annotated[_Energy, _means("by this ledger since it began", "J")]
    spare: Annotated[float, _means("in it beyond the need of the commanded force", "J")]
    seen_ledger: Annotated[_Count, _means("newest ledger of the receiver that is known; 0: none")]
    seen: Annotated[
        _Energy | None, _means("largest given of that ledger that counts; none: no total yet", "J")
    ]


class Scene(_Wire, frozen=True, tag="scene"):
    """Objects to draw, and places of the virtual tips."""

    seq: Annotated[_Count, _means("count of this packet at its sender, from 0")]
    time_ns: Annotated[_Count, _means("sender's monotonic clock", "ns")]
    objects: Annotated[
        tuple[SceneObject, ...], Meta(max_length=MAX_LENGTH), _means("what there is to draw", "m")
    ]
    proxies: Annotated[
        _Vectors, _means("virtual tips by hand; a hand in free motion has none", "m")
    ] = {}


class Event(_Wire, frozen=True, tag="event"):
    """Event of a graph: a fault, a change, the beginning of a phase."""

    seq: Annotated[_Count, _means("count of this packet at its sender, from 0")]
    time_ns: Annotated[_Count, _means("sender's monotonic clock", "ns")]
    node: Annotated[_Name, _means("process that sent it")]
    event: Annotated[_Name, _means("kind of event, one word")]
    is_fault: Annotated[bool, _means("whether it is a fault")]
    message: Annotated[_Text, _means("description for people")]
    data: Annotated[_Texts, _means("details for programs, by name")]


Packet: TypeAlias = (
    DeviceState
    | EnvironmentQuery
    | EnvironmentReply
    | ForceCommand
    | Telemetry
    | EnergyTransfer
    | Scene
    | Event
)


#: Packets by their name on the wire, which is also that of their topic.
TOPICS: dict[str, type[Packet]] = {
    "device_state": DeviceState,
    "environment_query": EnvironmentQuery,
    "environment_reply": EnvironmentReply,
    "force_command": ForceCommand,
    "telemetry": Telemetry,
    "energy_transfer": EnergyTransfer,
    "scene": Scene,
    "event": Event,
}

TOPIC_OF: dict[type[Packet], str] = {packet: topic for topic, packet in TOPICS.items()}


class Meaning(NamedTuple):
    """Meaning of a field of a packet."""

    text: str
    unit: str  # SI; "" for a count, a share or a text


def meanings(packet: type[Packet]) -> dict[str, Meaning]:
    """Return the meaning of each field of ``packet``, but for ``version``, in order."""
    described: Any = type_info(packet)
    about = {field.name: field.type for field in described.fields if field.name != "version"}
    schemas = {name: kind.extra_json_schema for name, kind in about.items()}
    return {name: Meaning(each["description"], each["unit"]) for name, each in schemas.items()}


@cache  # asked for each packet of a recording that becomes a table
def field_types(packet: type[Packet]) -> dict[str, Any]:
    """Return the names of the fields of ``packet``, in order, with their types.

    The types are the plain ones (``int``, ``Vector | None``, without limits); ``version`` belongs
    to the wire and is left out.
    """
    hints = get_type_hints(packet)
    return {name: hints[name] for name in packet.__struct_fields__ if name != "version"}
