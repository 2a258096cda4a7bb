"""Messages of the service of Haply's Inverse devices, version 3.5, as far as a driver needs them.

Keys that are not named here are passed over. Sources: the maker's documentation (docs.haply.co,
Inverse SDK 3.5); tests/golden/inverse3 has the messages, and says what no source states.
"""

from collections.abc import Iterator, Sequence
from typing import Any

import msgspec
from msgspec import Struct, field

from forcebound.errors import DeviceError


class Xyz(Struct):
    """A vector of the service, in m or N."""

    x: float = 0.0
    y: float = 0.0
    z: float = 0.0


class State(Struct):
    """State of a device."""

    cursor_position: Xyz
    current_cursor_force: Xyz = field(default_factory=Xyz)
    control_mode: str = ""
    transform: dict[str, Any] = field(default_factory=dict)  # without what is the identity


class Inverse3(Struct):
    """An Inverse3, as the inventory and states have it."""

    device_id: str
    state: State
    status: dict[str, Any]
    config: dict[str, Any] = field(default_factory=dict)

    @property
    def lack(self) -> str:
        """What it needs before it can give a force; empty: nothing."""
        flags = ("calibrated", "ready", "started")
        return ", ".join(name for name in flags if self.status.get(name) is not True)


class GripState(Struct):
    """State of a grip, with one button or three."""

    orientation: dict[str, float] = field(default_factory=dict)  # w x y z
    button: bool = False
    buttons: dict[str, bool] = field(default_factory=dict)


class Grip(Struct):
    """A grip."""

    device_id: str
    state: GripState
    status: dict[str, Any] = field(default_factory=dict)

    @property
    def is_here(self) -> bool:
        """Whether it reports: connected and awake, if it says so."""
        return all(self.status.get(name, True) for name in ("ready", "connected", "awake"))


class Message(Struct):
    """An inventory or a state: all devices."""

    session_id: int | None = None
    inverse3: Sequence[Inverse3] = ()
    verse_grip: Sequence[Grip] = ()
    wireless_verse_grip: Sequence[Grip] = ()

    @property
    def grips(self) -> Iterator[tuple[str, Grip]]:
        """The grips that report, each with the name of its group."""
        for group in ("verse_grip", "wireless_verse_grip"):
            yield from ((group, grip) for grip in getattr(self, group) if grip.is_here)


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
    from websockets.frames import Frame, Opcode

    return Frame(Opcode.CLOSE, b"").serialize(mask=True)


def to_device(device_id: str, grips: Sequence[tuple[str, str]], **what: Any) -> dict[str, Any]:
    """Return a message for a device, which also asks its grips, by group and id, where they are."""
    message: dict[str, Any] = {"inverse3": [{"device_id": device_id, **what}]}
    for group, grip in grips:
        message[group] = [{"device_id": grip, "commands": {"probe_orientation": {}}}]
    return message


def chosen(found: Sequence[Inverse3], name: str) -> Inverse3:
    """Return the device with an id, or the only one; DeviceError if that is none, or several."""
    there = ", ".join(each.device_id for each in found)
    by_id = [each for each in found if each.device_id == name]
    if by_id or (len(found) == 1 and (name in ("auto", "emulated") or "/" in name)):
        return (by_id or found)[0]
    if not there:
        raise DeviceError("the service has no Inverse3: plug it in")
    example = f"launch with device:={found[0].device_id}"
    if len(found) > 1 and name == "auto":
        raise DeviceError(f"the service has several Inverse3, {there}: {example}, or another one")
    raise DeviceError(
        f"the service has no Inverse3 {name}; it has {there}: {example}, or plug {name} in"
    )
