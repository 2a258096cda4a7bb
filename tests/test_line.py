"""A line to a board: it fails once, in zero force, and its guardian watches every force."""

import logging
import os
import threading
import time
from collections.abc import Iterator
from typing import NamedTuple

import pytest
from waiting import TIMEOUT

from forcebound.errors import DeviceError
from forcebound.graph.servo import ServoSettings, dissipation_of
from forcebound.hardware.haply_2diy import Haply2DIY
from forcebound.hardware.line import Line
from forcebound.hardware.odrive import ODrive
from forcebound.network import sockets

pytestmark = pytest.mark.live
FORCE, ZERO = b"force...", b"no force"


class Ends(NamedTuple):
    """Where the board is, and the line to it."""

    board: int
    line: Line


@pytest.fixture
def ends() -> Iterator[Ends]:
    board, slave = os.openpty()
    line = Line("none", os.ttyname(slave), ZERO, 60.0)
    yield Ends(board, line)
    line.close()
    os.close(slave)
    os.close(board)


def heard_by(board: int, count: int) -> bytes:
    """What comes to a board, which the kernel may pass on in pieces: at least so many bytes."""
    heard = b""
    while len(heard) < count:
        assert sockets.wait((board,), round(TIMEOUT * 1e9)), heard
        heard += os.read(board, 100)
    return heard


def test_a_line_that_failed_writes_zero_and_refuses_with_the_first_reason(ends: Ends) -> None:
    board, line = ends
    line.send(FORCE, has_force=True)
    line.fail(DeviceError("the first reason"))
    line.fail(DeviceError("another"))
    with pytest.raises(DeviceError, match="the first reason"):
        line.send(FORCE, has_force=True)
    said = FORCE + ZERO + ZERO
    assert heard_by(board, len(said)) == said


def test_bytes_that_nobody_asked_for_are_shown_and_nothing_is_written(ends: Ends) -> None:
    board, line = ends
    os.write(board, b"\x07\x08")
    assert line.port.read(1, time.monotonic_ns() + round(TIMEOUT * 1e9)) == b"\x07"
    with pytest.raises(DeviceError, match="unexpected bytes: 08"):
        line.send(FORCE, has_force=True)
    line.send(ZERO, has_force=False)
    assert heard_by(board, len(ZERO)) == ZERO


def test_what_a_board_answers_to_the_guardian_is_not_the_reason() -> None:
    board, slave = os.openpty()
    line = Line("none", os.ttyname(slave), ZERO, 0.01)
    line.send(FORCE, has_force=True)
    assert heard_by(board, len(FORCE + ZERO)) == FORCE + ZERO
    said = "the guardian of the port has written zero force"
    with pytest.raises(DeviceError, match=said):
        line.fail(DeviceError("the device sends unexpected bytes"))
    with pytest.raises(DeviceError, match=said):
        line.send(FORCE, has_force=True)
    line.close()
    os.close(slave)
    os.close(board)


@pytest.mark.parametrize("model", [Haply2DIY, ODrive])
def test_a_force_may_last_longer_with_an_emulator_than_at_a_port(
    model: type[Haply2DIY | ODrive],
) -> None:
    def limits(device: Haply2DIY | ODrive) -> tuple[float, float]:
        return device.longest_force, dissipation_of(device, ServoSettings()).watchdog_limit

    assert limits(model(port="auto")) == (0.02, 0.02)
    assert limits(model()) == (0.1, 0.1)
    assert limits(model(watchdog_limit=0.03)) == (0.03, 0.03)


@pytest.mark.parametrize(
    ("answer", "has_force", "is_said"),
    [(b"", True, True), (b"ok", True, False), (b"", False, False)],
)
def test_a_zero_that_the_board_does_not_acknowledge_is_said_once(
    answer: bytes, has_force: bool, is_said: bool, caplog: pytest.LogCaptureFixture
) -> None:
    board, slave = os.openpty()
    line = Line("none", os.ttyname(slave), ZERO, 60.0, zero_reply=2)

    def play() -> None:
        heard_by(board, len(FORCE + ZERO))
        os.write(board, answer)

    line.send(FORCE, has_force=has_force)
    playing = threading.Thread(target=play)
    playing.start()
    line.fail(DeviceError("a reason"))
    playing.join()
    line.close()
    said = [record for record in caplog.records if record.levelno == logging.ERROR]
    assert len(said) == is_said
    assert all("a force may still be on" in record.getMessage() for record in said)
    os.close(slave)
    os.close(board)


def test_a_line_that_is_lost_with_a_force_on_is_said(
    ends: Ends, caplog: pytest.LogCaptureFixture
) -> None:
    ends.line.send(FORCE, has_force=True)
    with open(os.devnull) as nothing:
        os.dup2(nothing.fileno(), ends.board)  # the last end of the board is closed
    ends.line.fail(DeviceError("a reason"))
    assert "a force may still be on" in caplog.text
