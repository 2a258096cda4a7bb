"""The Inverse3's service, version 3.5, as its clients see it; without a clock or a socket.

One state for each message of a session, settings over HTTP, events beside them. What is known of
the real service and what is assumed: ``tests/golden/inverse3/README.md`` and docs/devices.md.
"""

import math
from collections import deque
from collections.abc import Iterable
from typing import Any, NamedTuple, TypeAlias

import msgspec
from msgspec import UNSET, convert, to_builtins

from forcebound.haptics.devices.kinematics import tip_force
from forcebound.haptics.devices.truth_file import NOT_YET, TruthFile
from forcebound.haptics.hands import Operator
from forcebound.hardware.emulators import inverse3_messages as wire
from forcebound.hardware.emulators.faults import Faults
from forcebound.hardware.emulators.inverse3 import ZERO, Inverse3, Pull

Json: TypeAlias = dict[str, Any]

DEVICE_ID, OTHER_ID = "049D", "04BA"
EXAMPLE = (0.0, -0.12, 0.15)  # m, the tip's place in the maker's example, with the preset defaults
FIRST_SESSION, OTHER_SESSION = 7, 0  # numbers; the other one is that of the fault "busy"
BUSY_FORCE = (0.5, 0.0, 0.0)  # N, of that
NEWTON_MILLIMETRE = 1e-3  # N m, unit of joint torques, assumed
LATE_NS = 20_000_000
OK, BAD_REQUEST, NOT_FOUND = 200, 400, 404

_message = msgspec.json.Decoder(wire.Message).decode
_encode, _decode = msgspec.json.encode, msgspec.json.decode

#: What is always the same in the inventory and in a state, and what 3.1 does not have.
CONFIG: Json = _decode(
    """{"type": "inverse3", "streaming_mode": "USB", "basis": {"permutation": "XYZ"},
    "device_info": {"major_version": 7, "minor_version": 4, "id": "049D", "device_type": 4,
    "uuid": "2D35F80DD9005F599B68F49944CB049D"}, "mount": {"position": {"x": 0, "y": 0, "z": 0},
    "rotation": {"w": 1, "x": 0, "y": 0, "z": 0}, "scale": {"x": 1, "y": 1, "z": 1}}}"""
)
STATE: Json = _decode(
    """{"angular_velocity": {"a0": 0, "a1": 0, "a2": 0}, "body_orientation": {"w": 1, "x": 0,
    "y": 0, "z": 0}, "current_cursor_position": {"x": 0, "y": 0, "z": 0}, "transform": {},
    "current_angular_position": {"a0": 0, "a1": 0, "a2": 0}, "control_domain": "cartesian"}"""
)
GRIP: Json = _decode(
    """{"device_id": "0", "config": {"type": "wireless_verse_grip", "major_version": 1,
    "minor_version": 4}, "status": {"ready": true, "connected": true, "awake": true}}"""
)
NOT_IN_OLD: tuple[str, ...] = ("session_id", "streaming_mode", "basis", "mount", "home_return")
NOT_IN_OLD += ("preset", "filters", "transform", "control_domain", "control_mode")
NOT_IN_OLD += ("current_cursor_force", "current_cursor_position")
NOT_IN_OLD += ("current_angular_torques", "current_angular_position")

#: Settings of a session, until it sets others.
DEFAULTS = wire.Configure(wire.Preset("defaults"), wire.ForceGate(0.3), wire.Damping(0.0))

SAFETY = "device-safety-triggered"
#: Events at the begin of a fault and at its end: name, level, safety type.
EVENTS = {
    ("unplug", True): ("device-disconnected", "warning", ""),
    ("unplug", False): ("device-connected", "info", ""),
    ("busy", True): ("device-busy", "warning", ""),
    ("ebrake", True): (SAFETY, "error", "ebrake_triggered"),
    ("ebrake", False): (SAFETY, "notice", "ebrake_released"),
    ("motor_stall", True): (SAFETY, "warning", "stall_detected"),
}


class Outgoing(NamedTuple):
    """A message to a session, and when it goes out."""

    due_ns: int
    session: int
    text: bytes


class Service:
    """The service with its one device and a grip.

    Attributes:
        port: Of the device, as the service shows it.
        settings: Of the service.
        events: Messages to everybody at the channel of events, to be sent and removed.
        outgoing: Those to sessions, in the order of their times, likewise.
        replies: Number of states so far.
    """

    def __init__(
        self, device: Inverse3, operator: Operator | None, faults: Faults, truth: TruthFile
    ) -> None:
        self._device, self._operator = device, operator
        self._faults, self._truth = faults, truth
        self._is_old = faults.is_planned("old")
        self.port, self.replies = "", 0
        self.settings: Json = {
            "devices/force_scale": 1.0,
            "communication/bind_all_interfaces": False,
        }
        self.sessions: dict[int, wire.Configure] = {}
        self.events: deque[bytes] = deque()
        self.outgoing: deque[Outgoing] = deque()
        self._newest = FIRST_SESSION - 1
        self._waiting: deque[tuple[int, bytes]] = deque()
        self._on: set[str] = set()  # faults that have begun with an event

    def is_away(self, time_ns: int) -> bool:
        """Return whether the service does not run."""
        return self._faults.is_on("restart", time_ns)

    def connect(self, time_ns: int) -> tuple[int, bytes]:
        """Begin a session; return its number and the inventory."""
        self._newest += 1
        self.sessions[self._newest] = DEFAULTS
        return self._newest, self._state(self._newest, time_ns, has_config=True)

    def disconnect(self, session: int, time_ns: int) -> None:
        """End a session; its force ends with it."""
        del self.sessions[session]
        self._device.advance(time_ns)
        self._device.pull(session, None, time_ns)
        if not self.sessions:
            self._truth.forget()
            self._device.mechanism.hold_home(time_ns)

    def receive(self, session: int, text: bytes, time_ns: int) -> None:
        """Take a message of a session."""
        self._waiting.append((session, text))
        self.tick(time_ns)

    def tick(self, time_ns: int) -> None:
        """Move on to this time, answer what waits, and publish the ground truth."""
        device, mechanism = self._device, self._device.mechanism
        truth = device.advance(time_ns)
        for kind in ("unplug", "busy", "ebrake", "motor_stall"):
            self._follow(kind, self._faults.is_on(kind, time_ns), time_ns)
        while self._waiting and not self._faults.is_on("stall", time_ns):
            session, text = self._waiting.popleft()
            if session in self.sessions:
                self._answer(session, text, time_ns)
        if self.sessions and self.replies:
            mechanism.use(time_ns, may_move=self._truth.engaged_ns != NOT_YET)
        self._truth.write(time_ns, truth, mechanism.torque, mechanism.torque_ns)

    def _follow(self, kind: str, is_on: bool, time_ns: int) -> None:
        """Let a fault act that begins or ends with an event."""
        if kind == "busy" and (is_on or kind in self._on):
            other = Pull(BUSY_FORCE, 0.0, ZERO, time_ns) if is_on else None
            self._device.pull(OTHER_SESSION, other, time_ns)
        if is_on != (kind in self._on):
            self._on ^= {kind}
            self._device.is_locked = bool(self._on - {"busy"})
            self._device.apply(time_ns)
            self._announce(kind, is_on)

    def _announce(self, kind: str, is_on: bool) -> None:
        if (kind, is_on) in EVENTS:
            name, level, safety = EVENTS[kind, is_on]
            data = {"device_family": "inverse", "device_id": DEVICE_ID}
            data |= {"safety_type": safety} if safety else {}
            event = {"name": name, "category": "device", "level": level, "data": data}
            self.events.append(_encode({**event, "message": safety or name}))

    def _answer(self, session: int, text: bytes, time_ns: int) -> None:
        pull, message = None, wire.Message()
        try:
            message = _message(text)
            for part in message.inverse3:
                if part.device_id == DEVICE_ID and "unplug" not in self._on:
                    self._configure(session, part.configure)
                    pull = self._pull(session, part.commands, time_ns) or pull
        except msgspec.MsgspecError:
            pass  # assumed: it is answered all the same
        pulls = self._device.pulls
        if pull and pulls and session not in pulls:
            self._announce("busy", is_on=True)
        self._device.pull(session, pull, time_ns)
        has_config = "force_render_full_state" in message.session
        reply, is_on = self._state(session, time_ns, has_config), self._faults.is_on
        self.replies += 1
        self._faults.begin(time_ns)
        if is_on("foreign", time_ns):
            reply = reply.replace(DEVICE_ID.encode(), OTHER_ID.encode())
        if is_on("malformed", time_ns):
            reply = reply[: len(reply) // 2]
        due_ns = time_ns + LATE_NS * is_on("late", time_ns)
        if self.outgoing:  # replies keep their order
            due_ns = max(due_ns, self.outgoing[-1].due_ns)
        self.outgoing.extend([Outgoing(due_ns, session, reply)] * (1 + is_on("doubled", time_ns)))

    def _configure(self, session: int, wanted: Json) -> None:
        """Take settings of a session over; msgspec.ValidationError if they do not fit."""
        if wanted:
            both = to_builtins(self.sessions[session]) | wanted
            self.sessions[session] = convert(both, wire.Configure)

    def _pull(self, session: int, commands: wire.Commands, time_ns: int) -> Pull | None:
        """Return what the commands of a device want of its motors; None: nothing."""
        linear, angular = commands.set_cursor_force, commands.set_angular_torques
        if linear is UNSET and not angular:
            return None
        force = ZERO
        if linear is not UNSET:
            given = linear.values if linear.vector is UNSET else linear.vector
            force = ZERO if given is UNSET else given.entries()
        if angular:
            torques = tuple([NEWTON_MILLIMETRE * t for t in angular["torques"].entries()])
            kinematics, angles = self._device.kinematics, self._device.mechanism.angles
            added = tip_force(kinematics, angles, torques, ZERO, ZERO)
            force = tuple([a + b for a, b in zip(force, added, strict=True)])
        settings = self.sessions[session]
        return Pull(force, settings.force_gate.gain, settings.damping.entries(), time_ns)

    def _state(self, session: int, time_ns: int, has_config: bool) -> bytes:
        """Return what a session gets to read."""
        devices = self._devices(self.sessions[session], time_ns, has_config)
        return _encode(self._known({"session_id": session, **devices}))

    def _devices(self, settings: wire.Configure, time_ns: int, has_config: bool) -> Json:
        hand = self._operator
        elapsed = (time_ns - max(self._truth.engaged_ns, 0)) * 1e-9
        down = 0 if hand is None else hand.buttons(elapsed) or 0
        buttons = {name: bool(down >> k & 1) for k, name in enumerate("abc")}
        orientation = STATE["body_orientation"]
        grip = {**GRIP, "state": {"buttons": buttons, "hall": 0, "orientation": orientation}}
        inverse3: Json = {"device_id": DEVICE_ID, "state": self._known(self._motion(settings))}
        inverse3["status"] = {
            "calibrated": not self._faults.is_planned("uncalibrated"),
            "in_use": bool(self._device.pulls),
            "power_supply": True,
            "ready": not self._device.is_locked,
            "started": True,
        }
        if has_config:
            inverse3["config"] = self._known(self._config(settings))
        else:
            del grip["config"]
        present = [] if "unplug" in self._on else [inverse3]
        return {"inverse3": present, "verse_grip": [], "wireless_verse_grip": [grip]}

    def _known(self, whole: Json) -> Json:
        """Return what a version has of a part of a message."""
        if not self._is_old:
            return whole
        kept = {key: value for key, value in whole.items() if key not in NOT_IN_OLD}
        return kept | ({"mode": whole["control_mode"]} if "control_mode" in whole else {})

    def _motion(self, settings: wire.Configure) -> Json:
        """Return the state of the device; velocities of the joints are 0, as in every sample."""
        device, angles = self._device, self._device.mechanism.angles
        offset = EXAMPLE if settings.preset.preset == "defaults" else ZERO
        place = zip(device.kinematics.position(angles), offset, strict=True)
        torques = device.kinematics.torque(angles, device.force)
        return {
            **STATE,
            "cursor_position": _vec(a + b for a, b in place),
            "cursor_velocity": _vec(device.mechanism.truth().velocity),
            "angular_position": _angles(map(math.degrees, angles)),
            "current_cursor_force": _vec(device.force),
            "current_angular_torques": _angles(t / NEWTON_MILLIMETRE for t in torques),
            "control_mode": "force" if device.pulls else "idle",
        }

    def _config(self, settings: wire.Configure) -> Json:
        shared: Json = to_builtins(self._device.shared)
        own: Json = to_builtins(settings)
        filters = {name: own.pop(name) for name in ("force_gate", "damping")}
        shared |= {**shared.pop("handedness"), **own.pop("preset")}
        return {**CONFIG, **shared, "port": self.port, "filters": filters}

    def request(
        self, method: str, path: str, selector: str, body: bytes, time_ns: int
    ) -> tuple[int, Json]:
        """Answer an HTTP request with a status; ``selector`` is that of its session."""
        self._device.advance(time_ns)
        try:
            wanted = _decode(body) if method == "POST" else None
            match path.strip("/").split("/", 3):
                case ["version"]:
                    found = "3.1.1" if self._is_old else "3.5.0"
                    found = "4.0.0" if self._faults.is_planned("new") else found
                    name = "haply-inverse-service"
                    return OK, {"project_name": name, "project_version": f"{found}.0"}
                case ["devices"]:
                    return OK, self._devices(DEFAULTS, time_ns, has_config=True)
                case ["settings", *names]:
                    return self._setting("/".join(names), wanted)
                case ["inverse3", "*", "config", _] if wanted is None:
                    return BAD_REQUEST, {"ok": False, "error": "ambiguous device selector"}
                case ["inverse3", "*" | "0" | "049D", "config", key] if "unplug" not in self._on:
                    return self._configured(key, selector, wanted)
        except msgspec.MsgspecError as error:
            return BAD_REQUEST, {"ok": False, "error": str(error)}
        finally:
            self._device.apply(time_ns)
        return NOT_FOUND, {"ok": False, "error": f"nothing is at {path}"}

    def _setting(self, key: str, wanted: Any) -> tuple[int, Json]:
        """Read or write settings of the service."""
        if wanted is None and key in self.settings:
            return OK, {"ok": True, "data": self.settings[key]}
        if wanted is None:
            return NOT_FOUND, {"ok": False, "error": f"no setting {key!r}"}
        self.settings |= convert({key: wanted} if key else wanted, wire.Writable)
        self._device.force_scale = self.settings["devices/force_scale"]
        return OK, {"ok": True}

    def _configured(self, key: str, selector: str, wanted: Any) -> tuple[int, Json]:
        """Read or write settings of the device, some of which a session owns."""
        shared: Json = to_builtins(self._device.shared)
        if key in shared:
            shared |= {} if wanted is None else {key: wanted}
            self._device.shared = convert(shared, wire.Shared)
            return OK, {"ok": True, "data": to_builtins(self._device.shared)[key]}
        session, name = self._selected(selector), key.removeprefix("filters/")
        if session is None or name not in wire.Configure.__struct_fields__:
            return NOT_FOUND, {"ok": False, "error": f"no {key!r} of a session {selector!r}"}
        self._configure(session, {} if wanted is None else {name: wanted})
        return OK, {"ok": True, "data": to_builtins(self.sessions[session])[name]}

    def _selected(self, selector: str) -> int | None:
        """Return the session of a selector: its number, or its place behind a colon."""
        named = {str(number): number for number in self.sessions}
        named |= {f":{place}": number for place, number in enumerate(self.sessions)}
        newest = max(self.sessions, default=None)
        return newest if selector == ":-1" else named.get(selector.removeprefix("#"))


def _vec(numbers: Iterable[float]) -> Json:
    return dict(zip("xyz", numbers, strict=True))


def _angles(numbers: Iterable[float]) -> Json:
    return dict(zip(("a0", "a1", "a2"), numbers, strict=True))
