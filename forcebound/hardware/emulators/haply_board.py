"""The Haply board with its firmware M3 V1.5, as seen from its port.

A message is a command, the address of a device, and what the command takes; there is no frame, no
checksum and no acknowledgement::

    00 address                                                   reset: no reply
    01 address mask direction... mask direction... n pin... n pin... (offset, counts)...
                                                                 set-up: no reply
    02 address torque...                                         exchange: address angle...

Masks are those of motors and of encoders, bit i for port i + 1; the pins are analogue and pulse
pins; numbers are float32, least byte first: degrees, counts per turn, N m. What a driver must know
of the real board, and this one does: docs/devices.md. Left out: the address 0, which on the real
board means every port that is not in use; analogue and pulse pins; that directions are kept in
their order, not by port.
"""

import math
import struct
from collections.abc import Generator, Sequence
from typing import TypeAlias

from forcebound.messages.packets import Vector

RESET, SETUP, EXCHANGE = 0, 1, 2  # commands
PORTS = 4
LARGEST_TORQUE = 0.123  # N m, the firmware's clamp
DUTIES = 4095  # steps of a motor's pulse width
BYTE_NS = 1_000_000_000  # the time that a byte of a number is waited for
NOTHING = 0xFF  # what reading a byte gives where none has come

#: What the firmware waits for: a number of bytes, and whether each of them only for 1 s.
Wait: TypeAlias = tuple[int, bool]
Firmware: TypeAlias = Generator[Wait, bytes, None]


class HaplyBoard:
    """The board; see :class:`forcebound.hardware.emulators.emulation.Board`.

    ``resolutions`` are those of the encoders at its ports, from port 1 up, in rad; ``senses`` the
    direction, 0 or 1, with which each port counts and turns towards larger angles.
    """

    def __init__(self, resolutions: Sequence[float], senses: Sequence[int] = (1, 1)) -> None:
        self.angles: Vector = (0.0,) * len(resolutions)
        self.torque: Vector = (0.0,) * len(resolutions)
        self.wake_ns: int | None = None
        self._resolutions, self._senses = tuple(resolutions), tuple(senses)
        self._inbox, self._reply = bytearray(), bytearray()
        self._memory = bytearray(16 * PORTS)  # under the numbers of a message
        self.reset()
        self._firmware = self._run()
        self._wait = next(self._firmware)

    def reset(self) -> None:
        """Forget the set-up, not the torque."""
        self._address: int | None = None
        self._motors: dict[int, int] = {}  # sign by port, from 0 up
        self._encoders: dict[int, tuple[int, int, float]] = {}  # sign, counts at 0, counts a turn

    def receive(self, data: bytes, time_ns: int) -> bytes:
        if self.wake_ns is not None and time_ns >= self.wake_ns:
            self._go_on()
        self._inbox += data
        while len(self._inbox) >= self._wait[0]:
            self._go_on()
        if not self._wait[1]:
            self.wake_ns = None
        elif data or self.wake_ns is None:
            self.wake_ns = time_ns + BYTE_NS
        reply = bytes(self._reply)
        self._reply.clear()
        return reply

    def with_nan(self, reply: bytes) -> bytes:
        return reply[:1] + struct.pack("<f", math.nan) * ((len(reply) - 1) // 4)

    def _go_on(self) -> None:
        """Give the firmware what it waits for, or what has come of it."""
        count = self._wait[0]
        taken = bytes(self._inbox[:count])
        del self._inbox[:count]
        self._wait = self._firmware.send(taken)

    def _run(self) -> Firmware:
        while True:
            (command,) = yield 1, False
            if command == RESET:
                self._byte()
                self.reset()
            elif command == SETUP:
                yield from self._set_up()
            elif command == EXCHANGE:
                yield from self._exchange()

    def _byte(self) -> int:
        """Take a byte without waiting."""
        return self._inbox.pop(0) if self._inbox else NOTHING

    def _numbers(self, count: int) -> Generator[Wait, bytes, list[float]]:
        """Take numbers; each byte is waited for."""
        came = yield 4 * count, True
        self._memory[: len(came)] = came
        return [number for (number,) in struct.iter_unpack("<f", self._memory[: 4 * count])]

    def _set_up(self) -> Firmware:
        self.reset()
        address = self._byte()
        self._motors = self._ports()
        encoders = self._ports()
        for _ in ("analogue", "pulse"):
            for _ in range(self._byte()):
                self._byte()
        if encoders:
            numbers = yield from self._numbers(2 * len(encoders))
            for (port, sign), offset, turn in zip(
                encoders.items(), numbers[::2], numbers[1::2], strict=True
            ):
                counts = offset * turn / 360.0
                start = int(counts) if math.isfinite(counts) else 0
                self._encoders[port] = sign, start - sign * self._counts(port), turn
        self._address = address

    def _ports(self) -> dict[int, int]:
        """Take a mask and the directions of the ports in it; return their signs."""
        mask = self._byte()
        ports = [port for port in range(PORTS) if mask >> port & 1]
        senses = (*self._senses, *(1,) * PORTS)
        return {port: 1 if self._byte() == senses[port] else -1 for port in ports}

    def _exchange(self) -> Firmware:
        address = self._byte()
        is_known = address == self._address
        if is_known and self._motors:
            torques = yield from self._numbers(len(self._motors))
            held = list(self.torque)
            for (port, sign), torque in zip(self._motors.items(), torques, strict=True):
                if port < len(held):
                    held[port] = sign * held_torque(torque)
            self.torque = tuple(held)
        self._reply.append(address)
        if is_known:
            for port, (sign, zero, turn) in self._encoders.items():
                counts = zero + sign * self._counts(port)
                self._reply += struct.pack("<f", 360.0 * counts / turn if turn else math.nan)

    def _counts(self, port: int) -> int:
        """Return the counts of an encoder from angle 0 towards larger angles."""
        if port >= len(self._resolutions):
            return 0
        return math.floor(self.angles[port] / self._resolutions[port] + 0.5)


def held_torque(torque: float) -> float:
    """Return what a motor gives for a commanded torque, in N m."""
    if math.isnan(torque):
        return LARGEST_TORQUE
    duty = int(DUTIES * min(abs(torque), LARGEST_TORQUE) / LARGEST_TORQUE)
    return math.copysign(duty / DUTIES * LARGEST_TORQUE, torque)
