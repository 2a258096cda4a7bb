"""Feetech servos of the STS series with an open-loop duty cycle (mode 2), on a bus.

How a tick, its stamps and its failures work: :mod:`forcebound.hardware.servo_bus`; what is set, and
what is refused: docs/devices.md. These servos have no watchdog: a guardian process ends a force
that nobody renews.

**The torque.** A duty cycle d (-1 to 1) of the supply U turns the joint with k (d U - e w), where e
w is the voltage of the turning motor. With U at most the stated ``largest_supply`` that is a share
of the torque that was written, T = k d U_largest, and a damping k e, which only takes energy. The
share is unknown: it falls as the supply sags with the current of all motors, also within a hold,
and to zero when a servo protects itself. So ``attenuates: freely`` is the default. per_write is
for a supply whose voltage is stiff for a hold. A supply above the largest, as when a hand drives
the motors and they charge it, would give more than was written: it is read in every tick, and ends
the run.

HLS servos, whose mode 2 sets a current, are read only: nobody has settled which bit of their goal
is its sign, and a force with the wrong sign pushes the hand.
"""

import logging
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

from forcebound.axes import OfAxes
from forcebound.errors import ConfigError, DeviceError
from forcebound.haptics.hands import Operator
from forcebound.haptics.laws.dissipation import Attenuates
from forcebound.haptics.parts.signals import Signal
from forcebound.hardware import feetech_frames
from forcebound.hardware.servo_bus import OpenServos, ServoBus, of_each
from forcebound.hardware.servo_models import DUTY, FEETECH_VOLT, FEETECHS
from forcebound.hardware.servo_requests import orders
from forcebound.messages.packets import Vector
from forcebound.quantities import POSITIVE, Name, Ratio

# Registers.
MODEL, RETURN_DELAY, MODE, TORQUE, GOAL_DUTY, LOCK, POSITION, VOLTAGE = 3, 7, 33, 40, 44, 55, 56, 62
DUTY_MODE = 2
FILLING = bytes(256)  # completes whatever message has lost a byte, its length for example
ERRORS = ("voltage", "encoder", "overheating", "current", "overload", "overload")  # by bit

_logger = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class Feetech(ServoBus):
    """Parameters of Feetech servos, STS series; of HLS servos, which are read only.

    Presliding has no proof with a motor that attenuates and no watchdog: state less friction.

    Attributes:
        torque_per_volt: Torque of a joint at stall for the voltage at its motor, in N m/V: the
            largest that it may be; null: of the data sheet, assumed.
        largest_supply: Largest voltage of the supply, in V.
    """

    board: ClassVar[str] = "feetech"
    known_models: ClassVar[Mapping[str, Any]] = FEETECHS
    signals = (Signal("supply", "V", "that the last joint's servo has"),)

    models: OfAxes[Name] = "sts3215"
    torque_per_volt: OfAxes[Annotated[Ratio, POSITIVE]] | None = None
    largest_supply: Annotated[Ratio, POSITIVE] = 8.4
    attenuates: Attenuates = "freely"

    def __post_init__(self) -> None:
        super().__post_init__()
        for joint, most, needed in zip(
            self.joints, self.constants, self.largest_torques, strict=True
        ):
            if most < needed:
                words = f"{joint} gives {most:.3g} N m at {self.largest_supply:g} V: expected that"
                words += f" as torque_limit or saturation at most, got {needed:.3g} N m"
                raise ConfigError(f"saturation: {words}", field="saturation")

    @property
    def constants(self) -> Vector:
        known = [each.stall_torque / each.voltage for each in self.types]
        per_volt = of_each("torque_per_volt", self.torque_per_volt, self.axes, known)
        return tuple([self.largest_supply * one for one in per_volt])

    def open(self, operator: Operator | None, hold_limit: float) -> OpenServos:
        return self.opened(OpenFeetechs, operator)


class OpenFeetechs(OpenServos):
    """Feetech servos on a line."""

    model: Feetech
    frames: ClassVar[Any] = feetech_frames
    goal: ClassVar[int] = GOAL_DUTY
    polled: ClassVar[tuple[int, int]] = (POSITION, 7)
    shown: ClassVar[tuple[int, int]] = (TORQUE, 6)

    @classmethod
    def rest(cls, model: Any) -> tuple[bytes, int]:
        """Return no duty, motors off; the first servo answers. HLS servos get nothing."""
        pairs = zip(model.servos, model.types, strict=True)
        driven = [servo for servo, each in pairs if each.has_duty]
        off = [(GOAL_DUTY, dict.fromkeys(driven, bytes(2))), (TORQUE, dict.fromkeys(driven, b"\0"))]
        asked = feetech_frames.read(model.servos[0], TORQUE, 1)
        return FILLING + orders(feetech_frames, off) + asked, 7

    def goals_per_torque(self) -> Vector:
        pairs = zip(self._directions, self.model.constants, self.model.types, strict=True)
        return tuple([turn * DUTY / most if one.has_duty else 0.0 for turn, most, one in pairs])

    def while_on(self) -> tuple[int, str]:
        return 1, "is off: it was reset, or protects itself"

    def set_up(self, joint: int) -> None:
        servo, stated = self.model.servos[joint], self.model.types[joint]
        number = self.bus.number(servo, MODEL, 2)
        if stated.number is not None:
            self.check_model(joint, number)
        if stated.has_duty:
            self.bus.keep(servo, RETURN_DELAY, 0, LOCK)
            self.bus.keep(servo, MODE, DUTY_MODE, LOCK)
            return
        words = "%s gives no force, only its position is read: it is not settled which bit of the"
        _logger.warning(f"{words} torque of an HLS servo is its sign", self.bus.names[servo])

    def switched_on(self) -> bytes:
        return orders(feetech_frames, [(TORQUE, dict.fromkeys(self._driven, b"\1"))])

    def encoded(self, goal: int) -> bytes:
        return feetech_frames.encoded(GOAL_DUTY, goal)

    def counts(self, joint: int, values: bytes) -> float:
        supply, largest = values[VOLTAGE - POSITION] * FEETECH_VOLT, self.model.largest_supply
        if supply > largest + 1e-9:
            words = f"has {supply:.1f} V, more than largest_supply, {largest:g} V: a force would be"
            words += " larger than written; motors that a hand drives charge a supply that takes"
            words += " nothing back"
            servo = self.model.servos[joint]
            self.bus.end(DeviceError(f"{self.bus.names[servo]} {words}"))
        self.signal("supply", supply)
        return feetech_frames.decoded(POSITION, values[:2])

    def explained(self, servo: int, error: int) -> str:
        words = ", ".join(name for bit, name in enumerate(ERRORS) if error >> bit & 1)
        return f"reports the error {error:#x} ({words or 'unknown'})"
