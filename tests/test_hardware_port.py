"""Serial ports: whole messages, reading until a deadline, and which port is meant."""

import json
import os
import re
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner
from waiting import TIMEOUT

from forcebound.cli import main
from forcebound.errors import ConfigError, DeviceError
from forcebound.graph.loader import load
from forcebound.hardware import ports
from forcebound.hardware.port import Port
from forcebound.hardware.ports import SerialPort, check_serial_number, find
from forcebound.network import sockets
from forcebound.run.live import check_here

SOON_NS = 20_000_000
HAPLY = SerialPort("/dev/ttyACM0", "Arduino Due", "1A2B", "haply_2diy")
ODRIVE = SerialPort("/dev/ttyACM1", "ODrive", "3C4D", "odrive")
OTHER = SerialPort("/dev/ttyUSB0", "a converter")
BUILT_IN = SerialPort("/dev/ttyS0")


@dataclass
class Line:
    """Both ends of a pseudo-terminal: the board's, and an open port."""

    board: int
    port: Port


@pytest.fixture
def line() -> Iterator[Line]:
    board, slave = os.openpty()
    path = os.ttyname(slave)
    port = Port(path)
    os.close(slave)
    yield Line(board, port)
    port.close()
    os.close(board)


def soon_ns() -> int:
    return time.monotonic_ns() + SOON_NS


def patiently_ns() -> int:
    return time.monotonic_ns() + round(TIMEOUT * 1e9)


def sent_by_board(line: Line, data: bytes) -> None:
    """Write as the board does; wait for the kernel, which passes it on when it finds time."""
    os.write(line.board, data)
    assert sockets.wait((line.port.descriptor,), round(TIMEOUT * 1e9))


def test_any_bytes_pass_both_ways_unchanged(line: Line) -> None:
    message = bytes(range(256))
    line.port.write(message)
    assert os.read(line.board, 4096) == message
    os.write(line.board, message)
    assert line.port.read(256, patiently_ns()) == message


def test_a_short_reply_is_what_came_by_the_deadline(line: Line) -> None:
    sent_by_board(line, b"abc")
    assert line.port.read(9, soon_ns()) == b"abc"
    assert line.port.read(9, soon_ns()) == b""


def test_no_more_is_read_than_was_asked_for_and_the_rest_can_be_drained(line: Line) -> None:
    sent_by_board(line, b"abcdef")
    assert line.port.read(2, soon_ns()) == b"ab"
    assert line.port.read(1, 0) == b"c"  # what is there is read after the deadline, too
    assert line.port.drain() == b"def"
    assert line.port.drain() == b""


def test_a_device_that_is_never_quiet_is_not_read_for_ever(
    line: Line, monkeypatch: pytest.MonkeyPatch
) -> None:
    sent_by_board(line, b"x")  # so that the descriptor stays readable
    monkeypatch.setattr(line.port, "_take", lambda count: b"x")
    assert set(line.port.drain(1e-4)) == set(b"x")
    assert set(line.port.read_lines(1, time.monotonic_ns() + 1_000_000)) == set(b"x")


def test_a_port_that_takes_no_more_is_an_error_and_is_not_waited_for(line: Line) -> None:
    def fill() -> None:
        while True:
            line.port.write(bytes(4096))

    with pytest.raises(DeviceError, match="does not read"):
        fill()


def test_an_unplugged_device_is_said_when_read_and_when_written() -> None:
    board, slave = os.openpty()
    port = Port(os.ttyname(slave))
    os.close(slave)
    os.close(board)
    with pytest.raises(DeviceError, match="unplugged"):
        port.read(1, soon_ns())
    with pytest.raises(DeviceError, match="unplugged"):
        port.write(b"a")
    port.close()


def test_a_port_in_use_is_not_opened_a_second_time(line: Line) -> None:
    with pytest.raises(DeviceError, match="in use by another program"):
        Port(line.port.path)


def test_auto_is_the_only_port_of_the_kind_or_the_only_one() -> None:
    assert find("auto", "haply_2diy", [HAPLY, ODRIVE, OTHER]) == "/dev/ttyACM0"
    assert find("auto", "haply_2diy", [BUILT_IN, OTHER]) == "/dev/ttyUSB0"
    with pytest.raises(DeviceError, match=r"may mean several: .*ttyACM0.*ttyACM1"):
        find("auto", "", [HAPLY, ODRIVE])
    with pytest.raises(DeviceError, match=r"found none.*plug it in.*ports here: none"):
        find("auto", "odrive", [])
    with pytest.raises(DeviceError, match="found none"):
        find("auto", "odrive", [BUILT_IN])


def test_a_port_is_found_by_the_serial_number_of_its_device() -> None:
    assert find("3C4D", among=[HAPLY, ODRIVE, OTHER]) == "/dev/ttyACM1"
    assert find("/any/path", among=[]) == "/any/path"
    with pytest.raises(DeviceError, match=r"'5E6F', found none.*serial number 1A2B, seems to be h"):
        find("5E6F", among=[HAPLY])


def test_the_list_of_ports_is_a_table_or_a_document(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ports, "listed", lambda: [HAPLY, OTHER])
    shown = CliRunner().invoke(main, ["device", "list"])
    assert re.search(r"/dev/ttyACM0 +haply_2diy +1A2B +Arduino Due +yes", shown.output)
    document = json.loads(CliRunner().invoke(main, ["device", "list", "--json"]).stdout)
    assert [port["path"] for port in document] == ["/dev/ttyACM0", "/dev/ttyUSB0"]


def test_without_a_port_the_emulator_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ports, "listed", list)
    assert "`forcebound emulate haply_2diy`" in CliRunner().invoke(main, ["device", "list"]).output


def test_the_numbers_of_another_board_are_refused_where_boards_can_be_told() -> None:
    there = [HAPLY, BUILT_IN]
    check_serial_number(HAPLY.path, "1A2B", there)
    check_serial_number(HAPLY.path, "", there)
    check_serial_number(BUILT_IN.path, "1A2B", there)
    with pytest.raises(DeviceError, match="number 5E6F, and /dev/ttyACM0 is that with 1A2B"):
        check_serial_number(HAPLY.path, "5E6F", there)


@pytest.mark.parametrize("number", ["0012", "1E5"])
def test_a_serial_number_that_looks_like_a_number_is_taken_as_it_is_written(number: str) -> None:
    model: Any = load("haply_2diy.yaml", [f"device:={number}"]).only.device
    assert model.port == number


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("file", "expected a serial port, got "),
        ("folder", "expected a serial port, got "),
        ("nothing", "there is no port"),
        ("link", "leads to .*nothing, which is not there"),
        ("/dev/zero", "got /dev/zero"),
    ],
)
def test_a_launch_refuses_what_is_no_serial_port(content: str, said: str, tmp_path: Path) -> None:
    path = Path(content) if content.startswith("/") else tmp_path / content
    if content == "file":
        path.touch()
    elif content == "folder":
        path.mkdir()
    elif content == "link":
        path.symlink_to(tmp_path / "nothing")
    with pytest.raises(ConfigError, match=f"device: .*{said}"):
        check_here(load("haply_2diy.yaml", [f"device:={path}"]))


def test_a_launch_refuses_a_port_in_use(line: Line) -> None:
    with pytest.raises(ConfigError, match="is in use by another program"):
        check_here(load("odrive_knob.yaml", [f"device:={line.port.path}"]))
