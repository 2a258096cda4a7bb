"""The messages of Haply's hAPI board (firmware M3 V1.5), as bytes.

There is no frame, checksum or acknowledgement; numbers are float32, least byte first.

=========  ==============================================================================
message    bytes; reply
=========  ==============================================================================
set-up     ``01 address``, mask and directions of the motors, the same of the encoders, no
           analogue and no pulse pins, offset (degrees) and counts per turn of each encoder; none
exchange   ``02 address`` and the torque of each motor, in N m; ``address`` and the angle of each
           encoder, in degrees
=========  ==============================================================================

Bit i of a mask is port i + 1; the entries are in the order of the ports. Offsets are cut to whole
counts, and torques to whole steps of the pulse width, towards zero. An angle is a whole number of
counts: beside address and length the only check of a reply; noise in both angles passes it in one
of a hundred cases, and then most likely fails the device's ``largest_speed``. NaN passes the
firmware's clamp, so it is refused here. After a lost byte the board waits for numbers, and a reset
keeps the torque; :func:`rest_message` ends the torque in any of these states.
"""

import math
import struct
from dataclasses import dataclass
from functools import cached_property

from forcebound.errors import DeviceError
from forcebound.messages.packets import Vector

SETUP, EXCHANGE = 1, 2
CLOCKWISE, COUNTERCLOCKWISE = 0, 1
BOTH = 0b11  # mask of ports 1 and 2
LARGEST_TORQUE = 0.123  # N m, of a motor; the firmware's clamp
STEPS = 4095  # of the pulse width, at the largest torque
REPLY_SIZE = 9  # bytes
FILLER = 32 * b"\x03"  # no command; as many bytes as a board may wait for; as a float near zero
TOLERANCE = 0.05  # counts; float32 is finer at any angle of a few turns

_TORQUES = struct.Struct("<BBff")
_ANGLES = struct.Struct("<Bff")


@dataclass(frozen=True)
class Wiring:
    """Connection of motors and encoders of a version of the device, ports 1 and 2.

    Attributes:
        base: Distance of the motors, in m.
        directions: Of motors and encoders alike.
        home: Angles of the home pose, in degrees.
        counts: Of an encoder, per turn.
    """

    base: float
    directions: tuple[int, int]
    home: tuple[float, float]
    counts: int

    @cached_property  # each reply needs it
    def home_counts(self) -> Vector:
        """The home pose in counts, with their fractions."""
        return tuple([angle * self.counts / 360.0 for angle in self.home])


#: By the version of the hardware; the maker's examples set the devices up with these numbers.
WIRINGS = {
    2: Wiring(0.0, (CLOCKWISE, COUNTERCLOCKWISE), (-61.0, 241.0), 10752),
    3: Wiring(0.038, (COUNTERCLOCKWISE, COUNTERCLOCKWISE), (12.0, 168.0), 4880),
}


def setup_message(address: int, wiring: Wiring) -> bytes:
    """Return the message that makes the present pose of the arm its home pose."""
    ports = bytes((BOTH, *wiring.directions))
    no_pins = bytes(2)
    numbers = [number for angle in wiring.home for number in (angle, wiring.counts)]
    return bytes((SETUP, address)) + ports + ports + no_pins + struct.pack("<4f", *numbers)


def exchange_message(address: int, torque: Vector) -> bytes:
    """Return the message that sets both torques, in N m, and asks for the angles."""
    return _TORQUES.pack(EXCHANGE, address, *torque)


def rest_message(address: int, wiring: Wiring) -> bytes:
    """Return the message that ends every torque, whatever the board has received before.

    Its first bytes complete what the board may wait for, its set-up brings back what a reset has
    forgotten, its exchange is the zero. The present pose is the home pose then.
    """
    set_up = setup_message(address, wiring)
    return FILLER + set_up + exchange_message(address, (0.0, 0.0))


def held_torque(torque: float) -> float:
    """Return what a motor gives for a torque, in N m: a whole number of steps, towards zero."""
    step = LARGEST_TORQUE / STEPS
    return math.copysign(math.floor(min(abs(torque), LARGEST_TORQUE) / step) * step, torque)


def parse_reply(reply: bytes, address: int, wiring: Wiring) -> Vector:
    """Return the angles of a reply, in rad; DeviceError if it is not the whole reply."""
    if reply == bytes((address,)):
        raise DeviceError("the board was reset: it has forgotten its set-up, not its torque")
    if len(reply) != REPLY_SIZE:
        raise DeviceError(f"expected a reply of {REPLY_SIZE} bytes, got {len(reply)}")
    echo, *degrees = _ANGLES.unpack(reply)
    if echo != address:
        raise DeviceError(
            f"expected the reply of a Haply board at address {address}, got {reply.hex(' ')}: there"
            " is another device at this port, or another firmware"
        )
    angles = []
    for angle, home in zip(degrees, wiring.home_counts, strict=True):
        counts = angle * wiring.counts / 360.0
        if not abs(counts) < 1e6 or abs(counts - round(counts)) > TOLERANCE:
            raise DeviceError(
                f"expected angles in whole counts of 360/{wiring.counts} degrees, got {angle:g}"
                " degrees: the reply is disturbed, or the firmware another one"
            )
        angles.append((round(counts) - int(home) + home) * math.tau / wiring.counts)
    return tuple(angles)
