"""The Inverse3's service, version 3.5, as its clients see it; without a clock or a socket.

One state for each message of a session, settings over HTTP, events beside them. What is known of
the real service and what is assumed: ``tests/golden/inverse3/README.md`` and docs/devices.md.
"""

import math
from collections import deque
from collections.abc import Sequence
from http import HTTPStatus
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
UUID = f"2D35F80DD9005F599B68F49944CB{DEVICE_ID}"
EXAMPLE = (0.0, -0.12, 0.15)  # m, the tip's place in the maker's example, with the preset defaults
FIRST_SESSION, OTHER_SESSION = 7, 0  # numbers; the other one is that of the fault "busy"
BUSY_FORCE = (0.5, 0.0, 0.0)  # N, of that
NEWTON_MILLIMETRE = 1e-3  # N m, unit of joint torques, assumed
LATE_NS = 20_000_000
IDENTITY: Json = {
    "position": {"x": 0.0, "y": 0.0, "z": 0.0},
    "rotation": {"w": 1.0, "x": 0.0, "y": 0.0, "z": 0.0},
    "scale": {"x": 1.0, "y": 1.0, "z": 1.0},
}

#: Events at the begin of a fault and at its end: name, level, safety type.
EVENTS = {
    ("unplug", True): ("device-disconnected", "warning", ""),
    ("unplug", False): ("device-connected", "info", ""),
    ("busy", True): ("device-busy", "warning", ""),
    ("ebrake", True): ("device-safety-triggered", "error", "ebrake_triggered"),
    ("ebrake", False): ("device-safety-triggered", "notice", "ebrake_released"),
    ("motor_stall", True): ("device-safety-triggered", "warning", "stall_detected"),
}

_message = msgspec.json.Decoder(wire.Message).decode
_encode, _decode = msgspec.json.encode, msgspec.json.decode


class Answer(NamedTuple):
    """What HTTP replies."""

    status: int
    body: Json


class Outgoing(NamedTuple):
    """A message to a session, and when it goes out."""

    due_ns: int
    session: int
    text: bytes


def session_defaults() -> wire.Configure:
    """Return the maker's defaults of the settings that end with a session."""
    return wire.Configure(wire.Preset("defaults"), wire.ForceGate(0.3), wire.Damping(0.0))


class Service:
    """The service with its one device and a grip.

    Attributes:
        events: Messages to everybody at the channel of events, to be sent and removed.
        settings: Those of the service.
        replies: Number of states so far.
    """

    def __init__(
        self, device: Inverse3, operator: Operator | None, faults: Faults, truth: TruthFile
    ) -> None:
        self.device, self._operator = device, operator
        self._faults, self._truth = faults, truth
        self.port = ""  # of the device, as the service shows it
        self.settings: Json = {"devices/force_scale": 1.0}
        self.sessions: dict[int, wire.Configure] = {}
        self.events: deque[bytes] = deque()
        self.replies = 0
        self._newest = FIRST_SESSION - 1
        self._waiting: deque[tuple[int, bytes]] = deque()
        self._outgoing: deque[Outgoing] = deque()
        self._on: set[str] = set()  # faults that have begun with an event
        self._is_old = faults.is_planned("old")

    def start(self, time_ns: int) -> None:
        """Begin at this time."""
        self.device.start(time_ns)
        self.tick(time_ns)

    def is_away(self, time_ns: int) -> bool:
        """Return whether the service does not run."""
        return self._faults.is_on("restart", time_ns)

    def connect(self, time_ns: int) -> tuple[int, bytes]:
        """Begin a session; return its number and the inventory."""
        self._newest += 1
        self.sessions[self._newest] = session_defaults()
        self.device.advance(time_ns)
        return self._newest, _encode(self._state(self._newest, time_ns, has_config=True))

    def disconnect(self, session: int, time_ns: int) -> None:
        """End a session; its force ends with it."""
        self.sessions.pop(session, None)
        if self.device.pulls.pop(session, None):
            self.device.advance(time_ns)
            self.device.apply(time_ns)
        if not self.sessions:
            self._truth.forget()
            self.device.mechanism.hold_home(time_ns)

    def receive(self, session: int, text: bytes | str, time_ns: int) -> None:
        """Take a message of a session; :meth:`due` has the reply."""
        self._waiting.append((session, text.encode() if isinstance(text, str) else text))
        self.tick(time_ns)

    def tick(self, time_ns: int) -> None:
        """Move on to this time, answer what waits, and publish the ground truth."""
        device = self.device
        for kind in ("unplug", "busy", "ebrake", "motor_stall"):
            self._follow(kind, self._faults.is_on(kind, time_ns), time_ns)
        truth = device.advance(time_ns)
        while self._waiting and not self._faults.is_on("stall", time_ns):
            self._answer(*self._waiting.popleft(), time_ns)
        mechanism = device.mechanism
        if self.sessions and self.replies:
            mechanism.use(time_ns, may_move=self._truth.engaged_ns != NOT_YET)
        self._truth.write(time_ns, truth, mechanism.torque, mechanism.torque_ns)

    def due(self, time_ns: int) -> list[Outgoing]:
        """Return the messages that go out now."""
        found = []
        while self._outgoing and self._outgoing[0].due_ns <= time_ns:
            found.append(self._outgoing.popleft())
        return found

    def _follow(self, kind: str, is_on: bool, time_ns: int) -> None:
        """Let a fault act that begins or ends with an event."""
        device = self.device
        if is_on and kind == "busy":
            device.pulls[OTHER_SESSION] = Pull(BUSY_FORCE, 0.0, ZERO, time_ns)
        if is_on == (kind in self._on):
            return
        (self._on.add if is_on else self._on.discard)(kind)
        device.is_locked = bool(self._on - {"busy"})
        device.advance(time_ns)
        device.apply(time_ns)
        if (kind, is_on) in EVENTS:
            self._announce(*EVENTS[kind, is_on])

    def _announce(self, name: str, level: str, safety_type: str) -> None:
        data = {"device_family": "inverse", "device_id": DEVICE_ID}
        if safety_type:
            data["safety_type"] = safety_type
        words = (safety_type or name).replace("_", " ").replace("-", " ")
        event = {"name": name, "category": "device", "level": level, "data": data, "message": words}
        self.events.append(_encode(event))

    def _answer(self, session: int, text: bytes, time_ns: int) -> None:
        if session not in self.sessions:
            return
        try:
            message = _message(text)
        except msgspec.DecodeError:
            message = wire.Message()  # assumed: it is answered all the same
        has_config = message.session.force_render_full_state is not UNSET
        pull = None
        for part in message.inverse3:
            if part.device_id == DEVICE_ID and "unplug" not in self._on:
                self._configure(session, part.configure)
                pull = self._pull(session, part.commands, time_ns) or pull
        self._apply(session, pull, time_ns)
        reply = _encode(self._state(session, time_ns, has_config))
        self.replies += 1
        faults = self._faults
        faults.begin(time_ns)
        if faults.is_on("foreign", time_ns):
            reply = reply.replace(DEVICE_ID.encode(), OTHER_ID.encode())
        if faults.is_on("malformed", time_ns):
            reply = reply[: len(reply) // 2]
        due_ns = time_ns + LATE_NS * faults.is_on("late", time_ns)
        if self._outgoing:  # replies keep their order
            due_ns = max(due_ns, self._outgoing[-1].due_ns)
        sent = Outgoing(due_ns, session, reply)
        self._outgoing.extend([sent] * (1 + faults.is_on("doubled", time_ns)))

    def _configure(self, session: int, wanted: wire.Configure) -> None:
        if wanted != wire.Configure():
            both = {**to_builtins(self.sessions[session]), **to_builtins(wanted)}
            self.sessions[session] = convert(both, wire.Configure)

    def _pull(self, session: int, commands: wire.Commands, time_ns: int) -> Pull | None:
        """Return what the commands of a device want of its motors; None: nothing."""
        settings, force = self.sessions[session], ZERO
        linear, angular = commands.set_cursor_force, commands.set_angular_torques
        if linear is UNSET and angular is UNSET:
            return None
        if linear is not UNSET:
            given = linear.values if linear.vector is UNSET else linear.vector
            force = ZERO if given is UNSET else given.entries()
        if angular is not UNSET:
            torques = tuple([NEWTON_MILLIMETRE * t for t in angular.torques.entries()])
            device = self.device
            added = tip_force(device.kinematics, device.mechanism.angles, torques, ZERO, ZERO)
            force = tuple([a + b for a, b in zip(force, added, strict=True)])
        gate, damping = settings.force_gate, settings.damping
        assert gate is not UNSET
        assert damping is not UNSET
        return Pull(force, gate.gain, damping.entries(), time_ns)

    def _apply(self, session: int, pull: Pull | None, time_ns: int) -> None:
        """Let a session's force of this tick act, in place of that of the tick before."""
        pulls = self.device.pulls
        if pull is None:
            pulls.pop(session, None)
        else:
            if session not in pulls and pulls:
                self._announce(*EVENTS["busy", True])
            pulls[session] = pull
        self.device.apply(time_ns)

    def _state(self, session: int, time_ns: int, has_config: bool) -> Json:
        """Return what a session gets to read."""
        head: Json = {} if self._is_old else {"session_id": session}
        return {**head, **self._devices(self.sessions[session], time_ns, has_config)}

    def _devices(self, settings: wire.Configure, time_ns: int, has_config: bool) -> Json:
        inverse3: Json = {"device_id": DEVICE_ID}
        engaged_ns = max(self._truth.engaged_ns, 0)
        hand = self._operator
        down = 0 if hand is None else hand.buttons((time_ns - engaged_ns) * 1e-9) or 0
        buttons = {name: bool(down >> k & 1) for k, name in enumerate("abc")}
        grip: Json = {"device_id": "0"}
        if has_config:
            inverse3["config"] = self._config(settings)
            grip["config"] = {"type": "wireless_verse_grip", "major_version": 1, "minor_version": 4}
        inverse3["state"] = self._motion(settings)
        inverse3["status"] = {
            "calibrated": True,
            "in_use": bool(self.device.pulls),
            "power_supply": True,
            "ready": not self.device.is_locked,
            "started": True,
        }
        grip["state"] = {"buttons": buttons, "hall": 0, "orientation": IDENTITY["rotation"]}
        grip["status"] = {"ready": True, "connected": True, "awake": True}
        present = [] if "unplug" in self._on else [inverse3]
        return {"inverse3": present, "verse_grip": [], "wireless_verse_grip": [grip]}

    def _motion(self, settings: wire.Configure) -> Json:
        """Return the state of the device; velocities of the joints are 0, as in every sample."""
        device, angles = self.device, self.device.mechanism.angles
        is_default = settings.preset == wire.Preset("defaults")
        tip = device.kinematics.position(angles)
        place = [a + b for a, b in zip(tip, EXAMPLE if is_default else ZERO, strict=True)]
        torques = device.kinematics.torque(angles, device.force)
        mode = "force" if device.pulls else "idle"
        state: Json = {
            "cursor_position": _vec(place),
            "cursor_velocity": _vec(device.mechanism.truth().velocity),
            "angular_position": _angles([math.degrees(angle) for angle in angles]),
            "angular_velocity": _angles(ZERO),
            "body_orientation": IDENTITY["rotation"],
        }
        if self._is_old:
            return {**state, "mode": mode}
        return {
            **state,
            "current_cursor_force": _vec(device.force),
            "current_cursor_position": _vec(ZERO),
            "current_angular_torques": _angles([t / NEWTON_MILLIMETRE for t in torques]),
            "current_angular_position": _angles(ZERO),
            "control_domain": "cartesian",
            "control_mode": mode,
            "transform": {},
        }

    def _config(self, settings: wire.Configure) -> Json:
        shared: Json = to_builtins(self.device.shared)
        own: Json = to_builtins(settings)
        info = {"major_version": 7, "minor_version": 4, "id": DEVICE_ID, "uuid": UUID}
        config = {
            "type": "inverse3",
            "port": self.port,
            "device_info": {**info, "model" if self._is_old else "device_type": 4},
            "gravity_compensation": shared["gravity_compensation"],
            "handedness": shared["handedness"]["handedness"],
            "torque_scaling": shared["torque_scaling"],
        }
        if self._is_old:
            return config
        return {
            **config,
            "streaming_mode": "USB",
            "home_return": shared["home_return"],
            "preset": own["preset"]["preset"],
            "basis": {"permutation": "XYZ"},
            "mount": IDENTITY,
            "filters": {"force_gate": own["force_gate"], "damping": own["damping"]},
        }

    def request(self, method: str, path: str, query: str, body: bytes, time_ns: int) -> Answer:
        """Answer an HTTP request; ``query`` is the selector of its session."""
        match path.strip("/").split("/", 3):
            case ["version"] if method == "GET":
                version = "4.0.0" if self._faults.is_planned("new") else "3.5.0"
                version = "3.1.1" if self._is_old else version
                name = {"project_name": "haply-inverse-service", "project_version": f"{version}.0"}
                return Answer(HTTPStatus.OK, {**name, "git_tag": version})
            case ["devices"] if method == "GET":
                return Answer(HTTPStatus.OK, self._devices(session_defaults(), time_ns, True))
            case ["settings", *key]:
                return self._setting(method, "/".join(key), body, time_ns)
            case ["inverse3", identity, "config", key]:
                if identity == "*" and method == "GET":
                    return _refused("ambiguous device selector")
                if identity in (DEVICE_ID, "0", "*") and "unplug" not in self._on:
                    return self._configured(method, key, query, body, time_ns)
        return _refused(f"nothing is at {path}", HTTPStatus.NOT_FOUND)

    def _setting(self, method: str, key: str, body: bytes, time_ns: int) -> Answer:
        """Read or write settings of the service."""
        if method == "GET":
            if key in self.settings:
                return _ok(self.settings[key])
            return _refused(f"no setting {key!r}", HTTPStatus.NOT_FOUND)
        try:
            wanted = _decode(body)
            scale = wanted if key else wanted["devices/force_scale"]
            assert key in ("", "devices/force_scale")
            self.device.force_scale = convert(scale, wire.NotNegative)
        except (msgspec.MsgspecError, KeyError, TypeError, AssertionError) as error:
            return _refused(f"not set: {error}")
        self.settings["devices/force_scale"] = self.device.force_scale
        self.device.advance(time_ns)
        self.device.apply(time_ns)
        return Answer(HTTPStatus.OK, {"ok": True})

    def _configured(self, method: str, key: str, query: str, body: bytes, time_ns: int) -> Answer:
        """Read or write settings of the device, which a session may own."""
        shared: Json = to_builtins(self.device.shared)
        session, name = self._selected(query), key.removeprefix("filters/")
        own: Json = {} if session is None else to_builtins(self.sessions[session])
        if key not in shared and name not in own:
            return _refused(f"no key {key!r}, or no session {query!r}", HTTPStatus.NOT_FOUND)
        try:
            if method == "POST" and key in shared:
                shared[key] = _decode(body)
                self.device.shared = convert(shared, wire.Shared)
                self.device.advance(time_ns)
                self.device.apply(time_ns)
            elif method == "POST" and session is not None:
                self._configure(session, convert({name: _decode(body)}, wire.Configure))
                own = to_builtins(self.sessions[session])
        except msgspec.MsgspecError as error:
            return _refused(str(error))
        return _ok(shared[key] if key in shared else own[name])

    def _selected(self, query: str) -> int | None:
        """Return the session that a selector means: its number, or its place behind a colon."""
        numbers, text = list(self.sessions), query.removeprefix("#")
        try:
            if text.startswith(":"):
                return numbers[int(text[1:])]
            return int(text) if int(text) in self.sessions else None
        except (ValueError, IndexError):
            return None


def _ok(data: Any) -> Answer:
    return Answer(HTTPStatus.OK, {"ok": True, "data": data})


def _refused(reason: str, status: int = HTTPStatus.BAD_REQUEST) -> Answer:
    return Answer(status, {"ok": False, "error": reason})


def _vec(numbers: Sequence[float]) -> Json:
    return dict(zip("xyz", numbers, strict=True))


def _angles(numbers: Sequence[float]) -> Json:
    return dict(zip(("a0", "a1", "a2"), numbers, strict=True))
