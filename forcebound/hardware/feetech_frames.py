"""Packets of the Feetech STS protocol (protocol 0), for the driver and its emulator.

A packet is ``ff ff``, the servo's id, the length of what follows, an instruction, its parameters
and a checksum. A status has an error byte in the place of the instruction. Numbers are
little-endian, and those with a sign have it in a bit of their own: they are no two's complement.

Source: the tables of lerobot, ``motors/feetech``, and the maker's SDK.
"""

from collections.abc import Mapping
from typing import NamedTuple

from forcebound.errors import DeviceError
from forcebound.hardware.dynamixel_frames import Status

HEADER = b"\xff\xff"
FIRST = 4  # bytes, up to the length
BROADCAST = 0xFE

PING, READ, WRITE, SYNC_READ, SYNC_WRITE = 0x01, 0x02, 0x03, 0x82, 0x83
# Register -> its sign bit.
SIGN_BITS = {31: 11, 42: 15, 44: 10, 46: 15, 56: 15, 58: 15, 60: 10, 69: 15}


class Packet(NamedTuple):
    """A packet; a status has its error byte in the place of the instruction."""

    servo: int
    instruction: int
    parameters: bytes


def checksum(data: bytes) -> int:
    """Return the checksum of what lies between the header and it."""
    return ~sum(data) & 0xFF


def packet(servo: int, instruction: int, parameters: bytes = b"") -> bytes:
    """Return a packet; a status with an error byte for ``instruction``."""
    data = bytes((servo, len(parameters) + 2, instruction)) + parameters
    return HEADER + data + bytes((checksum(data),))


def size(data: bytes) -> int:
    """Return how many bytes the packet has that data begin with; 0 if more must come to know it.

    DeviceError if data do not begin with a packet.
    """
    if not HEADER.startswith(data[: len(HEADER)]):
        raise DeviceError(f"expected a packet, ff ff, on the bus, got {data[:20].hex(' ')}")
    return FIRST + data[3] if len(data) >= FIRST else 0


def parse(data: bytes) -> Packet:
    """Return the packet that ``data`` are; DeviceError if it is spoiled."""
    if len(data) < FIRST + 2 or size(data) != len(data):
        raise DeviceError(f"expected a whole packet, got {data[:20].hex(' ')}")
    if checksum(data[2:-1]) != data[-1]:
        raise DeviceError(f"a packet of servo {data[2]} is spoiled: its checksum is wrong")
    return Packet(data[2], data[FIRST], data[FIRST + 1 : -1])


def status(data: bytes) -> Status:
    """Return the status that ``data`` are; DeviceError if it is spoiled."""
    return Status(*parse(data))


def read(servo: int, address: int, count: int) -> bytes:
    """Return the request for ``count`` bytes of a servo's registers."""
    return packet(servo, READ, bytes((address, count)))


def write(servo: int, address: int, value: bytes) -> bytes:
    """Return the order that writes registers of a servo, which has a status."""
    return packet(servo, WRITE, bytes((address,)) + value)


def sync_read(servos: bytes, address: int, count: int) -> bytes:
    """Return the request for the registers of all servos; each has a status, in their order."""
    return packet(BROADCAST, SYNC_READ, bytes((address, count)) + servos)


def sync_write(values: Mapping[int, bytes], address: int) -> bytes:
    """Return the order that writes registers of servos; values by id, all as long. No status."""
    count = len(next(iter(values.values())))
    each = b"".join(bytes((servo,)) + value for servo, value in values.items())
    return packet(BROADCAST, SYNC_WRITE, bytes((address, count)) + each)


def encoded(register: int, value: int) -> bytes:
    """Return a value of a register of two bytes, with its sign."""
    bit = SIGN_BITS[register]
    if abs(value) >= 1 << bit:
        raise ValueError(f"expected less than {1 << bit} for register {register}, got {value}")
    return (abs(value) | (value < 0) << bit).to_bytes(2, "little")


def decoded(register: int, data: bytes) -> int:
    """Return the value of a register of two bytes, with its sign."""
    number, sign = int.from_bytes(data, "little"), 1 << SIGN_BITS[register]
    return -(number & (sign - 1)) if number & sign else number & (sign - 1)
