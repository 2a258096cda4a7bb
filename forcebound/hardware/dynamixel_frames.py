"""Packets of the Dynamixel protocol 2.0, for the driver and its emulator.

A packet is ``ff ff fd 00``, the servo's id, the length of what follows (two bytes), an instruction,
its parameters and a CRC over all before it. ``ff ff fd`` within is followed by another ``fd``. A
status has the instruction 0x55, and an error byte before its parameters. Numbers are little-endian.

Source: the maker's e-manual, "DYNAMIXEL Protocol 2.0".
"""

from collections.abc import Mapping
from typing import NamedTuple

from forcebound.errors import DeviceError

HEADER = b"\xff\xff\xfd\x00"
STUFFED, UNSTUFFED = b"\xff\xff\xfd\xfd", b"\xff\xff\xfd"
FIRST = 7  # bytes, up to the length
BROADCAST = 0xFE

PING, READ, WRITE, REBOOT = 0x01, 0x02, 0x03, 0x08
STATUS, SYNC_READ, SYNC_WRITE = 0x55, 0x82, 0x83
ALERT = 0x80  # bit of the error byte: register 70 says what is wrong with the servo
ERRORS = {
    1: "it could not process the packet",
    2: "it does not know the instruction",
    3: "the CRC was wrong",
    4: "a value was out of range",
    5: "a value had the wrong length",
    6: "a value was beyond a limit",
    7: "the register cannot be written now",
}


def _entry(byte: int) -> int:
    value = byte << 8
    for _ in range(8):
        value = (value << 1) ^ (0x8005 if value & 0x8000 else 0)
    return value & 0xFFFF


_TABLE = tuple(map(_entry, range(256)))


class Packet(NamedTuple):
    """A packet; of a status, ``parameters`` begin with the error byte."""

    servo: int
    instruction: int
    parameters: bytes


class Status(NamedTuple):
    """What a servo answers: an error byte, 0 for none, and values of registers."""

    servo: int
    error: int
    values: bytes


def crc(data: bytes) -> int:
    """Return the CRC-16 of data: polynomial 0x8005, from 0, not reflected."""
    value = 0
    for byte in data:
        value = (value << 8 & 0xFFFF) ^ _TABLE[value >> 8 ^ byte]
    return value


def packet(servo: int, instruction: int, parameters: bytes = b"") -> bytes:
    """Return a packet; of a status, ``parameters`` begin with the error byte."""
    # The instruction takes part: no instruction is one of the three bytes.
    stuffed = parameters.replace(UNSTUFFED, STUFFED)
    length = (len(stuffed) + 3).to_bytes(2, "little")
    data = HEADER + bytes((servo,)) + length + bytes((instruction,)) + stuffed
    return data + crc(data).to_bytes(2, "little")


def size(data: bytes) -> int:
    """Return how many bytes the packet has that data begin with; 0 if more must come to know it.

    DeviceError if data do not begin with a packet.
    """
    if not HEADER.startswith(data[: len(HEADER)]):
        raise DeviceError(f"expected a packet, ff ff fd 00, on the bus, got {data[:20].hex(' ')}")
    return FIRST + int.from_bytes(data[5:FIRST], "little") if len(data) >= FIRST else 0


def parse(data: bytes) -> Packet:
    """Return the packet that ``data`` are; DeviceError if it is spoiled."""
    if len(data) < FIRST + 3 or size(data) != len(data):
        raise DeviceError(f"expected a whole packet, got {data[:20].hex(' ')}")
    if crc(data[:-2]) != int.from_bytes(data[-2:], "little"):
        raise DeviceError(f"a packet of servo {data[4]} is spoiled: its CRC is wrong")
    return Packet(data[4], data[FIRST], data[FIRST + 1 : -2].replace(STUFFED, UNSTUFFED))


def status(data: bytes) -> Status:
    """Return the status that ``data`` are; DeviceError if they are none."""
    servo, instruction, parameters = parse(data)
    if instruction != STATUS or not parameters:
        raise DeviceError(f"expected a status on the bus, got {data[:20].hex(' ')}")
    return Status(servo, parameters[0], parameters[1:])


def read(servo: int, address: int, count: int) -> bytes:
    """Return the request for ``count`` bytes of a servo's registers."""
    return packet(servo, READ, _words(address, count))


def write(servo: int, address: int, value: bytes) -> bytes:
    """Return the order that writes registers of a servo, which has a status."""
    return packet(servo, WRITE, _words(address) + value)


def sync_read(servos: bytes, address: int, count: int) -> bytes:
    """Return the request for the registers of all servos; each has a status, in their order."""
    return packet(BROADCAST, SYNC_READ, _words(address, count) + servos)


def sync_write(values: Mapping[int, bytes], address: int) -> bytes:
    """Return the order that writes registers of servos; values by id, all as long. No status."""
    count = len(next(iter(values.values())))
    each = b"".join(bytes((servo,)) + value for servo, value in values.items())
    return packet(BROADCAST, SYNC_WRITE, _words(address, count) + each)


def _words(*numbers: int) -> bytes:
    return b"".join(number.to_bytes(2, "little") for number in numbers)
