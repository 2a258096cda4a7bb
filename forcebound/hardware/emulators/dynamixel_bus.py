"""Servos of the Dynamixel X series in current mode, as seen from their port: protocol 2.0.

Registers, limits, errors and the bus watchdog are those of the maker's e-manual. The motor gives
its goal current times its true torque constant, and no more than the supply can drive through a
motor at rest. Left out: every operating mode but that of current (no torque then), a shadow id,
indirect registers, fast reads, registered writes, profiles, back-EMF, heat.
"""

import math
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

from forcebound.hardware import dynamixel_frames as frames
from forcebound.hardware.emulators.servo_bus import (
    VOLTAGE,
    Servo,
    ServoBoard,
    Turn,
    Wiring,
)

BULK_READ = 0x92
LIMIT_BEYOND, ACCESS, LENGTH, RANGE, UNKNOWN = 6, 7, 5, 4, 2  # errors of a status
FIRMWARE = 45
CURRENT_MODE = 0
SPEED_UNIT = 0.229 * math.tau / 60.0  # rad/s
WATCHDOG_NS, FIRED = 20_000_000, 0xFF
TICKS = 32768  # ms, of the realtime tick
REGISTERS = 148
# Registers.
ID, DELAY, MODE, OFFSET, SHUTDOWN, TORQUE, LEVEL, ERROR = 7, 9, 11, 20, 63, 64, 68, 70
MOST_VOLTS, LEAST_VOLTS, CURRENT_LIMIT = 32, 34, 38
WATCHDOG, GOAL_PWM, GOAL_CURRENT, GOAL_SPEED, TICK, CURRENT = 98, 100, 102, 104, 120, 126
SPEED, POSITION, VOLTS, TEMPERATURE = 128, 132, 144, 146
LIMITS = {GOAL_PWM: 36, GOAL_CURRENT: CURRENT_LIMIT, GOAL_SPEED: 44}  # goal -> its limit


class Item(NamedTuple):
    """What may be written to a register."""

    size: int
    least: int
    most: int


def _items(text: str) -> dict[int, Item]:
    rows = [list(map(int, row.split(":"))) for row in text.split()]
    return {row[0]: Item(*row[1:]) for row in rows}


#: By address: bytes, least and most of what may be written; all others are read-only.
ITEMS = _items(
    "7:1:0:252 8:1:0:7 9:1:0:254 10:1:0:13 11:1:0:16 12:1:0:255 20:4:-1044479:1044479 24:4:0:1023"
    " 31:1:0:100 32:2:31:160 34:2:31:160 36:2:0:885 38:2:0:2047 44:4:0:2047 48:4:0:4095"
    " 52:4:0:4095 60:1:0:3 63:1:0:63 64:1:0:1 65:1:0:1 68:1:0:2 76:2:0:16383 78:2:0:16383"
    " 80:2:0:16383 82:2:0:16383 84:2:0:16383 98:1:0:127 100:2:-885:885 102:2:-2047:2047"
    " 104:4:-2047:2047 108:4:0:32767 112:4:0:32767 116:4:-1048575:1048575"
)


class DynamixelServo(Servo):
    """One servo.

    ``supply``: of its data sheet, in V. ``fed_ns``: when the bus last had an instruction.
    """

    kept, return_delay = 64, DELAY

    def __init__(self, wiring: Wiring, supply: float) -> None:
        model = wiring.model
        words = {0: model.number, MOST_VOLTS: 160, LEAST_VOLTS: round(7.0 * supply), 36: 885}
        words |= {CURRENT_LIMIT: model.current_limit, 44: 445, 48: 4095}
        given = {address: value.to_bytes(2, "little") for address, value in words.items()}
        ones = {6: FIRMWARE, ID: wiring.number, 8: 1, DELAY: 250, MODE: 3, 12: 255, 13: 2, 31: 70}
        ones |= {SHUTDOWN: 53 if model.has_watchdog else 52, LEVEL: 2, TEMPERATURE: 30}
        given |= {address: bytes((value,)) for address, value in ones.items()}
        super().__init__(wiring, given, REGISTERS)
        self._stall_per_volt = model.stall[1] / supply
        self.fed_ns = 0

    def refresh(self) -> None:
        offset = self.get(OFFSET, 4, signed=True)
        self.put(TICK, self.time_ns // 1_000_000 % TICKS, 2)
        self.put(CURRENT, round(self.current() / self.wiring.model.current_unit), 2)
        self.put(SPEED, round(self.speed / SPEED_UNIT), 4)
        self.put(POSITION, self.counts + offset, 4)
        self.put(VOLTS, round(10.0 * self.supply), 2)

    def look(self, time_ns: int, angle: float, supply: float) -> None:
        super().look(time_ns, angle, supply)
        if not self.get(LEAST_VOLTS, 2) <= 10.0 * supply <= self.get(MOST_VOLTS, 2):
            self.fail(VOLTAGE)
        steps = self.get(WATCHDOG)
        if self.get(TORQUE) and 0 < steps < FIRED and time_ns - self.fed_ns > steps * WATCHDOG_NS:
            self.bite()

    def bite(self) -> None:
        """Let the bus watchdog fire."""
        self.put(WATCHDOG, FIRED)
        self._clear_goals()

    def fail(self, error: int) -> None:
        self.put(ERROR, self.get(ERROR) | error)
        if self.get(ERROR) & self.get(SHUTDOWN):
            self.put(TORQUE, 0)

    def current(self) -> float:
        if not self.get(TORQUE) or self.get(MODE) != CURRENT_MODE:
            return 0.0
        unit: float = self.wiring.model.current_unit
        goal = self.get(GOAL_CURRENT, 2, signed=True) * unit
        most: float = self._stall_per_volt * self.supply
        return min(max(goal, -most), most)

    def torque(self) -> float:
        return self.wiring.constant * self.current()

    def write(self, address: int, data: bytes) -> int:
        """Write registers, all or none; return the error of the status."""
        found: list[tuple[int, bytes]] = []
        while data:
            item = ITEMS.get(address)
            if item is None or (address < self.kept and self.get(TORQUE)):
                return ACCESS
            if len(data) < item.size:
                return LENGTH
            value = int.from_bytes(data[: item.size], "little", signed=item.least < 0)
            is_stopped = address in LIMITS and self.get(WATCHDOG) == FIRED
            if is_stopped or not item.least <= value <= item.most:
                return RANGE
            if address in LIMITS and abs(value) > self.get(LIMITS[address], 2):
                return LIMIT_BEYOND
            found.append((address, data[: item.size]))
            address, data = address + item.size, data[item.size :]
        for place, given in found:
            self._set(place, given)
        return 0

    def _set(self, address: int, value: bytes) -> None:
        if address == TORQUE and self.get(ERROR) & self.get(SHUTDOWN):
            return  # until it restarts
        self.registers[address : address + len(value)] = value
        if address == MODE:
            self._clear_goals()

    def _clear_goals(self) -> None:
        self.put(GOAL_PWM, 0, 8)


class DynamixelBus(ServoBoard):
    """The bus; see the base class."""

    frames = frames
    servos: Mapping[int, DynamixelServo]

    def _look(self, time_ns: int) -> None:
        super()._look(time_ns)
        for number, servo in self.servos.items():
            if self.faults.is_on("watchdog", time_ns, number):
                servo.bite()

    def _begin(self, order: Any, time_ns: int) -> None:
        for servo in self.servos.values():
            servo.fed_ns = time_ns
        super()._begin(order, time_ns)

    def _obey(self, order: frames.Packet) -> Sequence[Turn]:
        given, servos = order.parameters, self._meant(order.servo)
        if order.instruction == frames.SYNC_READ:
            return self._readings([(number, given[:4]) for number in given[4:]])
        if order.instruction == BULK_READ:
            rows = [given[i : i + 5] for i in range(0, len(given), 5)]
            return self._readings([(row[0], row[1:]) for row in rows])
        if order.instruction == frames.SYNC_WRITE:
            size = 1 + _word(given[2:4])
            for row in [given[i : i + size] for i in range(4, len(given), size)]:
                for servo in self._meant(row[0]):
                    servo.write(_word(given), row[1:])
            return ()
        if order.instruction == frames.PING:
            return [(one, partial(self._status, one, 0, b"\0\0\2\0\6\0\1\0")) for one in servos]
        if order.instruction == frames.READ:
            return self._readings([(order.servo, given)])
        errors = [self._change(one, order) for one in servos]
        return [
            (one, partial(self._status, one, error))
            for one, error in zip(servos, errors, strict=True)
            if one.get(LEVEL) == 2 and order.servo != frames.BROADCAST
        ]

    def _change(self, servo: DynamixelServo, order: frames.Packet) -> int:
        if order.instruction == frames.WRITE:
            return servo.write(_word(order.parameters), order.parameters[2:])
        if order.instruction == frames.REBOOT:
            servo.restart()
            return 0
        return UNKNOWN

    def _meant(self, number: int) -> list[DynamixelServo]:
        if number == frames.BROADCAST:
            return list(self.servos.values())
        return [self.servos[number]] if number in self.servos else []

    def _readings(self, asked: Sequence[tuple[int, bytes]]) -> list[Turn]:
        return [
            (servo, partial(self._status, servo, 0, place))
            for number, place in asked
            if (servo := self.servos.get(number)) is not None and servo.get(LEVEL) > 0
        ]

    def _status(self, servo: DynamixelServo, error: int, places: bytes = b"") -> bytes:
        """Return a status with the registers at ``places``, each an address and a size."""
        data = b""
        for i in range(0, len(places), 4):
            address, size = _word(places[i:]), _word(places[i + 2 :])
            data += servo.read(address, size)
            error = error if address + size <= REGISTERS else ACCESS
        alert = frames.ALERT if servo.get(ERROR) else 0
        content = bytes((error | alert,)) + (b"" if error == ACCESS else data)
        return frames.packet(servo.wiring.number, frames.STATUS, content)


def _word(data: bytes) -> int:
    return int.from_bytes(data[:2], "little")
