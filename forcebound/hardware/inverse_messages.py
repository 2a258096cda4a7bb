"""Messages of the service of Haply's Inverse devices, version 3.5, as far as a driver needs them.

Keys that are not named here are passed over. Sources: the maker's documentation (docs.haply.co,
Inverse SDK 3.5); tests/golden/inverse3 has the messages, and says what no source states.
"""

from collections.abc import Sequence
from typing import Any

import msgspec
from msgspec import Struct, field

from forcebound.errors import DeviceError


class Xyz(Struct):
    """A vector of the service, in m or N."""

    x: float
    y: float
    z: float


class Quaternion(Struct):
    """An orientation of the service."""

    w: float = 1.0
    x: float = 0.0
    y: float = 0.0
    z: float = 0.0


class Transform(Struct):
    """A transform of the service; what is left out is the identity."""

    scale: Xyz = field(default_factory=lambda: Xyz(1.0, 1.0, 1.0))


class Enabled(Struct):
    """A feature that is on or off."""

    enabled: bool


class Gain(Struct):
    """The filter against oscillations."""

    gain: float


class Damping(Struct):
    """The damping that the service adds, in N s/m."""

    scalar: float = 0.0
    vector: Xyz | None = None


class Filters(Struct):
    """The filters of a session."""

    force_gate: Gain
    damping: Damping


class Basis(Struct):
    """The axes of a session."""

    permutation: str


class Config(Struct):
    """Configuration of a device; what 3.1 does not have is None."""

    gravity_compensation: Enabled
    torque_scaling: Enabled
    basis: Basis | None = None
    mount: Transform | None = None
    filters: Filters | None = None


class State(Struct):
    """State of a device."""

    cursor_position: Xyz
    current_cursor_force: Xyz | None = None
    control_mode: str = ""
    transform: Transform | None = None


class Status(Struct):
    """Status of a device."""

    calibrated: bool
    ready: bool
    started: bool
    in_use: bool = False


class Inverse3(Struct):
    """An Inverse3, as the inventory and states have it."""

    device_id: str
    state: State
    status: Status
    config: Config | None = None

    @property
    def lack(self) -> str:
        """What it needs before it can give a force; empty: nothing."""
        flags = ("calibrated", "ready", "started")
        return ", ".join(name for name in flags if not getattr(self.status, name))


class GripState(Struct):
    """State of a grip, with one button or three."""

    orientation: Quaternion = field(default_factory=Quaternion)
    button: bool = False
    buttons: dict[str, bool] = field(default_factory=dict)

    @property
    def bits(self) -> int:
        """Bit i: button i is down."""
        down = [self.buttons[name] for name in sorted(self.buttons)] or [self.button]
        return sum(is_down << place for place, is_down in enumerate(down))


class Grip(Struct):
    """A grip."""

    device_id: str
    state: GripState | None = None
    status: dict[str, Any] = field(default_factory=dict)

    @property
    def is_here(self) -> bool:
        """Whether it reports: connected and awake, if it says so."""
        return self.state is not None and all(
            self.status.get(name, True) for name in ("ready", "connected", "awake")
        )


class Message(Struct):
    """An inventory or a state: all devices."""

    session_id: int | None = None
    inverse3: Sequence[Inverse3] = ()
    verse_grip: Sequence[Grip] = ()
    wireless_verse_grip: Sequence[Grip] = ()


class Event(Struct):
    """An event of the service."""

    name: str
    level: str = ""
    message: str = ""
    data: dict[str, Any] = field(default_factory=dict)


_decode = msgspec.json.Decoder(Message).decode
_decode_event = msgspec.json.Decoder(Event).decode


def parse(data: bytes) -> Message:
    """Return the inventory or state in a message; DeviceError if it is none."""
    try:
        return _decode(data)
    except msgspec.MsgspecError as error:
        raise DeviceError(
            f"expected a state of the Haply service, got {data[:60]!r} ({error}): restart the"
            " service, or use a version from 3.5 up, below 4"
        ) from error


def parse_event(data: bytes) -> Event:
    """Return the event in a message; one without a name if it is none."""
    try:
        return _decode_event(data)
    except msgspec.MsgspecError:
        return Event("")


def framed(message: Any) -> bytes:
    """Return a message to the service as a WebSocket's frame."""
    from websockets.frames import Frame, Opcode

    return Frame(Opcode.TEXT, msgspec.json.encode(message)).serialize(mask=True)


def end_of_session() -> bytes:
    """Return the frame that ends a session."""
    from websockets.frames import Close, Frame, Opcode

    return Frame(Opcode.CLOSE, Close(1000, "").serialize()).serialize(mask=True)


def to_device(device_id: str, grips: Sequence[tuple[str, str]], **what: Any) -> dict[str, Any]:
    """Return a message for a device, which also asks its grips, by group and id, where they are."""
    message: dict[str, Any] = {"inverse3": [{"device_id": device_id, **what}]}
    for group, grip in grips:
        message[group] = [{"device_id": grip, "commands": {"probe_orientation": {}}}]
    return message


def chosen(found: Sequence[Inverse3], name: str) -> Inverse3:
    """Return the device with an id, or the only one; DeviceError if that is none, or several."""
    there = ", ".join(each.device_id for each in found) or "none"
    by_id = [each for each in found if each.device_id == name]
    if by_id or (len(found) == 1 and (name in ("auto", "emulated") or "/" in name)):
        return (by_id or found)[0]
    raise DeviceError(
        f"port {name!r}: expected the id of an Inverse3 of the service, or auto if it has one;"
        f" it has {there}: plug it in, or name one by its id"
    )
