"""Servos of the Feetech STS series with an open-loop duty cycle, as seen from their port.

In mode 2 register 44 is the duty cycle, its sign in bit 10, and stays for ever: there is no
watchdog. The motor is a voltage behind a resistance: its torque is that of the duty at this supply,
less its back-EMF, a damping that is there while the motor is driven. A duty beyond register 36 for
the time in 35 is an overload: the torque goes off until it is switched off and on again. A servo of
the HLS series answers, and never moves: what its register 44 does is not settled.

What is known of the registers is what lerobot's tables and the maker's pages say. Left out: modes
0, 1 and 3 (no torque then), multi-turn angles, the lock of the EEPROM, registered writes, the
current's dynamics, heat.
"""

import math
from collections.abc import Mapping, Sequence
from functools import partial

from forcebound.hardware import feetech_frames as frames
from forcebound.hardware.emulators.servo_bus import OFF, Drive, Servo, ServoBoard, Turn, Wiring
from forcebound.hardware.feetech_frames import Packet
from forcebound.hardware.servo_models import COUNTS, DUTY, FEETECH_CURRENT, FEETECH_VOLT

STALL_CURRENT = 2.5  # A, at the voltage of the data sheet: that of an STS3215, assumed of others
DUTY_MODE = 2
OVERLOAD_NS = 10_000_000  # unit of register 35
REGISTERS = 71
# Registers.
MODEL, ID, DELAY, LEVEL, MOST_VOLTS, LEAST_VOLTS, MOST_TORQUE = 3, 5, 7, 8, 14, 15, 16
UNLOADING, OFFSET, MODE, OVERLOAD_TIME, OVERLOAD_DUTY, TORQUE, GOAL = 19, 31, 33, 35, 36, 40, 44
LIMIT, POSITION, SPEED, LOAD, VOLTS, TEMPERATURE, STATUS, CURRENT = 48, 56, 58, 60, 62, 63, 65, 69
READ_ONLY = (*range(ID), *range(POSITION, REGISTERS))


class FeetechServo(Servo):
    """One servo; ``largest`` is the supply at which its constant holds, in V."""

    kept, return_delay = 40, DELAY

    def __init__(self, wiring: Wiring, largest: float) -> None:
        model = wiring.model
        itself = ((0, 2, 0x0A03), (MODEL, 2, model.number or 0), (ID, 1, wiring.number))
        volts = ((MOST_VOLTS, 1, 140), (LEAST_VOLTS, 1, 40), (DELAY, 1, 250), (LEVEL, 1, 1))
        limits = ((MOST_TORQUE, 2, DUTY), (LIMIT, 2, DUTY), (UNLOADING, 1, 44))
        others = ((OVERLOAD_TIME, 1, 200), (OVERLOAD_DUTY, 1, 80), (TEMPERATURE, 1, 30))
        super().__init__(wiring, REGISTERS, *itself, *volts, *limits, *others)
        self._per_volt = wiring.constant / largest  # N m/V
        self._back_emf: float = model.voltage / model.free_speed  # V s/rad
        self._resistance: float = model.voltage / STALL_CURRENT
        self._load_ns = 0  # when its duty was last no overload

    def signed(self, address: int) -> int:
        """Return a number with its sign."""
        return frames.decoded(address, bytes(self.registers[address : address + 2]))

    @property
    def duty(self) -> float:
        """What the motor is driven with, as a share of the supply."""
        most = min(self.get(LIMIT, 2), self.get(MOST_TORQUE, 2), DUTY)
        return min(max(self.signed(GOAL), -most), most) / DUTY if self.is_driven else 0.0

    @property
    def is_driven(self) -> bool:
        """Whether the duty drives the motor."""
        is_on = self.registers[TORQUE] == 1 and self.registers[MODE] == DUTY_MODE
        return is_on and bool(self.wiring.model.has_duty)

    def refresh(self) -> None:
        shown = {
            POSITION: (self.counts - self.signed(OFFSET)) % COUNTS,
            SPEED: round(self.speed * COUNTS / math.tau),
            LOAD: round(self.duty * DUTY),
            CURRENT: round(self.drive().current / FEETECH_CURRENT),
        }
        for address, value in shown.items():
            self.registers[address : address + 2] = frames.encoded(address, value)
        self.put(VOLTS, round(self.supply / FEETECH_VOLT))

    def look(self, time_ns: int, angle: float, supply: float) -> None:
        super().look(time_ns, angle, supply)
        self.registers[STATUS] &= ~self.voltage
        if not self.registers[LEAST_VOLTS] <= supply / FEETECH_VOLT <= self.registers[MOST_VOLTS]:
            self.fail(self.voltage)
        if 100.0 * abs(self.duty) <= self.get(OVERLOAD_DUTY):
            self._load_ns = time_ns
        if time_ns - self._load_ns > OVERLOAD_NS * self.get(OVERLOAD_TIME):
            self.fail(self.overload)

    def fail(self, error: int) -> None:
        self.put(STATUS, self.get(STATUS) | error)
        if error & self.get(UNLOADING):
            self.put(TORQUE, 0)

    def drive(self) -> Drive:
        if not self.is_driven:
            return OFF
        volts = self.duty * self.supply
        current = (volts - self._back_emf * self.speed) / self._resistance
        return Drive(current, self._per_volt * volts, self._per_volt * self._back_emf)

    def write(self, address: int, data: bytes) -> None:
        """Write registers; what is read-only stays."""
        for place, value in enumerate(data[: max(REGISTERS - address, 0)], start=address):
            if place == TORQUE and value == 0:
                self.put(STATUS, 0)
            if place not in READ_ONLY and not (
                place == TORQUE and self.get(STATUS) & self.overload
            ):
                self.put(place, value)


class FeetechBus(ServoBoard):
    """The bus; see the base class."""

    frames = frames
    servos: Mapping[int, FeetechServo]

    def obey(self, order: Packet, time_ns: int) -> Sequence[Turn]:
        given, is_for_all = order.parameters, order.servo == frames.BROADCAST
        meant = [one for number, one in self.servos.items() if is_for_all or number == order.servo]
        reads = order.instruction in (frames.PING, frames.READ, frames.SYNC_READ)
        if order.instruction == frames.SYNC_READ:
            meant = [self.servos[number] for number in given[2:] if number in self.servos]
        elif order.instruction == frames.SYNC_WRITE and len(given) > 1:
            for i in range(2, len(given), 1 + given[1]):
                if given[i] in self.servos:
                    self.servos[given[i]].write(given[0], given[i + 1 : i + 1 + given[1]])
        elif order.instruction == frames.WRITE and given:
            for servo in meant:
                servo.write(given[0], given[1:])
        if is_for_all and order.instruction != frames.SYNC_READ:
            return ()
        place = given[:2] if reads else b""
        asked = [one for one in meant if reads or one.get(LEVEL)]
        return [(one, partial(self._status, one, place)) for one in asked]

    def _status(self, servo: FeetechServo, place: bytes) -> bytes:
        """Return a status with registers, from an address and so many."""
        data = servo.read(*place) if len(place) == 2 else b""
        return frames.packet(servo.wiring.number, servo.get(STATUS), data)
