"""Servos of the Dynamixel X series in current mode, as seen from their port: protocol 2.0.

Registers, limits, errors and the bus watchdog are those of the maker's e-manual. The motor gives
its goal current times its true torque constant, and no more than the supply can drive through a
motor at rest. Left out: every operating mode but that of current (no torque then), a shadow id,
indirect registers, bulk and fast reads, registered writes, profiles, back-EMF, heat.
"""

import math
from collections.abc import Mapping, Sequence
from functools import partial

from forcebound.hardware import dynamixel_frames as frames
from forcebound.hardware.dynamixel_frames import Packet
from forcebound.hardware.emulators.servo_bus import OFF, Drive, Servo, ServoBoard, Turn, Wiring

UNKNOWN, RANGE, LENGTH, LIMIT, ACCESS = 2, 4, 5, 6, 7  # errors of a status
FIRMWARE = 45
CURRENT_MODE = 0
SPEED_UNIT = 0.229 * math.tau / 60.0  # rad/s
WATCHDOG_NS, FIRED = 20_000_000, 0xFF
TICKS = 32768  # ms, of the realtime tick
REGISTERS = 148
# Registers.
ID, DELAY, MODE, OFFSET, MOST_VOLTS, LEAST_VOLTS, CURRENT_LIMIT = 7, 9, 11, 20, 32, 34, 38
SHUTDOWN, TORQUE, LEVEL, ERROR, WATCHDOG, GOAL_PWM, GOAL_CURRENT = 63, 64, 68, 70, 98, 100, 102
TICK, CURRENT, SPEED, POSITION, VOLTS, TEMPERATURE = 120, 126, 128, 132, 144, 146
LIMITS = {GOAL_PWM: 36, GOAL_CURRENT: CURRENT_LIMIT, 104: 44}  # goal -> its limit
GOALS = 8  # bytes, from GOAL_PWM on
#: Address, bytes, least and most of what may be written; all other registers are read-only.
_ITEMS = (
    "7 1 0 252, 8 1 0 7, 9 1 0 254, 10 1 0 13, 11 1 0 16, 20 4 -1044479 1044479, 31 1 0 100,"
    "32 2 31 160, 34 2 31 160, 36 2 0 885, 38 2 0 2047, 44 4 0 2047, 48 4 0 4095, 52 4 0 4095,"
    "63 1 0 63, 64 1 0 1, 65 1 0 1, 68 1 0 2, 98 1 0 127, 100 2 -885 885, 102 2 -2047 2047,"
    "104 4 -2047 2047, 108 4 0 32767, 112 4 0 32767, 116 4 -1048575 1048575"
)
ITEMS = {item[0]: item[1:] for item in (tuple(map(int, i.split())) for i in _ITEMS.split(","))}


class DynamixelServo(Servo):
    """One servo; ``supply``: of its data sheet, in V; ``fed_ns``: of the last instruction."""

    kept, return_delay = 64, DELAY

    def __init__(self, wiring: Wiring, supply: float) -> None:
        model = wiring.model
        volts = ((MOST_VOLTS, 2, 160), (LEAST_VOLTS, 2, round(7.0 * supply)))
        limits = (
            (36, 2, 885),
            (CURRENT_LIMIT, 2, model.current_limit),
            (44, 4, 445),
            (48, 4, 4095),
        )
        itself = ((0, 2, model.number), (6, 1, FIRMWARE), (ID, 1, wiring.number), (8, 1, 3))
        modes = ((DELAY, 1, 250), (MODE, 1, 3), (LEVEL, 1, 2), (TEMPERATURE, 1, 30))
        errors = (SHUTDOWN, 1, 53 if model.has_watchdog else 52)
        super().__init__(wiring, REGISTERS, *volts, *limits, *itself, *modes, errors)
        self._stall_per_volt: float = model.stall[1] / supply
        self.fed_ns = 0

    def refresh(self) -> None:
        current = self.drive().current / self.wiring.model.current_unit
        self.put(TICK, self.time_ns // 1_000_000 % TICKS, 2)
        self.put(CURRENT, round(current), 2)
        self.put(SPEED, round(self.speed / SPEED_UNIT), 4)
        self.put(POSITION, self.counts + self.get(OFFSET, 4, signed=True), 4)
        self.put(VOLTS, round(10.0 * self.supply), 2)

    def look(self, time_ns: int, angle: float, supply: float) -> None:
        is_other = supply != self.supply
        super().look(time_ns, angle, supply)
        if is_other and not self.get(LEAST_VOLTS, 2) <= 10.0 * supply <= self.get(MOST_VOLTS, 2):
            self.fail(self.voltage)
        steps = self.registers[WATCHDOG]
        is_silent = 0 < steps < FIRED and time_ns - self.fed_ns > steps * WATCHDOG_NS
        if is_silent and self.registers[TORQUE]:
            self.bite()

    def bite(self) -> None:
        """Let the bus watchdog fire."""
        self.put(WATCHDOG, FIRED)
        self.put(GOAL_PWM, 0, GOALS)

    def fail(self, error: int) -> None:
        self.put(ERROR, self.get(ERROR) | error)
        if self.get(ERROR) & self.get(SHUTDOWN):
            self.put(TORQUE, 0)

    def drive(self) -> Drive:
        if not self.registers[TORQUE] or self.registers[MODE] != CURRENT_MODE:
            return OFF
        most = self._stall_per_volt * self.supply
        goal = self.get(GOAL_CURRENT, 2, signed=True) * self.wiring.model.current_unit
        current = min(max(goal, -most), most)
        return Drive(current, self.wiring.constant * current)

    def write(self, address: int, data: bytes) -> int:
        """Write registers, all or none; return the error of the status."""
        before = self.registers[:]
        while data:
            size, least, most = ITEMS.get(address, (1, 0, -1))
            value = int.from_bytes(data[:size], "little", signed=least < 0)
            if least > most or (address < self.kept and self.get(TORQUE)):
                error = ACCESS
            elif len(data) < size:
                error = LENGTH
            elif not least <= value <= most or (address in LIMITS and self.get(WATCHDOG) == FIRED):
                error = RANGE
            else:
                beyond = address in LIMITS and abs(value) > self.get(LIMITS[address], 2)
                error = LIMIT if beyond else 0
            if error:
                self.registers = before
                return error
            if address != TORQUE or not self.get(ERROR) & self.get(SHUTDOWN):  # until a restart
                self.put(address, value, size)
            if address == MODE:
                self.put(GOAL_PWM, 0, GOALS)
            address, data = address + size, data[size:]
        return 0


class DynamixelBus(ServoBoard):
    """The bus; see the base class."""

    frames = frames
    servos: Mapping[int, DynamixelServo]

    def obey(self, order: Packet, time_ns: int) -> Sequence[Turn]:
        for number, servo in self.servos.items():
            servo.fed_ns = time_ns
            if self.faults.is_on("watchdog", time_ns, number):
                servo.bite()
        given, is_for_all = order.parameters, order.servo == frames.BROADCAST
        meant = [one for number, one in self.servos.items() if is_for_all or number == order.servo]
        place, size = _word(given), _word(given[2:])
        if order.instruction == frames.SYNC_WRITE:
            for i in range(4, len(given), 1 + size):
                if given[i] in self.servos:
                    self.servos[given[i]].write(place, given[i + 1 : i + 1 + size])
            return ()
        if order.instruction == frames.PING:
            return [(one, partial(self._status, one, 0, (0, 2), (6, 1))) for one in meant]
        if order.instruction == frames.SYNC_READ:
            meant = [self.servos[number] for number in given[4:] if number in self.servos]
        if order.instruction in (frames.READ, frames.SYNC_READ):
            asked = [one for one in meant if one.get(LEVEL)]
            return [(one, partial(self._status, one, 0, (place, size))) for one in asked]
        errors = [self._change(one, order) for one in meant]
        return [
            (one, partial(self._status, one, error))
            for one, error in zip(meant, errors, strict=True)
            if one.get(LEVEL) == 2 and not is_for_all
        ]

    def _change(self, servo: DynamixelServo, order: Packet) -> int:
        if order.instruction == frames.WRITE:
            return servo.write(_word(order.parameters), order.parameters[2:])
        if order.instruction == frames.REBOOT:
            servo.restart()
            return 0
        return UNKNOWN

    def _status(self, servo: DynamixelServo, error: int, *places: tuple[int, int]) -> bytes:
        """Return a status with the registers at places, each an address and a size."""
        error = ACCESS if any(sum(one) > REGISTERS for one in places) else error
        alert = frames.ALERT if servo.get(ERROR) else 0
        data = b"" if error else b"".join([servo.read(*one) for one in places])
        return frames.packet(servo.wiring.number, frames.STATUS, bytes((error | alert,)) + data)


def _word(data: bytes) -> int:
    return int.from_bytes(data[:2], "little")
