"""An ODrive with firmware 0.5.6, as seen from its port: the ASCII protocol.

A line is a command, an optional checksum behind ``*``, an optional comment behind ``;``; it ends
with a line feed, a carriage return or ``!``::

    c AXIS TORQUE       torque, in N m; feeds the watchdog; no reply
    f AXIS              reply: position and velocity, in turns and turns/s
    u AXIS              feeds the watchdog; no reply
    r PROPERTY          reply: its value, cut to 9 characters
    w PROPERTY VALUE    no reply
    sc                  clears the errors; no reply

The checksum is the exclusive or of all bytes before ``*``, in decimal. A reply carries one if its
request did, and ends with carriage return and line feed. What a driver must know of the real board,
and this one does: docs/devices.md. Left out: the estimator's filter (readings here are the
encoder's), calibration (it is done), the currents' dynamics, all but the commands above and a few
properties.
"""

import math
import re
from dataclasses import dataclass, field

from forcebound.hardware.odrive_lines import (
    CLOSED_LOOP_CONTROL,
    IDLE,
    WATCHDOG_EXPIRED,
    exclusive_or,
)
from forcebound.messages.packets import Vector

LINE_ENDS = re.compile(rb"[\r\n!]")
LONGEST_LINE = 256  # bytes, with its end
LONGEST_VALUE = 9  # characters
TORQUE_CONTROL = 1
INVALID_STATE, ENCODER_FAILED = 0x1, 0x100  # errors of an axis
STATE_NS = 1_000_000  # from the request for a state to the state
NUMBER = r"[-+]?(?:inf(?:inity)?|nan|(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?)"
LARGEST_FLOAT = 3.4028235e38

Value = float | int | bool

BOARD_VALUES: dict[str, Value] = {
    "vbus_voltage": 24.0,
    "serial_number": 0x2060_3881_4E42,
    "fw_version_major": 0,
    "fw_version_minor": 5,
}
AXIS_VALUES: dict[str, Value] = {
    "error": 0,
    "current_state": IDLE,
    "requested_state": 0,
    "config.watchdog_timeout": 0.0,
    "config.enable_watchdog": False,
    "motor.config.torque_lim": math.inf,
    "motor.config.current_lim": 10.0,
    "motor.config.torque_constant": 0.04,
    "encoder.pos_estimate": 0.0,
    "encoder.vel_estimate": 0.0,
    "controller.input_torque": 0.0,
    "controller.config.control_mode": 3,  # position
    "controller.config.input_mode": 1,  # passed through
    "controller.config.vel_limit": 2.0,
    "controller.config.vel_gain": 1.0 / 6.0,
    "controller.config.enable_torque_mode_vel_limit": True,
}
READ_ONLY = {*BOARD_VALUES, "current_state", "encoder.pos_estimate", "encoder.vel_estimate"}


@dataclass
class _Axis:
    values: dict[str, Value] = field(default_factory=AXIS_VALUES.copy)
    fed_until_ns: int = 0
    state_from_ns: int | None = None  # when the requested state is taken on
    angle: float | None = None  # rad, at the last look

    @property
    def is_on(self) -> bool:
        """True if the motor is on."""
        return self.values["current_state"] == CLOSED_LOOP_CONTROL

    def fail(self, error: int) -> None:
        """Note an error of the axis: the motor is off."""
        self.values["error"] = int(self.values["error"]) | error
        self.values["current_state"] = IDLE


class ODriveBoard:
    """The board; see :class:`forcebound.hardware.emulators.emulation.Board`.

    A motor that is not calibrated cannot be switched on. ``has_estimate``: the encoders give one; a
    fault to set.
    """

    def __init__(self, axes: int, is_calibrated: bool = True) -> None:
        self.angles: Vector = (0.0,) * axes
        self.torque: Vector = (0.0,) * axes
        self.wake_ns: int | None = None
        self.has_estimate = True
        self._is_calibrated = is_calibrated
        self._values = dict(BOARD_VALUES)
        self._axes = [_Axis() for _ in range(axes)]
        self._line = b""
        self._is_passed_over = False  # the rest of a line that was too long
        self._time_ns: int | None = None
        self._reply: list[bytes] = []

    def receive(self, data: bytes, time_ns: int) -> bytes:
        self._go_on(time_ns)
        *lines, rest = LINE_ENDS.split(self._line + data)
        for line in lines:
            if self._is_passed_over or len(line) >= LONGEST_LINE:
                self._is_passed_over = False
            else:
                self._process(line, time_ns)
        if len(rest) >= LONGEST_LINE:
            self._is_passed_over, rest = True, b""
        self._line = rest
        for axis in self._axes:
            if axis.values["requested_state"] and axis.state_from_ns is None:
                axis.state_from_ns = time_ns + STATE_NS
        self.torque = tuple(map(_torque, self._axes))
        self.wake_ns = self._next_ns()
        reply = b"".join(self._reply)
        self._reply.clear()
        return reply

    def reset(self) -> None:
        """Forget what was written; the motors are off."""
        self._axes = [_Axis() for _ in self._axes]

    def with_nan(self, reply: bytes) -> bytes:
        lines = []
        for line in reply.splitlines():
            words = line.partition(b"*")[0].split()
            lines.append(_ended(" ".join("nan" for _ in words), b"*" in line))
        return b"".join(lines)

    def _go_on(self, time_ns: int) -> None:
        """Let time pass: estimates, requested states, watchdogs."""
        for axis, angle in zip(self._axes, self.angles, strict=True):
            self._estimate(axis, angle, time_ns)
            values = axis.values
            if axis.state_from_ns is not None and time_ns >= axis.state_from_ns:
                axis.state_from_ns = None
                self._enter(axis)
            if values["config.enable_watchdog"] and time_ns >= axis.fed_until_ns:
                axis.fail(WATCHDOG_EXPIRED)
        self._time_ns = time_ns

    def _estimate(self, axis: _Axis, angle: float, time_ns: int) -> None:
        if not self.has_estimate:
            axis.fail(ENCODER_FAILED)
            return
        values = axis.values
        values["encoder.pos_estimate"] = angle / math.tau
        if self._time_ns is not None and axis.angle is not None and time_ns > self._time_ns:
            seconds = (time_ns - self._time_ns) * 1e-9
            values["encoder.vel_estimate"] = (angle - axis.angle) / math.tau / seconds
        axis.angle = angle

    def _enter(self, axis: _Axis) -> None:
        values = axis.values
        state, values["requested_state"] = values["requested_state"], 0
        is_ready = self._is_calibrated and not values["error"]
        if state == IDLE or (state == CLOSED_LOOP_CONTROL and is_ready):
            values["current_state"] = state
        else:
            axis.fail(INVALID_STATE)

    def _next_ns(self) -> int | None:
        due = [axis.state_from_ns for axis in self._axes if axis.state_from_ns is not None]
        for axis in self._axes:
            if axis.is_on and axis.values["config.enable_watchdog"]:
                due.append(axis.fed_until_ns)
        return min(due, default=None)

    def _process(self, line: bytes, time_ns: int) -> None:
        text, star, rest = line.partition(b";")[0].partition(b"*")
        if star:
            given = re.match(rb"\s*\+?(\d+)", rest)
            if given is None or int(given[1]) != exclusive_or(text):
                return
        answer = self._answer(text.decode("latin-1"), time_ns)
        if answer is not None:
            self._reply.append(_ended(answer, bool(star)))

    def _answer(self, command: str, time_ns: int) -> str | None:
        kind, words = command[:1], command[1:].split()
        if command.startswith("sc"):
            for axis in self._axes:
                axis.values["error"] = 0
        if kind == "s":
            return None
        if kind in ("r", "w"):
            return self._property(kind, *words[:2]) if words else "invalid command format"
        if kind not in ("c", "f", "u"):
            return "unknown command"
        form = rf"{kind}\s*\+?(\d+)" + (rf"\s*({NUMBER})" if kind == "c" else "")
        given = re.match(form, command, re.IGNORECASE)
        if given is None:
            return "invalid command format"
        if int(given[1]) >= len(self._axes):
            return f"invalid motor {given[1]}"
        axis = self._axes[int(given[1])]
        values = axis.values
        if kind == "f":
            return f"{values['encoder.pos_estimate']:f} {values['encoder.vel_estimate']:f}"
        if kind == "c":
            values["controller.config.control_mode"] = TORQUE_CONTROL
            values["controller.input_torque"] = _as_float(given[2])
        axis.fed_until_ns = time_ns + round(float(values["config.watchdog_timeout"]) * 1e9)
        return None

    def _property(self, kind: str, name: str, text: str = "") -> str | None:
        """Read or write a property; return the reply."""
        owners = {f"axis{number}": axis.values for number, axis in enumerate(self._axes)}
        owner, own = name.partition(".")[::2]
        values, key = (owners[owner], own) if owner in owners else (self._values, name)
        if key not in values:
            return "invalid property"
        value = values[key]
        if kind == "r":
            return (f"{value:f}" if isinstance(value, float) else str(int(value)))[:LONGEST_VALUE]
        form = NUMBER if isinstance(value, float) else r"[-+]?\d+"
        given = re.match(form, text, re.IGNORECASE)
        if key in READ_ONLY or given is None:
            return "not implemented"
        is_float = isinstance(value, float)
        values[key] = _as_float(given[0]) if is_float else type(value)(int(given[0]))
        return None


def _torque(axis: _Axis) -> float:
    """Return what a motor gives, in N m."""
    values = axis.values
    if not axis.is_on or values["controller.config.control_mode"] != TORQUE_CONTROL:
        return 0.0
    torque = float(values["controller.input_torque"])
    if values["controller.config.enable_torque_mode_vel_limit"]:
        limit, gain = values["controller.config.vel_limit"], values["controller.config.vel_gain"]
        velocity = values["encoder.vel_estimate"]
        torque = min(max(torque, (-limit - velocity) * gain), (limit - velocity) * gain)
    most = float(values["motor.config.current_lim"]) * values["motor.config.torque_constant"]
    most = min(most, float(values["motor.config.torque_lim"]))
    return most if math.isnan(torque) else min(max(torque, -most), most)


def _as_float(text: str) -> float:
    """Return a number as the firmware's float takes it."""
    number = float(text)
    return number if abs(number) <= LARGEST_FLOAT else math.copysign(math.inf, number)


def _ended(answer: str, has_checksum: bool) -> bytes:
    line = answer.encode("latin-1")
    return line + (b"*%d\r\n" % exclusive_or(line) if has_checksum else b"\r\n")
