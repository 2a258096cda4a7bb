"""The messages of the hAPI board, byte by byte, and what becomes of its replies."""

import math
import struct

import pytest

from forcebound.errors import DeviceError
from forcebound.hardware.hapi import WIRINGS, exchange_message, held_torque, parse_reply
from forcebound.hardware.haply_2diy import Haply2DIY, OpenHaply
from forcebound.hardware.serial_device import FIRST_EXCHANGES
from forcebound.testing import scripted

MODEL = Haply2DIY(port="auto")
SETUP = bytes.fromhex(
    "01 05 03 01 01 03 01 01 00 00 00 00 40 41 00 80 98 45 00 00 28 43 00 80 98 45"
)
ZERO = bytes.fromhex("02 05 00 00 00 00 00 00 00 00")
PUSH = bytes.fromhex("02 05 cd cc 4c 3d 0a d7 a3 bc")  # +0.05 and -0.02 N m
HOME = bytes.fromhex("05 8f 36 3f 41 b4 f9 27 43")
FREE = struct.pack("<Bff", 5, 700 * 360 / 4880, 1800 * 360 / 4880)  # all of a torque is applied
START = ((SETUP, None), *[(ZERO, HOME)] * (1 + FIRST_EXCHANGES))


def test_set_up_and_exchanges_are_those_of_the_specification() -> None:
    with scripted(*START, (ZERO, FREE), (PUSH, FREE), (PUSH, HOME)) as line:
        device = OpenHaply(MODEL, line)
        device.read(0)
        step = 0.123 / 4095  # of a motor, which gives whole ones towards zero
        assert device.write(0, (-0.05, 0.02)) == pytest.approx((-1664 * step, 665 * step))
        assert [math.degrees(angle) for angle in device.read(0)] == pytest.approx([12.0, 168.0])


def test_the_set_up_of_version_2_has_its_directions_and_its_finer_encoders() -> None:
    setup = bytes((1, 5, 3, 0, 1, 3, 0, 1, 0, 0)) + struct.pack("<4f", -61, 10752, 241, 10752)
    home = struct.pack("<Bff", 5, -1821 * 360 / 10752, 7197 * 360 / 10752)
    with scripted((setup, None), *[(ZERO, home)] * (1 + FIRST_EXCHANGES)) as line:
        OpenHaply(Haply2DIY(port="auto", version=2), line)


def read_twice(device: OpenHaply) -> None:
    """The first may pass: what is unexpected is seen before the next message."""
    device.read(0)
    device.read(0)


@pytest.mark.parametrize(
    ("reply", "words"),
    [
        (FREE[:5], "9 bytes, got 5"),
        (b"\xff" + FREE[1:], "address 5, got ff"),
        (b"\x05" + b"\xff" * 8, "got nan"),
        (None, "no reply within 10 ms"),
        (FREE[:1], "the board was reset"),
        (FREE + b"\x07", "unexpected bytes: 07"),
    ],
)
def test_a_wrong_reply_is_the_last(reply: bytes | None, words: str) -> None:
    with scripted(*START, (ZERO, FREE), (PUSH, FREE), (PUSH, reply)) as line:
        device = OpenHaply(MODEL, line)
        device.read(0)
        device.write(0, (-0.05, 0.02))
        for _ in range(2):
            with pytest.raises(DeviceError, match=words):
                read_twice(device)
        assert device.write(0, (0.0, 0.0)) == (0.0, 0.0)  # it is there already


def test_a_count_is_a_count_at_any_angle() -> None:
    for counts in (-4880, -1, 0, 1, 162, 4880, 48_801):
        degrees = 360.0 * counts / 4880
        cut = WIRINGS[3].home_counts[0] - 162
        angle = parse_reply(struct.pack("<Bff", 5, degrees, degrees), 5, WIRINGS[3])[0]
        assert angle * 4880 / math.tau == pytest.approx(counts + cut, abs=1e-6)


def test_no_motor_is_asked_for_more_than_it_has() -> None:
    assert held_torque(0.0) == 0.0
    assert held_torque(1.0) == pytest.approx(0.123)
    assert exchange_message(5, (0.05, -0.02)) == PUSH
