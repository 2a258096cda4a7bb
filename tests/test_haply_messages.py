"""The messages of the hAPI board, byte by byte, and what becomes of its replies."""

import math
import struct

import pytest

from forcebound.hardware.hapi import (
    LARGEST_TORQUE,
    STEPS,
    WIRINGS,
    exchange_message,
    held_torque,
    parse_reply,
    setup_message,
)

VERSION_3 = WIRINGS[3]
REPLY = bytes.fromhex("05 8f363f41 b4f92743")


def test_the_set_up_of_version_3_is_that_of_the_specification() -> None:
    expected = "01 05 03 01 01 03 01 01 00 00 00 00 40 41 00 80 98 45 00 00 28 43 00 80 98 45"
    assert setup_message(5, VERSION_3).hex(" ") == expected


def test_the_set_up_of_version_2_has_its_directions_and_its_finer_encoders() -> None:
    message = setup_message(5, WIRINGS[2])
    assert message[:10] == bytes((1, 5, 3, 0, 1, 3, 0, 1, 0, 0))
    assert struct.unpack("<4f", message[10:]) == (-61.0, 10752.0, 241.0, 10752.0)


def test_an_exchange_is_that_of_the_specification() -> None:
    assert exchange_message(5, (0.05, -0.02)).hex(" ") == "02 05 cd cc 4c 3d 0a d7 a3 bc"


def test_what_the_firmware_cuts_from_the_home_pose_is_put_back() -> None:
    angles = parse_reply(REPLY, 5, VERSION_3)
    assert [math.degrees(angle) for angle in angles] == pytest.approx([12.0, 168.0], abs=1e-9)


def test_a_count_is_a_count_at_any_angle() -> None:
    for counts in (-4880, -1, 0, 1, 162, 4880, 48_801):
        degrees = 360.0 * counts / 4880
        reply = struct.pack("<Bff", 5, degrees, degrees)
        cut = VERSION_3.home_counts[0] - 162
        angle = parse_reply(reply, 5, VERSION_3)[0]
        assert angle * 4880 / math.tau == pytest.approx(counts + cut, abs=1e-6)


def test_a_motor_gives_whole_steps_towards_zero_as_the_firmware_does() -> None:
    step = LARGEST_TORQUE / STEPS
    assert held_torque(0.05) == pytest.approx(1664 * step, rel=1e-12)
    assert held_torque(-0.02) == pytest.approx(-665 * step, rel=1e-12)
    assert held_torque(0.0) == 0.0
    assert held_torque(1.0) == pytest.approx(LARGEST_TORQUE)
