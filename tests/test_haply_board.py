"""The emulated Haply board against what is known of its firmware, byte by byte."""

import math
import struct
from random import Random

import pytest

from forcebound.hardware.emulators.haply_board import LARGEST_TORQUE, HaplyBoard, held_torque
from forcebound.hardware.hapi import WIRINGS, exchange_message, rest_message

COUNT = 2.0 * math.pi / 4880  # rad
SETUP = bytes.fromhex(
    "01 05 03 01 01 03 01 01 00 00 00 00 40 41 00 80 98 45 00 00 28 43 00 80 98 45"
)
PUSH = bytes.fromhex("02 05 cd cc 4c 3d 0a d7 a3 bc")  # +0.05 and -0.02 N m
NO_TORQUE = b"\2\5" + bytes(8)
HOME = bytes.fromhex("05 8f 36 3f 41 b4 f9 27 43")  # 12 and 168 degrees, cut to whole counts
PUSHED = (1664 / 4095 * LARGEST_TORQUE, -665 / 4095 * LARGEST_TORQUE)
SECOND = 1_000_000_000
REST = rest_message(5, WIRINGS[3])


def set_up(*angles: float) -> HaplyBoard:
    """Return a board that was set up with its motors at these angles."""
    board = HaplyBoard((COUNT, COUNT))
    board.angles = angles or (0.3, 2.9)
    assert board.receive(SETUP, 0) == b""
    return board


def degrees(reply: bytes) -> tuple[float, ...]:
    return struct.unpack(f"<{len(reply) // 4}f", reply[1:])


def test_the_golden_bytes() -> None:
    board = set_up()
    assert board.receive(PUSH, 1) == HOME
    assert board.torque == pytest.approx(PUSHED, abs=1e-12)


def test_angles_count_from_the_pose_of_the_set_up() -> None:
    board = set_up()
    board.angles = (0.3 + 10 * COUNT, 2.9 - 3 * COUNT)
    first, second = degrees(board.receive(PUSH, 1))
    assert first == pytest.approx((162 + 10) * 360 / 4880, abs=1e-5)
    assert second == pytest.approx((2277 - 3) * 360 / 4880, abs=1e-5)
    board.receive(SETUP, 2)
    assert board.receive(PUSH, 3) == HOME


def test_a_clockwise_port_turns_and_counts_the_other_way() -> None:
    board = HaplyBoard((COUNT, COUNT))
    board.receive(SETUP.replace(b"\x03\x01\x01", b"\x03\x00\x01"), 0)
    board.receive(PUSH, 1)
    assert board.torque == pytest.approx((-PUSHED[0], PUSHED[1]), abs=1e-12)
    board.angles = (5 * COUNT, 0.0)
    first, _ = degrees(board.receive(PUSH, 2))
    assert first == pytest.approx((162 - 5) * 360 / 4880, abs=1e-5)


def test_a_port_that_is_wired_the_other_way_takes_the_other_direction() -> None:
    board = HaplyBoard((COUNT, COUNT), senses=(0, 1))  # as in version 2 of the 2DIY
    board.receive(SETUP.replace(b"\x03\x01\x01", b"\x03\x00\x01"), 0)
    assert board.receive(PUSH, 1) == HOME
    assert board.torque == pytest.approx(PUSHED, abs=1e-12)


def test_torque_stays_after_reset_and_set_up() -> None:
    board = set_up()
    board.receive(PUSH, 1)
    board.receive(b"\0\0", 2)
    board.receive(SETUP, 3)
    board.receive(b"", 100 * SECOND)
    assert board.torque == pytest.approx(PUSHED, abs=1e-12)


def test_torque_is_cut_to_the_clamp_and_to_whole_steps() -> None:
    assert held_torque(1.0) == LARGEST_TORQUE
    assert held_torque(-math.inf) == -LARGEST_TORQUE
    assert held_torque(0.9 * LARGEST_TORQUE / 4095) == 0.0
    assert held_torque(math.nan) == LARGEST_TORQUE


def test_half_a_message_is_answered_after_a_second_without_a_byte() -> None:
    board = set_up()
    assert board.receive(PUSH[:5], 0) == b""
    assert board.receive(PUSH[5:7], SECOND // 2) == b""
    assert board.wake_ns == SECOND // 2 + SECOND
    assert board.receive(b"", board.wake_ns - 1) == b""
    assert board.receive(b"", board.wake_ns) == HOME
    assert board.wake_ns is None
    assert board.receive(PUSH, 2 * SECOND) == HOME


def test_what_is_missing_is_what_the_last_message_left() -> None:
    board = set_up()
    board.receive(PUSH, 0)
    board.receive(b"\2\5", 1)
    board.receive(b"", 1 + SECOND)
    assert board.torque == pytest.approx(PUSHED, abs=1e-12)


def test_a_message_split_after_its_command_loses_its_address() -> None:
    board = set_up()
    assert board.receive(PUSH[:1], 0) == b"\xff"
    assert board.torque == (0.0, 0.0)


def test_another_address_is_answered_alone_and_the_rest_taken_for_commands() -> None:
    board = set_up()
    assert board.receive(b"\2\6" + struct.pack("<2f", 0.05, 0.05), 0) == b"\6"
    # cd cc 4c 3d are no commands; this torque begins with a reset, after which nothing is known.
    assert board.receive(PUSH, 1) == HOME
    assert board.receive(b"\2\6\0\0", 2) == b"\6"
    assert board.receive(PUSH, 3) == b"\5"


def test_bytes_without_meaning_are_passed_over() -> None:
    board = HaplyBoard((COUNT, COUNT))
    assert board.receive(b"hello" + SETUP + PUSH, 0) == HOME


def test_a_reply_without_numbers_keeps_its_length() -> None:
    reply = HaplyBoard((COUNT, COUNT)).with_nan(HOME)
    assert len(reply) == len(HOME)
    assert all(map(math.isnan, degrees(reply)))


@pytest.mark.parametrize("reset", [b"\0\5", b"\0\0"])
def test_after_a_reset_only_a_set_up_lets_a_zero_reach_the_motors(reset: bytes) -> None:
    board = set_up()
    board.receive(PUSH, 1)
    board.receive(reset, 2)
    assert board.receive(NO_TORQUE, 3) == b"\5"
    assert board.torque == pytest.approx(PUSHED, abs=1e-12)
    assert board.receive(REST, 4) == HOME
    assert board.torque == (0.0, 0.0)


@pytest.mark.parametrize("place", range(len(PUSH)))
def test_a_torque_ends_wherever_a_byte_of_a_message_is_lost(place: int) -> None:
    random = Random(place)
    stayed = 0
    for _ in range(300):
        message = exchange_message(5, (random.uniform(-0.12, 0.12), random.uniform(-0.12, 0.12)))
        torques = []
        for last in (NO_TORQUE, REST):
            board = set_up()
            board.receive(message, 1)
            board.receive(message[:place] + message[place + 1 :], 2)
            board.receive(last, 3)
            torques.append(board.torque)
        stayed += any(torques[0])
        assert torques[1] == (0.0, 0.0), message.hex(" ")
    assert stayed > 0  # after an exchange of zero torque alone


def test_a_torque_ends_whatever_bytes_the_board_has_heard() -> None:
    random = Random(1)
    for _ in range(500):
        board = set_up()
        board.receive(PUSH, 1)
        heard = bytes(random.choice((0, 1, 2, 3, 5, 0xFF)) for _ in range(random.randrange(40)))
        board.receive(heard, 2)
        board.receive(REST, 3)
        assert board.torque == (0.0, 0.0), heard.hex(" ")
