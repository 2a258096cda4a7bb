"""Packets of servo buses: golden bytes, stuffing, signs, and what is no packet."""

from collections.abc import Callable
from types import ModuleType

import pytest
from hypothesis import given
from hypothesis import strategies as st

from forcebound.errors import DeviceError
from forcebound.hardware import dynamixel_frames as dxl
from forcebound.hardware import feetech_frames as sts

MODULES = (dxl, sts)


def goal(value: int) -> bytes:
    return value.to_bytes(2, "little", signed=True)


# Of the makers' manuals, or of other programs for the bus.
GOLDEN = {
    "read a position": (dxl.read(1, 132, 4), "ff ff fd 00 01 07 00 02 84 00 04 00 1d 15"),
    "its status": (
        dxl.packet(1, dxl.STATUS, bytes((0, 166, 0, 0, 0))),
        "ff ff fd 00 01 08 00 55 00 a6 00 00 00 8c c0",
    ),
    "read positions": (
        dxl.sync_read(bytes((1, 2)), 132, 4),
        "ff ff fd 00 fe 09 00 82 84 00 04 00 01 02 ce fa",
    ),
    "write positions": (
        dxl.sync_write({1: (150).to_bytes(4, "little"), 2: (170).to_bytes(4, "little")}, 116),
        "ff ff fd 00 fe 11 00 83 74 00 04 00 01 96 00 00 00 02 aa 00 00 00 82 87",
    ),
    "current mode": (dxl.write(1, 11, b"\0"), "ff ff fd 00 01 06 00 03 0b 00 00 42 e3"),
    "torque on": (dxl.write(1, 64, b"\1"), "ff ff fd 00 01 06 00 03 40 00 01 db 66"),
    "watchdog": (dxl.write(1, 98, b"\1"), "ff ff fd 00 01 06 00 03 62 00 01 73 64"),
    "write currents": (
        dxl.sync_write({1: goal(100), 2: goal(-50)}, 102),
        "ff ff fd 00 fe 0d 00 83 66 00 02 00 01 64 00 02 ce ff e7 37",
    ),
    "read velocities and positions": (
        dxl.sync_read(bytes((1, 2)), 128, 8),
        "ff ff fd 00 fe 09 00 82 80 00 08 00 01 02 c8 ea",
    ),
    "ping": (sts.packet(1, sts.PING), "ff ff 01 02 01 fb"),
    "read a position, STS": (sts.read(1, 56, 2), "ff ff 01 04 02 38 02 be"),
    "read positions, STS": (
        sts.sync_read(bytes(range(1, 7)), 56, 4),
        "ff ff fe 0a 82 38 04 01 02 03 04 05 06 24",
    ),
    "write duties": (
        sts.sync_write({1: sts.encoded(44, 100), 2: sts.encoded(44, -50)}, 44),
        "ff ff fe 0a 83 2c 02 01 64 00 02 32 04 a9",
    ),
}


@pytest.mark.parametrize("name", GOLDEN)
def test_a_packet_has_the_golden_bytes(name: str) -> None:
    packet, expected = GOLDEN[name]
    assert packet.hex(" ") == expected


@pytest.mark.parametrize("frames", MODULES)
@given(
    servo=st.integers(0, 253), instruction=st.integers(0, 254), parameters=st.binary(max_size=90)
)
def test_a_packet_survives_packing_and_parsing(
    frames: ModuleType, servo: int, instruction: int, parameters: bytes
) -> None:
    data = frames.packet(servo, instruction, parameters)
    assert frames.size(data + b"more") == len(data)
    assert frames.parse(data) == (servo, instruction, parameters)


@given(data=st.lists(st.sampled_from([b"\xff", b"\xfd", b"\x00"]), max_size=20).map(b"".join))
def test_a_header_within_parameters_is_stuffed(data: bytes) -> None:
    packet = dxl.packet(1, dxl.STATUS, data)
    assert b"\xff\xff\xfd\0" not in packet[8:-2]
    assert dxl.parse(packet).parameters == data


@pytest.mark.parametrize("frames", MODULES)
@pytest.mark.parametrize(
    "spoil",
    [
        lambda data: data[:-1],
        lambda data: data + b"\0",
        lambda data: data[:-3] + bytes((data[-3] ^ 1,)) + data[-2:],
        lambda data: data[1:],
        lambda data: b"",
    ],
)
def test_a_spoiled_packet_is_refused(frames: ModuleType, spoil: Callable[[bytes], bytes]) -> None:
    with pytest.raises(DeviceError):
        frames.parse(spoil(frames.packet(3, 1, b"12")))


def test_the_sign_of_a_feetech_number_is_a_bit_of_its_own() -> None:
    assert sts.encoded(44, -50) == b"\x32\x04"
    assert sts.decoded(58, b"\x05\x80") == -5
    assert sts.decoded(31, b"\x05\x08") == -5
    with pytest.raises(ValueError, match="1024"):
        sts.encoded(44, -1024)


@given(register=st.sampled_from(sorted(sts.SIGN_BITS)), value=st.integers(-1023, 1023))
def test_a_number_with_a_sign_survives(register: int, value: int) -> None:
    assert sts.decoded(register, sts.encoded(register, value)) == value
