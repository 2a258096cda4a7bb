"""Dynamixel servos of the X series in current mode, on a bus.

How a tick, its stamps and its failures work: :mod:`forcebound.hardware.servo_bus`; what is set, and
what is refused: docs/devices.md. The servos have a watchdog of their own, which switches a motor
off when nothing has come on the bus for a time, in steps of 20 ms; it is ``watchdog_limit``. A
guardian process writes zero force earlier, if only this process hangs.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

from forcebound.axes import OfAxes
from forcebound.errors import ConfigError, DeviceError
from forcebound.haptics.hands import Operator
from forcebound.haptics.laws.dissipation import AngleOfJoints
from forcebound.hardware import dynamixel_frames
from forcebound.hardware.driven import SIGNALS_OF_JOINTS
from forcebound.hardware.servo_bus import OpenServos, ServoBus, of_each
from forcebound.hardware.servo_models import DYNAMIXELS
from forcebound.hardware.servo_requests import orders
from forcebound.messages.packets import Vector
from forcebound.quantities import POSITIVE, Name, Range, Ratio

# Registers.
RETURN_DELAY, MODE, CURRENT_LIMIT, TORQUE, HARDWARE_ERROR = 9, 11, 38, 64, 70
WATCHDOG, GOAL_CURRENT, PRESENT_CURRENT = 98, 102, 126
CURRENT_MODE = 0
WATCHDOG_STEP, MOST_STEPS = 0.02, 127  # s
OLDEST_FIRMWARE = 38  # with a watchdog
SPEED = 0.229 * math.tau / 60.0  # rad/s, unit of the present velocity
HARDWARE_ERRORS = {0: "input voltage", 2: "overheating", 3: "encoder", 4: "electrical shock"}
HARDWARE_ERRORS |= {5: "overload"}


@dataclass(frozen=True, kw_only=True)
class Dynamixel(ServoBus):
    """Parameters of Dynamixel servos, X series.

    Attributes:
        torque_constant: Torque of a joint for a current of its servo, in N m/A; null: stall torque
            over stall current of the data sheet, assumed. ``forcebound identify`` measures it.
        gain_error: Of servos of one model; more for several, until their constants are measured.
    """

    board: ClassVar[str] = "dynamixel"
    known_models: ClassVar[Mapping[str, Any]] = DYNAMIXELS
    signals = SIGNALS_OF_JOINTS

    models: OfAxes[Name] = "xl330-m288"
    torque_constant: OfAxes[Annotated[Ratio, POSITIVE]] | None = None
    gain_error: Annotated[Ratio, Range(at_least=0, below=1)] = 0.1
    presliding: AngleOfJoints = 5e-3  # a gear's backlash, 15 arcmin

    def __post_init__(self) -> None:
        super().__post_init__()
        limit, last = self.longest_force, self.steps * WATCHDOG_STEP
        if not last or not math.isclose(limit, last):
            least, most = WATCHDOG_STEP, MOST_STEPS * WATCHDOG_STEP
            near = sorted({max(last, least), min(last + least, most)})
            words = (
                f"watchdog_limit: that of the servos counts steps of {1e3 * least:g} ms: expected"
            )
            words += f" {' or '.join(f'{1e3 * one:g} ms' for one in near)}, got {1e3 * limit:g} ms"
            raise ConfigError(words, field="watchdog_limit")

    def refused(self, name: str) -> str:
        if name not in DYNAMIXELS or DYNAMIXELS[name].current_unit:
            return ""
        others = ", ".join(each for each, one in DYNAMIXELS.items() if one.current_unit)
        return f"{name} has no current mode, so its torque is not known; take one of {others}"

    @property
    def torque_scale(self) -> str:
        """Name of the number that scales the torques of the joints."""
        return "torque_constant"

    @property
    def constants(self) -> Vector:
        known = [each.torque_constant for each in self.types]
        return of_each("torque_constant", self.torque_constant, self.axes, known)

    def possible_limit(self, limit: float) -> float:
        return math.ceil(limit / WATCHDOG_STEP - 1e-6) * WATCHDOG_STEP

    @property
    def steps(self) -> int:
        """Of the watchdog."""
        return min(int(self.longest_force / WATCHDOG_STEP + 1e-6), MOST_STEPS)

    def open(self, operator: Operator | None, hold_limit: float) -> OpenServos:
        return self.opened(OpenDynamixels, operator)


class OpenDynamixels(OpenServos):
    """Dynamixel servos on a line."""

    model: Dynamixel
    frames: ClassVar[Any] = dynamixel_frames
    goal: ClassVar[int] = GOAL_CURRENT
    polled: ClassVar[tuple[int, int]] = (PRESENT_CURRENT, 10)
    shown: ClassVar[tuple[int, int]] = (WATCHDOG, 6)

    @classmethod
    def rest(cls, model: Any) -> tuple[bytes, int]:
        """Return zero currents, torque and watchdog off; the first servo answers."""
        last = dynamixel_frames.read(model.servos[0], TORQUE, 1)
        return _orders(model, {GOAL_CURRENT: bytes(2), TORQUE: b"\0", WATCHDOG: b"\0"}) + last, 12

    def goals_per_torque(self) -> Vector:
        pairs = zip(self._directions, self.model.constants, self.model.types, strict=True)
        return tuple([turn / (constant * each.current_unit) for turn, constant, each in pairs])

    def while_on(self) -> tuple[int, str]:
        limit = f"{1e3 * self.model.steps * WATCHDOG_STEP:g} ms"
        fired = f"is off: its bus watchdog has fired, after {limit} without a message, or"
        return self.model.steps, f"{fired} it was reset"

    def set_up(self, joint: int) -> None:
        bus, servo = self.bus, self.model.servos[joint]
        ping = dynamixel_frames.packet(servo, dynamixel_frames.PING)
        low, high, firmware = bus.single(servo, ping, 3)
        self.check_model(joint, low + 256 * high)
        words, limit = "", bus.number(servo, CURRENT_LIMIT, 2)
        most, needed = limit / abs(self._per_torque[joint]), self.model.largest_torques[joint]
        if firmware < OLDEST_FIRMWARE and not self.model.types[joint].has_watchdog:
            words = f"has the firmware {firmware}, which has no bus watchdog: expected"
            words += f" {OLDEST_FIRMWARE} or later; update it with the maker's Dynamixel Wizard"
        elif bits := bus.number(servo, HARDWARE_ERROR):
            words = hardware_error(bits)
        elif most < needed:
            words = f"gives {most:.3g} N m at most (its current limit, register 38, is {limit});"
            words += f" expected torque_limit or saturation, {needed:.3g} N m, or more: lower the"
            words += " one or raise the other"
        if words:
            bus.end(DeviceError(f"{bus.names[servo]} {words}"))
        bus.keep(servo, RETURN_DELAY, 0)
        bus.keep(servo, MODE, CURRENT_MODE)

    def switched_on(self) -> bytes:
        """Return what clears a watchdog that has fired, sets it, and switches the motors on."""
        steps = bytes((self.model.steps,))
        first = _orders(self.model, {WATCHDOG: b"\0", GOAL_CURRENT: bytes(2)})
        return first + _orders(self.model, {WATCHDOG: steps, TORQUE: b"\1"})

    def encoded(self, goal: int) -> bytes:
        return goal.to_bytes(2, "little", signed=True)

    def counts(self, joint: int, values: bytes) -> float:
        current, speed, position = (
            int.from_bytes(values[begin:end], "little", signed=True)
            for begin, end in ((0, 2), (2, 6), (6, 10))
        )
        turn = self._directions[joint]
        self.signal(f"velocity_{joint + 1}", turn * speed * SPEED)
        self.signal(f"current_{joint + 1}", turn * current * self.model.types[joint].current_unit)
        return position

    def explained(self, servo: int, error: int) -> str:
        if error & dynamixel_frames.ALERT:
            return hardware_error(self.bus.number(servo, HARDWARE_ERROR))
        return f"refuses a packet: {dynamixel_frames.ERRORS.get(error, f'error {error:#x}')}"


def hardware_error(bits: int) -> str:
    """Return a hardware error register in words."""
    known = ", ".join(words for bit, words in HARDWARE_ERRORS.items() if bits >> bit & 1)
    words = f"has the hardware error {bits:#x} ({known or 'unknown'}), which switches it off"
    return f"{words}: find the cause, then reboot it"


def _orders(model: Any, values: Mapping[int, bytes]) -> bytes:
    """Return orders to all servos; values by register."""
    each = [(address, dict.fromkeys(model.servos, value)) for address, value in values.items()]
    return orders(dynamixel_frames, each)
