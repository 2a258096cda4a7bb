"""The driver of the Haply 2DIY, on a board that a test scripts."""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest
from scripted_board import FREE, ScriptedBoard

from forcebound.errors import DeviceError
from forcebound.haptics.devices.five_bar import FiveBar
from forcebound.hardware.haply_2diy import Haply2DIY, OpenHaply, link_sine
from forcebound.messages.packets import Vector

STEP = math.tau / 4880  # rad
MODEL = Haply2DIY(port="auto")


def opened(board: Any) -> OpenHaply:
    """The device, in a pose in which all of a torque is applied."""
    device = OpenHaply(MODEL, board, board.clock)
    board.counts = FREE
    device.read(0)
    return device


@pytest.fixture
def board() -> ScriptedBoard:
    return ScriptedBoard()


def test_it_is_set_up_once_without_torque_and_left_without(board: ScriptedBoard) -> None:
    device = opened(board)
    assert len(board.others) == 1
    assert set(board.torques) == {(0.0, 0.0)}
    device.write(0, (0.05, -0.02))
    device.close()
    assert len(board.others) == 1
    assert board.torques[-1] == (0.0, 0.0)
    assert board.is_closed


def test_the_angles_are_those_of_the_encoders_in_rad(board: ScriptedBoard) -> None:
    device = opened(board)
    board.counts = (500, 1500)
    cut = 12 * 4880 / 360 - 162, 168 * 4880 / 360 - 2277
    expected = [(500 + cut[0]) * STEP, (1500 + cut[1]) * STEP]
    assert device.read(0) == pytest.approx(expected, rel=1e-12)


def test_reading_sends_the_torque_that_is_held_and_changes_nothing(board: ScriptedBoard) -> None:
    device = opened(board)
    device.write(0, (0.05, -0.02))
    device.read(0)
    assert board.torques[-1] == board.torques[-2]


def test_no_motor_gets_more_than_it_has_and_the_direction_is_kept(board: Any) -> None:
    device = OpenHaply(replace(MODEL, saturation=0.2), board, board.clock)
    board.counts = FREE
    device.read(0)
    applied = device.write(0, (3.0, -1.5))
    assert applied[0] == pytest.approx(0.123, rel=1e-3)
    assert applied[1] == pytest.approx(-0.0615, rel=1e-3)


@pytest.mark.parametrize("wrong", [math.nan, math.inf, -math.inf])
def test_a_torque_that_is_no_number_is_none(board: ScriptedBoard, wrong: float) -> None:
    device = opened(board)
    device.write(0, (0.05, 0.0))
    assert device.write(0, (0.05, wrong)) == (0.0, 0.0)
    assert board.torques[-1] == (0.0, 0.0)


def test_torques_fade_before_a_singular_pose_in_both_motors_alike(board: ScriptedBoard) -> None:
    shares = []
    device = opened(board)
    for angle in range(78, 106, 3):  # both sides up: the links at the tip come into line
        board.counts = (round(angle / 360 * 4880), round((180 - angle) / 360 * 4880))
        device.read(0)
        applied = device.write(0, (0.06, 0.03))
        shares.append(applied[0] / 0.06)
        assert applied[1] / 0.03 == pytest.approx(shares[-1], abs=2e-3)
    assert shares[0] == pytest.approx(1.0, abs=1e-3)
    assert shares[-1] == 0.0
    assert shares == sorted(shares, reverse=True)


def test_the_sines_are_those_between_the_links() -> None:
    model = FiveBar()
    pose = (0.3, 2.2)
    x, y = (a + b for a, b in zip(model.geometry().position(pose), model.origin, strict=True))
    sines = []
    links = []
    for side, angle in zip((0.5, -0.5), pose, strict=True):
        proximal = (0.07 * math.cos(angle), 0.07 * math.sin(angle))
        distal = (x - side * model.base - proximal[0], y - proximal[1])
        links.append(distal)
        sines.append(cross(proximal, distal) / (0.07 * 0.09))
    sines.append(cross(*links) / 0.09**2)
    expected = min(map(abs, sines))
    assert link_sine(model.geometry().jacobian(pose), 0.07) == pytest.approx(expected)
    assert link_sine(((0.0, 0.0), (0.0, 0.0)), 0.07) == 0.0


def cross(a: Vector, b: Vector) -> float:
    return a[0] * b[1] - a[1] * b[0]


def test_the_time_from_reading_to_writing_is_taken_for_its_longest(board: ScriptedBoard) -> None:
    device = opened(board)  # whose quickest exchange takes 80 us
    start_ns = board.time_ns
    device.read(0)
    board.time_ns += 50_000
    board.round_trip_ns = 100_000
    device.write(0, (0.0, 0.0))
    assert device.stamps() == (start_ns, start_ns + 80_000 + 50_000 + 20_000)


def test_a_reply_that_takes_its_time_makes_the_reading_that_uncertain(board: ScriptedBoard) -> None:
    device = opened(board)
    assert device.latch_jitter() == 0
    board.round_trip_ns = 3_000_000
    device.read(0)
    assert device.latch_jitter() == 2_920_000
    assert device.exchanges.late == 1
    assert device.exchanges.longest_ns == 3_000_000


def test_the_angles_of_a_write_are_fresh_for_as_long_as_a_reply_may_take(
    board: ScriptedBoard,
) -> None:
    device = opened(board)
    held = len(board.torques)
    board.counts = (500, 1500)
    device.write(0, (0.0, 0.0))
    board.time_ns += round(MODEL.reply_within * 1e9)
    angles_of_write = device.fresh_reading()
    board.time_ns += 1
    assert device.fresh_reading() is None
    assert len(board.torques) == held + 1
    assert angles_of_write == device.read(0)


@pytest.mark.parametrize(
    ("reply", "words"),
    [
        (lambda board: b"", "no reply within 1000 ms: is this the port of the board"),
        (lambda board: b"invalid c", "another device at this port"),
    ],
)
def test_another_device_is_found_out_when_it_is_opened(
    reply: Callable[[ScriptedBoard], bytes], words: str
) -> None:
    board: Any = ScriptedBoard(reply)
    with pytest.raises(DeviceError, match=words):
        OpenHaply(MODEL, board, board.clock)
    assert set(board.torques) == {(0.0, 0.0)}


def test_another_pose_than_the_home_pose_after_the_set_up_is_said(board: ScriptedBoard) -> None:
    board.counts = (0, 0)
    with pytest.raises(DeviceError, match=r"report the home pose.*but reports 0\.0, 0\.0"):
        opened(board)
