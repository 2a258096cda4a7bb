"""One to three motors on an ODrive with firmware 0.5, at a serial port: knobs.

How ticks, stamps, readings and the watchdog work: docs/devices.md. The driver switches off what
makes a torque other than written: the limit of torque by speed, and every input mode but the plain
one. What the board's limits of torque and current forbid is refused at the start. A positive torque
on the wire turns towards larger angles; a positive torque of forcebound resists that.

What goes wrong ends in zero torque and a DeviceError, once, as :mod:`forcebound.hardware.line` has
it: silence for half of the ``watchdog_limit``; a reply that is cut short, without its checksum, or
no number; more replies than expected; an error of an axis; a port that is gone; a guardian that
had to step in.
"""

import logging
import math
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Annotated, ClassVar

from forcebound.errors import DeviceError
from forcebound.haptics.devices import Source
from forcebound.haptics.devices.arms import ASSUMED
from forcebound.haptics.devices.knob import KnobNumbers
from forcebound.haptics.hands import Operator
from forcebound.haptics.laws.bounder import saturated
from forcebound.haptics.laws.dissipation import AngleOfJoints
from forcebound.hardware.line import Line
from forcebound.hardware.odrive_lines import (
    CLOSED_LOOP_CONTROL,
    WATCHDOG_EXPIRED,
    Requests,
    error_words,
    on_wire,
    positions,
    request,
    torque_request,
    whole_number,
)
from forcebound.hardware.odrive_start import (
    Switch,
    check_firmware,
    set_up,
    switched_off,
    zero_torque,
)
from forcebound.hardware.serial_device import (
    FIRST_EXCHANGES,
    Exchange,
    SerialDevice,
    SerialJoints,
)
from forcebound.messages.packets import Vector
from forcebound.quantities import POSITIVE, AngularSpeed, Range, Time

CONTROL_NS = 125_000  # period of the firmware's control loop, 8 kHz

_logger = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class ODrive(KnobNumbers, SerialJoints):
    """Parameters of motors on an ODrive, each a knob.

    Motor and encoder must be calibrated before, with the maker's tool. Damping and friction are
    those of the motor in use: ``forcebound identify`` measures them.

    Attributes:
        resolution: Of the positions that the board reports: two counts of the encoder, or more.
        joints: Number of motors, from axis 0 up.
        lever: From the axle of a motor to the hand.
        baud: Bits a second, for a UART; null: USB, which has no such limit.
    """

    board: ClassVar[str] = "odrive"
    simulated_in: ClassVar[str] = "knob_wall"  # launch file for virtual time

    resolution: AngleOfJoints = 2.0 * math.tau / 8192  # data sheet of a common encoder
    # Assumed: a hand's fastest twist peaks at 33 rad/s (see knob.py), a free motor may be faster.
    largest_speed: Annotated[AngularSpeed, POSITIVE] | None = 200.0
    write_delay: Annotated[Time, Range(at_least=0)] = 6e-4  # measured, with the emulator
    baud: Annotated[int, Range(at_least=9600)] | None = None
    sources: Mapping[str, Source] = field(default_factory=lambda: ASSUMED, hash=False)

    def open(self, operator: Operator | None, hold_limit: float) -> "OpenODrive":
        zero = b"\n" + zero_torque(self.joints)  # the first ends a line that was cut short
        with self.line(zero, operator, baud=self.baud or 115_200) as line:
            return OpenODrive(self, line, hold_limit)


class OpenODrive(SerialDevice):
    """Motors on an ODrive, from open to close, with ``hold_limit`` s between two writes at most.

    DeviceError if the board does not answer as an ODrive does, cannot give the torque that the
    model states, or is too slow for ticks of this length.
    """

    def __init__(
        self,
        model: ODrive,
        line: Line,
        hold_limit: float,
        clock: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self._requests = Requests(line, model.reply_within)
        super().__init__(line, self._requests, model.reply_within, clock)
        self._model = model
        joints = range(model.joints)
        self._zero: Vector = (0.0,) * model.joints
        self._held = self._zero
        self._ask_positions = b"".join(request(f"f {axis}") for axis in joints)
        self._ask_state = [
            request(f"r axis{axis}.error") + request(f"r axis{axis}.current_state")
            for axis in joints
        ]
        self._next = 0  # axis whose error and state are requested next
        self._switch = Switch(self._requests, model.joints, model.longest_force)
        self.axes, self.kinematics = model.joints, model.kinematics()
        self._requests.begin(b"\n" + zero_torque(model.joints))
        check_firmware(self._requests)
        for axis in joints:
            set_up(self._requests, axis, model.saturation)
        for _ in range(FIRST_EXCHANGES):
            self._ask()
            self._set(self._zero)
        quickest_ns = self._requests.quickest_ns("read") + self._requests.quickest_ns("write")
        if quickest_ns * 1e-9 > hold_limit:
            raise DeviceError(
                f"the messages of a tick take {1e-6 * quickest_ns:.3g} ms at this port, and a force"
                f" is held for {1e3 * hold_limit:.3g} ms: use the board's USB port or a higher baud"
                " rate, or lower device.rate"
            )
        self._requests.longest_wait = line.silence
        self._requests.restart()

    def read(self, time_ns: int) -> Vector:
        exchange = self._ask()
        self._read_ns = exchange.sent_ns - CONTROL_NS
        self._jitter_ns = exchange.excess_ns + CONTROL_NS
        return _angles(exchange.reply)

    def write(self, time_ns: int, force: Vector) -> Vector:
        """Hold torques, in N m, or less."""
        if not self._switch.is_on:
            self._switch.go_on()
            self._effect_ns = self._clock()
            return self._zero
        force = tuple(map(on_wire, saturated(force, self._model.saturation)))
        axis = self._next
        exchange = self._set(force)
        self._effect_ns = exchange.sent_ns + exchange.excess_ns + CONTROL_NS
        turns, error, state = exchange.reply
        self._came_ns, self._angles = self._clock(), _angles(turns)
        if error == WATCHDOG_EXPIRED and not any(self._held):
            self._switch.begin()  # after a pause without force
            force = self._zero
        elif error or state != CLOSED_LOOP_CONTROL:
            reason = f"with the error {error_words(error)}: its tool says more (dump_errors)"
            if not error:
                reason = "without an error: the board was reset, or another program switched it off"
            self._requests.end(DeviceError(f"axis {axis} of the ODrive is off {reason}"))
        self._held = force
        return force

    def close(self) -> None:
        """Write zero torque, switch off, release the port."""
        joints = self._model.joints
        with suppress(DeviceError):  # also where the line has failed, and takes no other message
            self._line.port.write(b"\n" + zero_torque(joints) + switched_off(joints))
        self._line.close()
        self.exchanges.log(_logger)

    def _ask(self) -> Exchange[list[float]]:
        joints, has_force = self._model.joints, any(self._held)
        return self._requests.ask("read", self._ask_positions, joints, positions, has_force)

    def _set(self, force: Vector) -> Exchange[tuple[list[float], int, int]]:
        """Set torques, which resist where positive; ask for positions, an axis's error and state.

        A board that was reset has no error, and its motors are off.
        """
        axis, joints = self._next, self._model.joints
        self._next = (axis + 1) % joints
        message = _torque_lines(force) + self._ask_positions + self._ask_state[axis]
        return self._requests.ask("write", message, joints + 2, _answers, has_force=any(force))


def _torque_lines(force: Vector) -> bytes:
    return b"".join([torque_request(axis, -torque) for axis, torque in enumerate(force)])


def _answers(texts: list[str]) -> tuple[list[float], int, int]:
    """Return what the replies to a write have: positions, in turns, error and state of an axis."""
    *turns, error, state = texts
    numbers = whole_number(error, "of an axis's error"), whole_number(state, "of an axis's state")
    return positions(turns), *numbers


def _angles(turns: Sequence[float]) -> Vector:
    return tuple([math.tau * turn for turn in turns])
