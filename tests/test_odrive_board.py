"""The emulated ODrive, line by line, against what is known of the firmware."""

import math

import pytest
from builders import MS

from forcebound.hardware.emulators.odrive_board import ODriveBoard
from forcebound.hardware.odrive_lines import exclusive_or

START = (
    b"w axis0.config.watchdog_timeout 0.1\nu 0\nw axis0.config.enable_watchdog 1\nsc\n"
    b"w axis0.requested_state 8\n"
)


def started(axes: int = 1) -> ODriveBoard:
    """A board whose first axis is in closed-loop control from 2 ms on."""
    board = ODriveBoard(axes)
    assert board.receive(START, 0) == b""
    assert board.receive(b"r axis0.current_state\n", 2 * MS) == b"8\r\n"
    return board


@pytest.mark.parametrize("end", [b"\n", b"\r", b"!"])
def test_a_line_has_one_of_three_ends(end: bytes) -> None:
    assert ODriveBoard(1).receive(b"f 0" + end, 0) == b"0.000000 0.000000\r\n"


def test_a_reply_has_a_checksum_if_its_request_did() -> None:
    board = ODriveBoard(1)
    board.angles = (math.tau * 0.25,)
    assert board.receive(b"f 0\n", 0) == b"0.250000 0.000000\r\n"
    reply = board.receive(b"f 0 *86\n", MS)
    text, _, checksum = reply.removesuffix(b"\r\n").partition(b"*")
    assert text == b"0.250000 0.000000"
    assert int(checksum) == exclusive_or(text)


def test_a_wrong_checksum_is_passed_over_in_silence() -> None:
    board = started()
    assert board.receive(b"f 0 *85\nc 0 0.05 *1\nf 0 *\nf 0 *x\n", 3 * MS) == b""
    assert board.torque == (0.0,)
    assert board.receive(b"c 0 0.05 *104\n", 3 * MS) == b""
    assert board.torque == (0.05,)


def test_a_comment_is_passed_over_and_a_line_may_come_in_pieces() -> None:
    board = ODriveBoard(1)
    assert board.receive(b"f 0 ; where", 0) == b""
    assert board.receive(b" is it?", 0) == b""
    assert board.receive(b"\n", 0) == b"0.000000 0.000000\r\n"


def test_an_empty_line_is_an_unknown_command() -> None:
    assert ODriveBoard(1).receive(b"\r\n", 0) == b"unknown command\r\n" * 2


def test_a_line_that_is_too_long_vanishes_up_to_its_end() -> None:
    board = ODriveBoard(1)
    assert board.receive(b"f 0 ;" + b"x" * 251, 0) == b""
    assert board.receive(b"f 0\nf 0\n", 0) == b"0.000000 0.000000\r\n"
    assert board.receive(b"f 0 ;" + b"x" * 300 + b"\n", 0) == b""
    assert board.receive(b"f 0 ;" + b"x" * 250 + b"\n", 0) == b"0.000000 0.000000\r\n"


@pytest.mark.parametrize(
    ("line", "reply"),
    [
        (b"f", b"invalid command format"),
        (b"f 1", b"invalid motor 1"),
        (b"r", b"invalid command format"),
        (b"r axis0.nothing", b"invalid property"),
        (b"w vbus_voltage 1", b"not implemented"),
        (b"r vbus_voltage", b"24.000000"),
        (b"r fw_version_minor", b"5"),
        (b"r axis0.motor.config.torque_lim", b"inf"),
    ],
)
def test_answers_to_single_lines(line: bytes, reply: bytes) -> None:
    assert ODriveBoard(1).receive(line + b"\n", 0) == reply + b"\r\n"


def test_a_property_is_cut_to_nine_characters_and_feedback_is_not() -> None:
    board = ODriveBoard(1)
    board.angles = (-1234.5678901 * math.tau,)
    assert board.receive(b"r axis0.encoder.pos_estimate\n", 0) == b"-1234.567\r\n"
    assert board.receive(b"f 0\n", 0) == b"-1234.567890 0.000000\r\n"
    assert len(board.receive(b"r serial_number\n", 0)) == 9 + 2


def test_torque_acts_in_closed_loop_control_alone() -> None:
    board = ODriveBoard(1)
    board.receive(b"c 0 0.05\n", 0)
    assert board.torque == (0.0,)
    board.receive(START, 0)
    board.receive(b"", 2 * MS)
    assert board.torque == (0.05,)  # the one that was set before
    board.receive(b"c 0 -0.02\nw axis0.requested_state 1\n", 3 * MS)
    assert board.torque == (-0.02,)
    board.receive(b"", 5 * MS)
    assert board.torque == (0.0,)


def test_the_watchdog_ends_the_torque_for_good() -> None:
    board = started()
    board.receive(b"c 0 0.05\n", 10 * MS)
    assert board.wake_ns == 110 * MS
    board.receive(b"f 0\nr axis0.error\n", 109 * MS)  # these do not feed it
    assert board.torque == (0.05,)
    board.receive(b"", 110 * MS)
    assert board.torque == (0.0,)
    board.receive(b"c 0 0.05\n", 111 * MS)
    assert board.torque == (0.0,)
    assert board.receive(b"r axis0.error\nr axis0.current_state\n", 112 * MS) == b"2048\r\n1\r\n"
    board.receive(b"sc\nu 0\nw axis0.requested_state 8\n", 113 * MS)
    assert board.receive(b"r axis0.error\nr axis0.current_state\n", 115 * MS) == b"0\r\n8\r\n"


def test_a_watchdog_that_was_never_fed_expires_at_once() -> None:
    board = ODriveBoard(1)
    board.receive(b"w axis0.config.watchdog_timeout 0.1\nw axis0.config.enable_watchdog 1\n", 0)
    assert board.receive(b"r axis0.error\n", 2 * MS) == b"2048\r\n"


def test_numbers_that_are_none_and_too_large_ones_are_taken() -> None:
    board = started()
    off = b"w axis0.controller.config.enable_torque_mode_vel_limit 0\n"
    board.receive(off + b"c 0 nan\n", 3 * MS)
    assert board.torque == pytest.approx((0.4,))  # not defined; the most here
    board.receive(b"c 0 -1e39\n", 4 * MS)
    assert board.torque == pytest.approx((-0.4,))


def test_the_torque_falls_with_the_speed_unless_that_is_switched_off() -> None:
    board = started()
    board.receive(b"c 0 0.05\n", 3 * MS)
    board.angles = (0.003 * math.tau,)  # 3 turns/s; 1 beyond the limit, at 1/6 N m for each
    board.receive(b"", 4 * MS)
    assert board.torque == pytest.approx((-1 / 6,))
    board.receive(b"w axis0.controller.config.enable_torque_mode_vel_limit 0\n", 4 * MS)
    assert board.torque == (0.05,)


def test_an_invalid_estimate_repeats_the_last_one_and_ends_the_torque() -> None:
    board = started()
    board.angles = (math.tau,)
    board.receive(b"c 0 0.05\n", 3 * MS)
    board.has_estimate, board.angles = False, (2 * math.tau,)
    reply = board.receive(b"f 0\nr axis0.error\n", 4 * MS)
    assert reply.startswith(b"1.000000 ")
    assert reply.endswith(b"\r\n256\r\n")
    assert board.torque == (0.0,)


def test_a_board_that_is_not_calibrated_does_not_switch_its_motor_on() -> None:
    board = ODriveBoard(1, is_calibrated=False)
    board.receive(b"w axis0.requested_state 8\n", 0)
    assert board.receive(b"r axis0.current_state\nr axis0.error\n", 2 * MS) == b"1\r\n1\r\n"


def test_axes_know_nothing_of_each_other() -> None:
    board = started(axes=2)
    board.angles = (0.0, math.tau)
    assert board.receive(b"f 1\nr axis1.current_state\n", 3 * MS).startswith(b"1.000000 ")
    board.receive(b"c 0 0.05\nc 1 0.05\n", 4 * MS)
    assert board.torque == (0.05, 0.0)
