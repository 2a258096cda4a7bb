"""A driver of my own: a motor and its encoder on a microcontroller, at a serial port.

Copy this file, change it, and check it; the check opens the device and gives it no force:

    forcebound check device my_driver.py port:=/dev/ttyACM0
    forcebound launch my_driver.yaml port:=/dev/ttyACM0

The program on the microcontroller waits for 7 bytes, sets the torque, answers with 7 bytes:

    to the board     "T"  torque, N m (float32, least byte first)  checksum of these 5 bytes
    from the board   "A"  angle, rad (the same)                    checksum of these 5 bytes

The checksum is CRC-16/IBM-3740, least byte first. The board passes a message over whose checksum is
wrong. docs/device-safety.md says what a driver must not do; docs/write-your-own-device.md explains
the members.
"""

import math
import struct
import time
from binascii import crc_hqx
from dataclasses import dataclass
from typing import Annotated, Literal

from forcebound.errors import DeviceError
from forcebound.haptics.devices import AxesModel, Device
from forcebound.haptics.hands import Operator
from forcebound.hardware.line import Line
from forcebound.messages.packets import Vector
from forcebound.quantities import POSITIVE, Damping, Force, Length, Speed, Time

SIZE = 7  # bytes of a message


@dataclass(frozen=True)
class Motor(AxesModel):
    """What is known of the device, in SI units; the certificate rests on it.

    The hand holds the end of a lever, so ways and forces here are those at the hand.
    """

    axes: int = 1
    damping: Annotated[Damping, POSITIVE] = 0.5  # minimum, N s/m
    friction: Force = 0.1  # minimum, N
    resolution: Length = 3e-5  # m, one count of the encoder
    saturation: Annotated[Force, POSITIVE] = 2.0  # N
    # A reading that implies more is refused. A hand's fastest reach of 0.4 m, in 0.15 s, peaks at
    # 1.875 * 0.4 m / 0.15 s = 5 m/s.
    largest_speed: Annotated[Speed, POSITIVE] = 5.0
    write_delay: Annotated[Time, POSITIVE] = 4e-4  # from a reading to its force; each is measured
    # Required: what ends a force that nobody renews. This board has no watchdog; the guardian ends
    # a force after 20 ms.
    watchdog: Literal["none"] = "none"
    watchdog_limit: Annotated[Time, POSITIVE] = 0.02
    lever: Annotated[Length, POSITIVE] = 0.05
    port: str = "auto"  # a path, the serial number of the USB device, or auto: the only port

    def open(self, operator: Operator | None, hold_limit: float) -> "OpenMotor":
        """Return the device; a hand is for simulated ones."""
        # The line finds and locks the port. Its guardian, a process, writes the message of zero
        # force when this process dies, hangs or is stopped.
        line = Line("my_driver", self.port, message(0.0), self.watchdog_limit)
        try:
            return OpenMotor(self, line)
        except BaseException:
            line.close()
            raise


class OpenMotor(Device):
    """The device, from open to close."""

    axes = 1

    def __init__(self, model: Motor, line: Line) -> None:
        self._model, self._line = model, line
        self._torque = 0.0  # on the wire: positive turns towards larger angles
        self._read_ns = self._effect_ns = self._jitter_ns = 0
        self._exchange(0.5)  # the first may take a while; is this the board at all?

    def read(self, time_ns: int) -> Vector:
        """Send the torque that is held already; return where the hand is, in m."""
        sent_ns, came_ns, angle = self._exchange(self._line.silence)
        # The board has read the angle at some time between: stamped early, and how much later it
        # may have been.
        self._read_ns, self._jitter_ns = sent_ns, came_ns - sent_ns
        return (self._model.lever * angle,)

    def write(self, time_ns: int, force: Vector) -> Vector:
        """Hold a force, in N; return what is really held."""
        # A board takes what is no number, and may give all that it has for it.
        wanted = force[0] if math.isfinite(force[0]) else 0.0
        limit = self._model.saturation
        held = min(max(wanted, -limit), limit)
        self._torque = -held * self._model.lever  # a positive force resists positive motion
        self._effect_ns = self._exchange(self._line.silence)[1]  # stamped late
        return (held,)

    def stamps(self) -> tuple[int, int]:
        """Return when the reading was made and when the force acts, in ns."""
        return self._read_ns, self._effect_ns

    def latch_jitter(self) -> int:
        """Return by how much the reading may be later than its stamp, in ns."""
        return self._jitter_ns

    def close(self) -> None:
        """Release the device; the line writes zero force first."""
        self._line.close()

    def _exchange(self, patience: float) -> tuple[int, int, float]:
        """Send the torque; return when, when the reply had come, and its angle, in rad."""
        try:
            sent_ns = time.monotonic_ns()
            self._line.send(message(self._torque), has_force=self._torque != 0.0)
            reply = self._line.port.read(SIZE, sent_ns + round(patience * 1e9))
            came_ns = time.monotonic_ns()
            return sent_ns, came_ns, angle_of(reply)
        except DeviceError as failure:
            # Zero force, and no message after it: nobody searches for the next reply in a stream
            # that has lost its order. The graph ends; the user starts it again.
            self._line.fail(failure)
            raise


def message(torque: float) -> bytes:
    """Return the message that sets a torque, in N m: written as a whole, in one piece."""
    text = struct.pack("<cf", b"T", torque)
    return text + struct.pack("<H", crc_hqx(text, 0xFFFF))


def angle_of(reply: bytes) -> float:
    """Return the angle in a reply, in rad; raise DeviceError if it is none."""
    if len(reply) != SIZE or crc_hqx(reply[:5], 0xFFFF) != int.from_bytes(reply[5:], "little"):
        raise DeviceError(
            f"expected {SIZE} bytes with their checksum from the board, got {reply.hex(' ')!r}: is"
            " this its port, and does it have power?"
        )
    kind, angle = struct.unpack("<cf", reply[:5])
    if kind != b"A" or not math.isfinite(angle):
        raise DeviceError(f"expected an angle from the board, got {reply.hex(' ')!r}")
    return float(angle)
