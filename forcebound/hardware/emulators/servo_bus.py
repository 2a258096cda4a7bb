"""Servos on a bus of one wire, as seen from its port: time, faults, and what all servos have.

A byte takes ten bits of time. An order acts when its last byte has come; then the servos that it
asks answer one after the other, each after its return delay, with what its registers hold when its
turn begins. Behind a servo that is silent, the next waits for as long as the answer would take. The
converter passes the answers to an order on together, when the last has come.
Left out: two that speak at a time, and a wrong baud rate: a pseudo-terminal has none.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from heapq import heappop, heappush
from itertools import count
from typing import Any, NamedTuple

from forcebound.errors import ConfigError, DeviceError
from forcebound.haptics.devices.true_values import TrueServos
from forcebound.hardware.emulators.faults import Faults
from forcebound.hardware.servo_models import COUNTS
from forcebound.messages.packets import Vector

BITS = 10  # of a byte on the wire
LONGEST = 1024  # bytes of a message
SPEED_NS = 2_000_000  # over which a servo measures its speed
DELAY_NS = 2000  # unit of the return delay
BROWN_OUT = 0.45  # of the supply that is left


class Wiring(NamedTuple):
    """How a servo is built in; the shaft's own sense is that of its counts."""

    number: int
    direction: int
    zero: int  # counts where the joint is at 0 rad
    constant: float  # of the joint: N m/A, or N m with full duty at the largest supply
    model: Any  # its numbers in the data sheet


class Drive(NamedTuple):
    """What a motor does; positive towards larger counts."""

    current: float = 0.0  # A
    torque: float = 0.0  # N m, without its braking
    braking: float = 0.0  # N m s, damping that it adds


OFF = Drive()


class Servo(ABC):
    """One servo: its registers, and its shaft.

    Attributes:
        registers: As they are read, least byte first.
        has_power: Whether its cable is whole.
        angle: Of the shaft, in rad, 0 where the joint is at 0 rad.
        speed: In rad/s.
        supply: In V.
    """

    kept: int  # registers before this one survive a restart
    return_delay: int  # the register of it
    overload, voltage = 0x20, 0x01  # bits of what is wrong, in both families

    def __init__(self, wiring: Wiring, size: int, *registers: tuple[int, int, int]) -> None:
        self.wiring, self.registers = wiring, bytearray(size)
        for address, length, value in registers:
            self.put(address, value, length)
        self._new = self.registers[:]
        self.has_power = True
        self.angle = self.speed = self.supply = self._seen = 0.0
        self.time_ns = self._seen_ns = 0

    def get(self, address: int, size: int = 1, signed: bool = False) -> int:
        """Return a number that is in the registers."""
        return int.from_bytes(self.registers[address : address + size], "little", signed=signed)

    def put(self, address: int, value: int, size: int = 1) -> None:
        """Set it."""
        self.registers[address : address + size] = (value % 256**size).to_bytes(size, "little")

    @property
    def counts(self) -> int:
        """What the encoder reads."""
        return math.floor(self.angle * COUNTS / math.tau + 0.5) + self.wiring.zero

    def look(self, time_ns: int, angle: float, supply: float) -> None:
        """See the joint's angle and the supply at a time."""
        self.time_ns, self.supply = time_ns, supply
        self.angle = self.wiring.direction * angle
        if (took_ns := time_ns - self._seen_ns) >= SPEED_NS:
            self.speed = (self.angle - self._seen) / (took_ns * 1e-9)
            self._seen, self._seen_ns = self.angle, time_ns

    def restart(self) -> None:
        """Begin again, as after a loss of power: without torque, and without a fault."""
        self.registers[self.kept :] = self._new[self.kept :]

    def read(self, address: int, size: int) -> bytes:
        """Return registers, with what it measures now."""
        self.refresh()
        return bytes(self.registers[address : address + size])

    @abstractmethod
    def refresh(self) -> None:
        """Set the registers that show what it measures."""

    @abstractmethod
    def fail(self, error: int) -> None:
        """Note bits of what is wrong with it; the torque goes off if it is to."""

    @abstractmethod
    def drive(self) -> Drive:
        """Return what its motor does now."""


Turn = tuple[Servo, Callable[[], bytes]]  # who speaks, and what it says when it does


class ServoBoard(ABC):
    """The bus; see :class:`forcebound.hardware.emulators.emulation.Board`.

    ``brake`` takes the damping of the motors, in N m s; the supply is in V where none is true.

    Attributes:
        servos: By their ids, in the order of the joints and of the chain.
        faults: On demand.
    """

    frames: Any  # the module of the packets
    servos: Mapping[int, Any]
    faults = Faults(())

    def __init__(
        self,
        servos: Sequence[Servo],
        baud: int,
        truth: TrueServos,
        supply: float,
        brake: Callable[[Vector], None],
    ) -> None:
        self.servos = {one.wiring.number: one for one in servos}
        self.angles: Vector = (0.0,) * len(servos)
        self.torque: Vector = (0.0,) * len(servos)
        self.wake_ns: int | None = None
        self._brake, self._truth, self._supply = brake, truth, truth.supply or supply
        self._byte_ns = BITS * 1e9 / baud
        self._inbox, self._said, self._reply = bytearray(), bytearray(), bytearray()
        self._quiet_ns = 0  # when the last byte has passed, in either direction
        self._events: list[tuple[int, int, Callable[[int], None]]] = []
        self._numbers = count()
        self._taken = 0.0  # A, of all motors
        self._cut_at: int | None = None  # the first servo without power

    def plan(self, faults: Faults) -> None:
        """Take faults on demand; ConfigError if one is of a servo that there is not."""
        if unknown := faults.servos - set(self.servos):
            there = ", ".join(map(str, self.servos))
            raise ConfigError(f"a fault is of servo {min(unknown)}; the servos are {there}")
        self.faults = faults

    def receive(self, data: bytes, time_ns: int) -> bytes:
        self._look(time_ns)
        if data:
            self._quiet_ns = max(self._quiet_ns, time_ns) + round(len(data) * self._byte_ns)
            self._inbox += data
            self._take()
        while self._events and self._events[0][0] <= time_ns:
            at_ns, _, event = heappop(self._events)
            event(at_ns)
        servos = self.servos.values()
        drives = [one.drive() if one.has_power else OFF for one in servos]
        self._taken = sum([abs(one.current) for one in drives])
        pairs = zip(servos, drives, strict=True)
        self.torque = tuple([servo.wiring.direction * one.torque for servo, one in pairs])
        self._brake(tuple([one.braking for one in drives]))
        self.wake_ns = self._events[0][0] if self._events else None
        reply = bytes(self._reply)
        self._reply.clear()
        return reply

    def reset(self) -> None:
        """Restart all servos."""
        for servo in self.servos.values():
            servo.restart()

    def with_nan(self, reply: bytes) -> bytes:
        return reply  # whole numbers are always some

    @abstractmethod
    def obey(self, order: Any, time_ns: int) -> Sequence[Turn]:
        """Let an order act; return who answers."""

    def _look(self, time_ns: int) -> None:
        supply = self._supply - self._truth.sag * self._taken
        supply *= BROWN_OUT if self.faults.is_on("voltage", time_ns) else 1.0
        if self._cut_at is not None and not self.faults.is_on("cut", time_ns, self._cut_at):
            self._set_power(self._cut_at, True)
        for angle, (number, servo) in zip(self.angles, self.servos.items(), strict=True):
            servo.look(time_ns, angle, supply)
            if self.faults.is_on("overload", time_ns, number):
                servo.fail(servo.overload)

    def _set_power(self, first: int, has_power: bool) -> None:
        """Give power to a servo and those behind it, or take it."""
        self._cut_at = None if has_power else first
        for servo in list(self.servos.values())[list(self.servos).index(first) :]:
            servo.restart()
            servo.has_power = has_power

    def _take(self) -> None:
        """Take the messages that are whole out of what has come; the rest waits."""
        while self._inbox:
            data = bytes(self._inbox)
            try:
                size = self.frames.size(data)
                if size <= LONGEST and not 0 < size <= len(data):
                    return
                order = self.frames.parse(data[:size])
            except DeviceError:
                del self._inbox[0]  # the next may begin within a spoiled one
                continue
            del self._inbox[:size]
            came_ns = self._quiet_ns - round(len(self._inbox) * self._byte_ns)
            self._at(came_ns, partial(self._begin, order))

    def _at(self, time_ns: int, event: Callable[[int], None]) -> None:
        heappush(self._events, (time_ns, next(self._numbers), event))

    def _begin(self, order: Any, time_ns: int) -> None:
        self._pass_on(iter(self.obey(order, time_ns)), time_ns)

    def _pass_on(self, turns: Iterator[Turn], time_ns: int) -> None:
        """Give the turn to the next who answers; if there is none, pass on what was said."""
        if (turn := next(turns, None)) is not None:
            delay_ns = DELAY_NS * turn[0].get(turn[0].return_delay)
            self._at(time_ns + delay_ns, partial(self._speak, turn, turns))
        elif said := bytes(self._said):
            self._said.clear()
            late_ns = round(self._truth.latency * 1e9)
            self._at(time_ns + late_ns, lambda _: self._reply.extend(said))

    def _speak(self, turn: Turn, turns: Iterator[Turn], time_ns: int) -> None:
        servo, data = turn[0], turn[1]()
        number, end_ns = servo.wiring.number, time_ns + round(len(data) * self._byte_ns)
        self._quiet_ns = max(self._quiet_ns, end_ns)
        if servo.has_power and self.faults.is_on("cut", time_ns, number):
            self._said += data[: len(data) // 2]
            self._set_power(number, False)
        if servo.has_power and not self.faults.is_on("silent", time_ns, number):
            is_spoiled = self.faults.is_on("checksum", time_ns, number)
            self._said += data[:-1] + bytes((data[-1] ^ 0xFF * is_spoiled,))
        self._pass_on(turns, end_ns)
