"""Servos of the Feetech STS series with an open-loop duty cycle, as seen from their port.

In mode 2 register 44 is the duty cycle, its sign in bit 10, and stays for ever: there is no
watchdog. The motor is a voltage behind a resistance: its torque is that of the duty at this supply,
less its back-EMF, a damping that is there while the motor is driven. A duty beyond register 36 for
the time in 35 is an overload: the torque goes off until it is switched off and on again. A servo of
the HLS series answers, and never moves: what its register 44 does is not settled.

What is known of the registers is what lerobot's tables and the maker's pages say. Left out: modes
0, 1 and 3 (no torque then), multi-turn angles, registered writes, the current's dynamics, heat.
"""

import math
from collections.abc import Mapping, Sequence
from functools import partial

from forcebound.hardware import feetech_frames as frames
from forcebound.hardware.emulators.servo_bus import (
    OVERLOAD,
    VOLTAGE,
    Servo,
    ServoBoard,
    Turn,
    Wiring,
)
from forcebound.hardware.servo_models import COUNTS, DUTY, FEETECH_CURRENT, FEETECH_VOLT

STALL_CURRENT = 2.5  # A, at the voltage of the data sheet: that of an STS3215, assumed of others
DUTY_MODE = 2
OVERLOAD_NS = 10_000_000  # unit of register 35
REGISTERS = 71
# Registers.
MODEL, ID, DELAY, LEVEL, MOST_VOLTS, LEAST_VOLTS, MOST_TORQUE, UNLOADING = (
    3,
    5,
    7,
    8,
    14,
    15,
    16,
    19,
)
OFFSET, MODE, OVERLOAD_TIME, OVERLOAD_DUTY, TORQUE, GOAL, LIMIT, LOCK = (
    31,
    33,
    35,
    36,
    40,
    44,
    48,
    55,
)
POSITION, SPEED, LOAD, VOLTS, TEMPERATURE, STATUS, CURRENT = 56, 58, 60, 62, 63, 65, 69
RAM = 40  # registers from here on are forgotten
READ_ONLY = (*range(ID), *range(POSITION, REGISTERS))


class FeetechServo(Servo):
    """One servo; ``largest`` is the supply at which its constant holds, in V."""

    kept, return_delay = RAM, DELAY

    def __init__(self, wiring: Wiring, largest: float) -> None:
        model = wiring.model
        ones = {0: 3, 1: 10, ID: wiring.number, DELAY: 250, LEVEL: 1, 13: 70, MOST_VOLTS: 140}
        ones |= {LEAST_VOLTS: 40, UNLOADING: 44, OVERLOAD_TIME: 200, OVERLOAD_DUTY: 80, LOCK: 1}
        given = {address: bytes((value,)) for address, value in ones.items()}
        words = {MODEL: model.number or 0, MOST_TORQUE: DUTY, LIMIT: DUTY, 11: COUNTS - 1}
        given |= {address: value.to_bytes(2, "little") for address, value in words.items()}
        given[TEMPERATURE] = bytes((30,))
        super().__init__(wiring, given, REGISTERS)
        self._per_volt = wiring.constant / largest  # N m/V
        self._back_emf: float = model.voltage / model.free_speed  # V s/rad
        self._resistance: float = model.voltage / STALL_CURRENT
        self._loaded_ns: int | None = None  # since when its duty is an overload

    @property
    def duty(self) -> float:
        """What the motor is driven with, as a share of the supply."""
        is_driven = self.get(TORQUE) == 1 and self.get(MODE) == DUTY_MODE
        if not is_driven or not self.wiring.model.has_duty:
            return 0.0
        most = min(self.get(LIMIT, 2), self.get(MOST_TORQUE, 2), DUTY)
        goal = frames.decoded(GOAL, self.bytes_at(GOAL, 2))
        return min(max(goal, -most), most) / DUTY

    def refresh(self) -> None:
        counts = self.counts - frames.decoded(OFFSET, self.bytes_at(OFFSET, 2))
        shown = {
            POSITION: counts % COUNTS,
            SPEED: round(self.speed * COUNTS / math.tau),
            LOAD: round(self.duty * DUTY),
            CURRENT: round(self.current() / FEETECH_CURRENT),
        }
        for address, value in shown.items():
            self.registers[address : address + 2] = frames.encoded(address, value)
        self.put(VOLTS, round(self.supply / FEETECH_VOLT))

    def look(self, time_ns: int, angle: float, supply: float) -> None:
        super().look(time_ns, angle, supply)
        is_well = self.get(LEAST_VOLTS) <= supply / FEETECH_VOLT <= self.get(MOST_VOLTS)
        self.put(STATUS, self.get(STATUS) & ~VOLTAGE)
        if not is_well:
            self.fail(VOLTAGE)
        if 100.0 * abs(self.duty) <= self.get(OVERLOAD_DUTY):
            self._loaded_ns = None
        elif self._loaded_ns is None:
            self._loaded_ns = time_ns
        elif time_ns - self._loaded_ns > OVERLOAD_NS * self.get(OVERLOAD_TIME):
            self.fail(OVERLOAD)

    def fail(self, error: int) -> None:
        self.put(STATUS, self.get(STATUS) | error)
        if error & self.get(UNLOADING):
            self.put(TORQUE, 0)

    def current(self) -> float:
        if not self.get(TORQUE):
            return 0.0
        return (self.duty * self.supply - self._back_emf * self.speed) / self._resistance

    def torque(self) -> float:
        return self._per_volt * self.duty * self.supply

    def braking(self) -> float:
        is_driven = self.get(TORQUE) and self.get(MODE) == DUTY_MODE
        return self._per_volt * self._back_emf if is_driven else 0.0

    def write(self, address: int, data: bytes) -> None:
        """Write registers; what is read-only stays, and what is locked is kept until a restart."""
        for place, value in enumerate(data[: max(REGISTERS - address, 0)], start=address):
            if place == TORQUE and value == 0:
                self.put(STATUS, 0)
            if place in READ_ONLY or (place == TORQUE and self.get(STATUS) & OVERLOAD):
                continue
            self.registers[place] = value
            if place < RAM and not self.get(LOCK):
                self._new[place] = value

    def restart(self) -> None:
        self.registers[:] = self._new


class FeetechBus(ServoBoard):
    """The bus; see the base class."""

    frames = frames
    servos: Mapping[int, FeetechServo]

    def _obey(self, order: frames.Packet) -> Sequence[Turn]:
        given = order.parameters
        if order.instruction == frames.SYNC_READ:
            asked = [self.servos[number] for number in given[2:] if number in self.servos]
            return [(one, partial(self._status, one, given[:2])) for one in asked]
        if order.instruction == frames.SYNC_WRITE:
            size = 1 + (given[1] if len(given) > 1 else 0)
            for row in [given[i : i + size] for i in range(2, len(given), size)]:
                if row[0] in self.servos:
                    self.servos[row[0]].write(given[0], row[1:])
            return ()
        is_for_all = order.servo == frames.BROADCAST
        meant = [one for number, one in self.servos.items() if is_for_all or number == order.servo]
        reads = order.instruction in (frames.PING, frames.READ)
        if order.instruction == frames.WRITE and given:
            for servo in meant:
                servo.write(given[0], given[1:])
        places = given[:2] if order.instruction == frames.READ else b""
        return [
            (one, partial(self._status, one, places))
            for one in meant
            if not is_for_all and (reads or one.get(LEVEL))
        ]

    def _status(self, servo: FeetechServo, places: bytes) -> bytes:
        """Return a status with registers, from an address and so many."""
        data = servo.read(*places) if len(places) == 2 else b""
        return frames.packet(servo.wiring.number, servo.get(STATUS), data)
