r"""The Haply board with its firmware M3 V1.5, as seen from its port.

A message is a command, the address of a device, and what the command takes; there is no frame, no
checksum and no acknowledgement::

    00 address                                                   reset: no reply
    01 address mask direction... mask direction... n pin... n pin... (offset, counts)...
                                                                 set-up: no reply
    02 address pulse... torque...                                exchange: address value... angle...

Masks are those of motors and of encoders, bit i for port i + 1; the pins are analogue and pulse
pins; numbers are float32, least byte first: degrees, counts per turn, N m.

What a driver must know, because the real board does it:

* Single bytes are taken without waiting: one that has not come yet counts as 255. Only the numbers
  at the end of a message are waited for, 1 s for each byte; what is missing then is whatever the
  memory holds (here: what the last message left there).
* A command that it does not know is one byte passed over, so after a lost byte there is no way to
  find the next message.
* An exchange with another address than that of the set-up gets that address alone as a reply, and
  its torques are taken for commands.
* Torques stay until the next exchange: reset, set-up and the host's exit do not end them. Each is
  cut to 0.123 N m and to whole steps of 1/4095 of it, towards zero. NaN passes this cut.
* A set-up makes the offset, cut to whole counts, the angle of the present pose.
* Directions are kept in the order in which they come, not by port.

What a number that is no number does to the motor is not defined by the language of the firmware;
this board then gives full torque. Left out: the address 0, which on the real board means every port
that is not in use; the values of analogue pins (0 here); effects of pulse pins.
"""

import math
import struct
from collections.abc import Generator, Sequence

from forcebound.messages.packets import Vector

RESET, SETUP, EXCHANGE = 0, 1, 2  # commands
PORTS = 4
LARGEST_TORQUE = 0.123  # N m, the firmware's clamp
DUTIES = 4095  # steps of a motor's pulse width
ANALOGUE_PINS = range(54, 66)
PULSE_PINS = range(14)
BYTE_NS = 1_000_000_000  # the time that a byte of a number is waited for
NOTHING = 0xFF  # what reading a byte gives where none has come
CLOCKWISE = 0

#: What the firmware waits for: a number of bytes, and whether each of them only for 1 s.
Wait = tuple[int, bool]
Firmware = Generator[Wait, bytes, None]


class HaplyBoard:
    """The board; see :class:`forcebound.emulators.board.Board`.

    Args:
        resolutions: Of the encoders at its ports, from port 1 up, in rad.
        senses: The direction, 0 or 1, with which each port counts and turns towards larger angles.
    """

    def __init__(self, resolutions: Sequence[float], senses: Sequence[int] = (1, 1)) -> None:
        self.angles: Vector = (0.0,) * len(resolutions)
        self.torque: Vector = (0.0,) * len(resolutions)
        self.wake_ns: int | None = None
        self._resolutions, self._senses = tuple(resolutions), tuple(senses)
        self._inbox = bytearray()
        self._reply = bytearray()
        self._memory = bytearray(16 * PORTS)  # under the numbers of a message
        self._address: int | None = None
        self._motors: list[int] = []  # ports from 0 up
        self._encoders: dict[int, tuple[int, float]] = {}  # counts at angle 0, counts per turn
        self._directions = [CLOCKWISE] * PORTS  # of motors, in the order of their bytes
        self._encoder_directions = [CLOCKWISE] * PORTS
        self._analogue_pins: set[int] = set()
        self._pulse_pins: set[int] = set()
        self._firmware = self._run()
        self._wait = next(self._firmware)

    def receive(self, data: bytes, time_ns: int) -> bytes:
        """Take bytes; see :class:`forcebound.emulators.board.Board`."""
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
        """Return a reply without numbers; see :class:`forcebound.emulators.board.Board`."""
        return reply[:1] + struct.pack("<f", math.nan) * ((len(reply) - 1) // 4)

    def _go_on(self) -> None:
        """Give the firmware what it waits for, or what has come of it."""
        count = self._wait[0]
        taken = bytes(self._inbox[:count])
        del self._inbox[:count]
        self._wait = self._firmware.send(taken)

    def _run(self) -> Firmware:
        commands = {RESET: self._reset, SETUP: self._set_up, EXCHANGE: self._exchange}
        while True:
            (command,) = yield 1, False
            if command in commands:
                yield from commands[command]()

    def _byte(self) -> int:
        """Take a byte without waiting."""
        return self._inbox.pop(0) if self._inbox else NOTHING

    def _numbers(self, count: int) -> Generator[Wait, bytes, list[float]]:
        """Take numbers; each byte is waited for."""
        came = yield 4 * count, True
        self._memory[: len(came)] = came
        return [number for (number,) in struct.iter_unpack("<f", self._memory[: 4 * count])]

    def _reset(self) -> Firmware:
        self._byte()
        self.reset()
        yield 0, False

    def reset(self) -> None:
        """Forget the set-up, not the torque; see :class:`forcebound.emulators.board.Board`."""
        self._address = None
        self._motors, self._encoders = [], {}
        self._analogue_pins, self._pulse_pins = set(), set()

    def _set_up(self) -> Firmware:
        self.reset()
        address = self._byte()
        self._motors = self._ports(self._directions)
        encoders = self._ports(self._encoder_directions)
        self._analogue_pins = self._pins(ANALOGUE_PINS)
        self._pulse_pins = self._pins(PULSE_PINS)
        if encoders:
            numbers = yield from self._numbers(2 * len(encoders))
            for port, offset, turn in zip(encoders, numbers[::2], numbers[1::2], strict=True):
                start = whole(offset * turn / 360.0)
                self._encoders[port] = start - self._counts(port), turn
        self._address = address

    def _ports(self, directions: list[int]) -> list[int]:
        """Take a mask and the directions of the ports in it; return these ports."""
        mask = self._byte()
        ports = [port for port in range(PORTS) if mask >> port & 1]
        for place in range(len(ports)):
            directions[place] = self._byte()
        return ports

    def _pins(self, known: range) -> set[int]:
        return {self._byte() for _ in range(self._byte())} & set(known)

    def _exchange(self) -> Firmware:
        address = self._byte()
        is_known = address == self._address
        for _ in self._pulse_pins if is_known else ():
            self._byte()
        if is_known and self._motors:
            torques = yield from self._numbers(len(self._motors))
            held = list(self.torque)
            for port, torque in zip(self._motors, torques, strict=True):
                if port < len(held):
                    held[port] = self._sign(port, self._directions) * held_torque(torque)
            self.torque = tuple(held)
        self._reply.append(address)
        if is_known:
            angles = [self._degrees(port) for port in self._encoders]
            values = [0.0] * len(self._analogue_pins) + angles
            self._reply += struct.pack(f"<{len(values)}f", *values)

    def _counts(self, port: int) -> int:
        """What an encoder counts from angle 0; the direction is the one set now."""
        if port >= len(self._resolutions):
            return 0
        counts = math.floor(self.angles[port] / self._resolutions[port] + 0.5)
        return counts * self._sign(port, self._encoder_directions)

    def _degrees(self, port: int) -> float:
        zero, turn = self._encoders[port]
        counts = zero + self._counts(port)
        return 360.0 * counts / turn if turn else math.nan

    def _sign(self, port: int, directions: Sequence[int]) -> int:
        return 1 if directions[port] == self._senses[port] else -1


def held_torque(torque: float) -> float:
    """Return what a motor gives for a torque that it is told, in N m."""
    if math.isnan(torque):
        return LARGEST_TORQUE
    duty = int(DUTIES * min(abs(torque), LARGEST_TORQUE) / LARGEST_TORQUE)
    return math.copysign(duty / DUTIES * LARGEST_TORQUE, torque)


def whole(counts: float) -> int:
    """Return counts without their fraction, 0 for what is no number."""
    return int(counts) if math.isfinite(counts) else 0
