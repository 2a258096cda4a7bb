"""The ODrive driver against the emulated board, message by message."""

import math
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest
from builders import MS

from forcebound.errors import DeviceError
from forcebound.hardware.emulators.odrive_board import ODriveBoard
from forcebound.hardware.odrive import ODrive, OpenODrive
from forcebound.hardware.odrive_lines import (
    answer,
    error_words,
    exclusive_or,
    number,
    on_wire,
    position,
    request,
    torque_request,
)
from forcebound.hardware.serial_device import FIRST_EXCHANGES
from forcebound.messages.packets import Vector
from forcebound.testing import AnsweredLine, scripted

HOLD = 1.0  # s; a fake line has no time


class FakeLine(AnsweredLine):
    """A line whose board answers at once; a millisecond passes with each message."""

    def __init__(self, board: ODriveBoard) -> None:
        super().__init__(self._respond)
        self.board, self.time_ns = board, 0
        self.forces: list[bool] = []
        self.spoil: Callable[[bytes], bytes] = bytes  # what becomes of a reply

    def _respond(self, message: bytes) -> bytes:
        self.time_ns += MS
        return self.board.receive(message, self.time_ns)

    def send(self, message: bytes | str, has_force: bool = False) -> None:
        super().send(message, has_force)
        self.forces.append(has_force)

    def read_lines(self, count: int, deadline_ns: int = 0) -> bytes:
        return self.spoil(super().read_lines(count))

    def fail(self, failure: DeviceError) -> None:
        super().fail(failure)
        self.write(b"\nc 0 0\nc 1 0\nc 2 0\n")


def opened(
    board: ODriveBoard | None = None,
    clock: Callable[[], int] = time.monotonic_ns,
    **changed: float | None,
) -> tuple[OpenODrive, ODriveBoard, FakeLine]:
    """A driver on a fake line, its motors off."""
    board = board or ODriveBoard(1)
    line = FakeLine(board)
    numbers: dict[str, Any] = dict(changed)
    model = replace(ODrive(joints=len(board.angles), port="auto"), **numbers)
    return OpenODrive(model, line, HOLD, clock), board, line


def write_often(device: OpenODrive, force: Vector) -> None:
    for _ in range(5):
        device.write(0, force)


def switched_on(
    board: ODriveBoard | None = None,
    clock: Callable[[], int] = time.monotonic_ns,
    **changed: float | None,
) -> tuple[OpenODrive, ODriveBoard, FakeLine]:
    device, board, line = opened(board, clock, **changed)
    for _ in range(2 * device.axes + 2):
        assert device.write(0, (0.0,) * device.axes) == (0.0,) * device.axes
    return device, board, line


def lines(*commands: str) -> bytes:
    return b"".join(map(request, commands))


def replies(*texts: str) -> bytes:
    return b"".join(
        b"%s*%d\r\n" % (t, exclusive_or(t)) for t in (text.encode("latin-1") for text in texts)
    )


FEEDBACK = "0.000000 0.000000"
NO_TORQUE = "c 0 0.000000"
STATE = ("f 0", "r axis0.error", "r axis0.current_state")
LIMITS = {"torque_lim": "inf", "current_lim": "10.0", "torque_constant": "0.04"}
START = (
    (b"\n" + lines(NO_TORQUE, "r fw_version_major"), b"unknown command\r\n" + replies("0")),
    (lines("r fw_version_major"), replies("0")),
    (lines("r fw_version_minor"), replies("5")),
    (lines("r axis0.current_state"), replies("1")),
    (lines("r axis0.controller.config.enable_torque_mode_vel_limit"), replies("1")),
    (lines("w axis0.controller.config.enable_torque_mode_vel_limit 0"), None),
    (lines("r axis0.controller.config.enable_torque_mode_vel_limit"), replies("0")),
    (lines("r axis0.controller.config.input_mode"), replies("5")),
    (lines("w axis0.controller.config.input_mode 1"), None),
    (lines("r axis0.controller.config.input_mode"), replies("1")),
    *[(lines(f"r axis0.motor.config.{name}"), replies(text)) for name, text in LIMITS.items()],
    *(
        (lines("f 0"), replies(FEEDBACK)),
        (lines("c 0 -0.000000", *STATE), replies(FEEDBACK, "0", "1")),
    )
    * FIRST_EXCHANGES,
)
SWITCH_ON = (
    NO_TORQUE,
    "w axis0.config.watchdog_timeout 0.02",  # below the limit that is stated
    "u 0",
    "w axis0.config.enable_watchdog 1",
    "sc",
    "w axis0.requested_state 8",
    "r axis0.current_state",
)
SWITCH_OFF = ("w axis0.requested_state 1", "w axis0.config.enable_watchdog 0")


def test_the_guardian_watches_a_read_while_a_torque_is_held() -> None:
    device, _, line = switched_on()
    line.forces.clear()
    device.read(0)
    device.write(0, (0.1,))
    device.read(0)
    device.write(0, (0.0,))
    device.read(0)
    assert line.forces == [False, True, True, False, False]


def test_lines_of_the_specification() -> None:
    assert lines("r vbus_voltage", "f 0") == b"r vbus_voltage *93\nf 0 *86\n"
    assert lines("c 0 0.05", "u 0") == b"c 0 0.05 *104\nu 0 *69\n"


def test_start_and_torque_have_the_lines_and_the_order_that_the_firmware_needs() -> None:
    script = (
        (lines(*SWITCH_ON), replies("8")),
        (lines("c 0 -0.100000", *STATE), replies(FEEDBACK, "0", "8")),
        (lines("f 0"), replies("0.25 0")),
        (b"\n" + lines(NO_TORQUE, *SWITCH_OFF), None),
    )
    with scripted(*START, *script) as line:
        device = OpenODrive(ODrive(port="auto", watchdog_limit=0.021), line, HOLD)
        assert device.write(0, (0.1,)) == (0.0,)  # it is not on yet
        assert device.write(0, (0.1,)) == (0.1,)
        assert device.read(0) == (math.tau / 4,)
        device.close()


@pytest.mark.parametrize("torque", [math.nan, math.inf])
def test_what_is_no_number_is_not_sent(torque: float) -> None:
    with pytest.raises(ValueError, match="finite"):
        torque_request(0, torque)


@pytest.mark.parametrize(
    ("parse", "given"),
    [
        *[(answer, line) for line in (b"0.1 0.2", b"0.1 0.2*1", b"*", b"", b"0.1*x")],
        *[(position, text) for text in ("nan nan", "0.1", "0.1 0.2 0.3", "inf 0", "unknown")],
    ],
)
def test_a_reply_that_is_none_is_refused(parse: Callable[[Any], Any], given: Any) -> None:
    with pytest.raises(DeviceError, match=r"checksum|position and velocity"):
        parse(given)


def test_numbers_and_errors_in_words() -> None:
    assert number("-1234.567", "x") == -1234.567
    assert number("inf", "motor.config.torque_lim") == math.inf
    for text in ("invalid property", "nan"):
        with pytest.raises(DeviceError, match="number vbus"):
            number(text, "vbus")
    assert error_words(0x840) == "0x840 (MOTOR_FAILED|WATCHDOG_TIMER_EXPIRED)"


def test_it_is_switched_on_by_its_first_writes_and_gives_no_torque_before() -> None:
    device, board, _ = opened()
    assert board.torque == (0.0,)
    assert device.write(0, (0.1,)) == (0.0,)
    assert board.torque == (0.0,)
    for _ in range(3):
        device.write(0, (0.0,))
    assert device.write(0, (0.1,)) == (0.1,)
    assert board.torque == (-0.1,)  # a positive one resists


class LateLine(FakeLine):
    """A line whose machine is busy: a silence, however long, means nothing."""

    def drain(self, quiet: float = 0.0) -> bytes:
        return b"" if quiet else super().drain()


def test_the_answer_to_an_empty_line_may_be_late() -> None:
    line = LateLine(ODriveBoard(1))
    assert OpenODrive(ODrive(port="auto"), line, HOLD).read(0) == (0.0,)


def test_angles_are_those_of_the_shafts() -> None:
    device, board, _ = switched_on(ODriveBoard(2))
    board.angles = (0.5, -1.25)
    assert device.read(0) == pytest.approx((0.5, -1.25), abs=math.tau * 5e-7)
    assert device.kinematics.position((0.5, -1.25)) == pytest.approx((0.02, -0.05))


def test_what_is_given_is_what_the_wire_has() -> None:
    device, board, line = switched_on(ODriveBoard(2))
    given = device.write(0, (0.1234567891, -0.05))
    assert given == (0.123456, -0.05)
    assert board.torque == (-0.123456, 0.05)
    assert line.forces[-1]


@pytest.mark.parametrize(
    ("asked", "given"), [((3.0, 4.0), (0.18, 0.24)), ((math.nan, 1.0), (0.0, 0.0))]
)
def test_it_gives_no_more_than_its_saturation(asked: Vector, given: Vector) -> None:
    device, board, _ = switched_on(ODriveBoard(2))
    assert device.write(0, asked) == pytest.approx(given)
    assert board.torque == pytest.approx(tuple(-g for g in given))
    assert device.write(0, (1e39, 0.0)) == (0.3, 0.0)


def test_a_reading_is_stamped_early_and_a_force_late() -> None:
    device, _, _ = switched_on()
    device.read(0)
    device.write(0, (0.1,))
    read_ns, effect_ns = device.stamps()
    assert effect_ns - read_ns >= 250_000  # both ends of the firmware's period
    assert device.latch_jitter() >= 125_000


@pytest.mark.parametrize("axis", [0, 1])
def test_an_error_of_any_axis_ends_all(axis: int) -> None:
    board = ODriveBoard(2)
    device, _, line = switched_on(board)
    device.write(0, (0.1, 0.1))
    board.receive(b"w axis%d.error 64\n" % axis, line.time_ns)
    with pytest.raises(DeviceError, match=f"axis {axis} .*MOTOR_FAILED"):
        write_often(device, (0.1, 0.1))
    assert board.torque == (0.0, 0.0)
    with pytest.raises(DeviceError, match="MOTOR_FAILED"):
        device.read(0)


def test_an_estimate_that_is_repeated_is_found_out() -> None:
    device, board, _ = switched_on()
    device.write(0, (0.1,))
    board.has_estimate = False
    device.read(0)
    with pytest.raises(DeviceError, match="ENCODER_FAILED"):
        device.write(0, (0.1,))
    assert board.torque == (0.0,)


@pytest.mark.parametrize("force", [0.0, 0.1])
def test_a_board_that_was_reset_ends_all(force: float) -> None:
    device, board, _ = switched_on(ODriveBoard(2))
    device.write(0, (force, force))
    board.reset()
    with pytest.raises(DeviceError, match="without an error: the board was reset"):
        device.write(0, (force, force))


def test_a_watchdog_that_expires_under_force_is_the_end() -> None:
    device, board, line = switched_on()
    device.write(0, (0.1,))
    line.time_ns += 30 * MS
    with pytest.raises(DeviceError, match="WATCHDOG_TIMER_EXPIRED"):
        device.write(0, (0.1,))
    assert board.torque == (0.0,)


def test_after_a_pause_without_force_the_motors_are_switched_on_again() -> None:
    device, board, line = switched_on()
    line.time_ns += 3000 * MS
    assert device.write(0, (0.1,)) == (0.0,)
    for _ in range(3):
        assert device.write(0, (0.1,)) in ((0.0,), (0.1,))
    assert device.write(0, (0.1,)) == (0.1,)
    assert board.torque == (-0.1,)


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda reply: reply[:-1], "expected a reply to each request, 1 in all"),
        (lambda reply: b"", "no reply within 10 ms"),
        (lambda reply: reply + b"0*48\r\n", "expected a reply to each request"),
        (lambda reply: bytes([reply[0] ^ 1]) + reply[1:], "checksum"),
        (ODriveBoard(1).with_nan, "expected position and velocity"),
    ],
    ids=["short", "late", "foreign", "noise", "nan"],
)
def test_a_reply_that_is_not_in_order_ends_all(spoil: Callable[[bytes], bytes], words: str) -> None:
    device, board, line = switched_on()
    device.write(0, (0.1,))
    line.spoil = spoil
    with pytest.raises(DeviceError, match=words):
        device.read(0)
    assert board.torque == (0.0,)
    with pytest.raises(DeviceError, match=words):
        device.write(0, (0.1,))


@pytest.mark.parametrize("error", ["nan", "inf", "-1", "0.0", "", "0.1 0.2", "\u00b2"])
def test_an_error_that_is_no_whole_number_ends_all(error: str) -> None:
    device, board, line = switched_on()
    device.write(0, (0.1,))

    def spoil(reply: bytes) -> bytes:
        turns, _, *rest = reply.split(b"\r\n")
        return b"\r\n".join((turns, replies(error).removesuffix(b"\r\n"), *rest))

    line.spoil = spoil
    with pytest.raises(DeviceError, match="whole number"):
        device.write(0, (0.1,))
    assert board.torque == (0.0,)


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda reply: b"", "no reply within"),
        (lambda reply: b"Marlin 2.1\r\n", r"got b'Marlin 2\.1"),
        (lambda reply: reply[:-1], r"got b'unknown.*0\*48\\r'"),
    ],
    ids=["silent", "another board", "short"],
)
def test_the_start_names_what_came_from_another_board(
    spoil: Callable[[bytes], bytes], words: str
) -> None:
    line = FakeLine(ODriveBoard(1))
    line.spoil = spoil
    with pytest.raises(DeviceError, match=words):
        OpenODrive(ODrive(port="auto"), line, HOLD)


def test_what_nobody_asked_for_ends_all() -> None:
    device, board, line = switched_on()
    device.write(0, (0.1,))
    line.receive(b"0.1 0.2\r\n")
    with pytest.raises(DeviceError, match="unexpected bytes"):
        device.read(0)
    assert board.torque == (0.0,)


def test_what_a_former_user_has_left_does_not_matter() -> None:
    board = ODriveBoard(1)
    board.receive(b"c 0 0.1\nw axis0.requested_state 8\nw axis0.controller.inp", 0)
    device, _, _ = opened(board)
    assert device.read(0) == (0.0,)
    assert board.torque == (0.0,)


def test_a_board_that_is_not_calibrated_is_told_so(monkeypatch: pytest.MonkeyPatch) -> None:
    device, _, _ = opened(ODriveBoard(1, is_calibrated=False))
    monkeypatch.setattr("forcebound.hardware.odrive_start.SWITCHING_NS", 0)
    with pytest.raises(DeviceError, match=r"does not switch on, error 0x1 \(INVALID_STATE\)"):
        write_often(device, (0.0,))


@pytest.mark.parametrize(
    ("changed", "hold", "words"),
    [
        ({"joints": 2}, HOLD, "no axis 1"),
        ({"saturation": 0.5}, HOLD, "gives 0.4 N m at most"),
        ({}, 0.0, "a tick take .* ms at this port"),
    ],
)
def test_a_board_that_will_not_do_is_refused(
    changed: dict[str, Any], hold: float, words: str
) -> None:
    line = FakeLine(ODriveBoard(1))
    with pytest.raises(DeviceError, match=words):
        OpenODrive(replace(ODrive(port="auto"), **changed), line, hold)
    line = FakeLine(ODriveBoard(1))
    line.board._values["fw_version_minor"] = 6
    with pytest.raises(DeviceError, match=r"firmware 0\.6"):
        OpenODrive(ODrive(port="auto"), line, HOLD)


def test_it_is_closed_without_torque_and_without_a_watchdog_that_complains() -> None:
    device, board, line = switched_on()
    device.write(0, (0.1,))
    device.close()
    assert line.is_closed
    board.receive(b"", line.time_ns + 100 * MS)
    assert board.torque == (0.0,)
    said = board.receive(b"r axis0.error\nr axis0.current_state\n", line.time_ns + 100 * MS)
    assert said == b"0\r\n1\r\n"


@pytest.mark.parametrize("torque", [0.0329959569, -0.0329959569, 0.1, 1e-7, -0.0, 2.0000005])
def test_the_wire_never_has_more_torque_than_was_asked_for(torque: float) -> None:
    held = on_wire(torque)
    assert abs(held) <= abs(torque)
    assert abs(torque - held) < 1e-6
    assert f"{held:.6f}" == torque_request(0, held).split()[2].decode().partition("*")[0]
