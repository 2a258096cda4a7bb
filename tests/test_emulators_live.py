"""Emulators as programs: their port, their link, their end."""

import math
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from test_haply_board import HOME, NO_TORQUE, PUSH, SETUP
from waiting import until

from forcebound.errors import DeviceError
from forcebound.haptics.devices.truth_file import SUFFIX, TruthFile
from forcebound.haptics.hands.hands import PressingHand
from forcebound.hardware.emulated import Emulator, start
from forcebound.hardware.haply_2diy import Haply2DIY
from forcebound.hardware.port import Port

pytestmark = pytest.mark.live

COUNTERCLOCKWISE = 1
SOON = 5_000_000_000  # ns; a busy machine takes its time


@contextmanager
def emulated() -> Iterator[Emulator]:
    device = start("haply_2diy", Haply2DIY(), PressingHand(mass=0.1, stiffness=200.0, damping=2.0))
    try:
        yield device
    finally:
        device.close()


def exchange(port: Port, message: bytes) -> bytes:
    port.write(message)
    return port.read(9, time.monotonic_ns() + SOON)


def test_a_driver_starts_it_and_its_end_is_that_of_the_port() -> None:
    with emulated() as device:
        port, truth = Port(device.link), TruthFile(Path(device.link + SUFFIX))
        port.write(SETUP)
        assert exchange(port, PUSH) == HOME
        until(lambda: (found := truth.look()) is not None and any(found.torque), "torque")
        port.close()
        until(lambda: not Path(device.link + SUFFIX).exists(), "the end of the emulator")
        assert not Path(device.link).is_symlink()
        truth.close()


def test_the_driver_reports_why_an_emulator_does_not_start() -> None:
    with pytest.raises(DeviceError, match=r"(?s)does not start.*unknown"):
        start("unknown", Haply2DIY(), None)


def exchange_for_ever(port: Port) -> None:
    while True:
        exchange(port, NO_TORQUE)


@contextmanager
def program(link: Path, *words: str, kind: str = "haply_2diy") -> Iterator["subprocess.Popen[str]"]:
    """Start an emulator as in a terminal."""
    command = [sys.executable, "-m", "forcebound", "emulate", kind, "--link", str(link)]
    with subprocess.Popen(
        [*command, *words], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    ) as process:
        try:
            yield process
        finally:
            process.kill()


@contextmanager
def opened(link: Path) -> Iterator[Port]:
    port = Port(str(link))
    try:
        yield port
    finally:
        port.close()


def test_in_a_terminal_it_serves_one_user_after_another_until_it_is_interrupted(
    tmp_path: Path,
) -> None:
    link = tmp_path / "board"
    with program(link) as process:
        until(link.is_symlink, "the link")
        for _ in range(2):
            with opened(link) as port:
                port.write(SETUP)
                assert exchange(port, NO_TORQUE) == HOME
        with program(link) as second:
            out, _ = second.communicate()
        assert second.returncode == 2
        assert "an emulator runs at" in out
        assert "in another terminal" not in out
        process.send_signal(signal.SIGINT)
        out, _ = process.communicate()
    assert process.returncode == 0, out
    assert str(link) in out
    assert "2 replies" in out
    assert not list(tmp_path.iterdir())


def test_unplugged_on_demand(tmp_path: Path) -> None:
    link = tmp_path / "board"
    link.symlink_to("/dev/pts/999999")  # what a killed emulator has left
    with program(link, "--fault", "unplug:at=20ms") as process:
        until(link.exists, "the port")
        with opened(link) as port, pytest.raises(DeviceError, match="unplugged"):
            exchange_for_ever(port)
        process.communicate()
    assert process.returncode == 0


def test_the_makers_own_client_drives_it() -> None:
    hapi: Any = maker()
    with emulated() as device:
        truth = TruthFile(Path(device.link + SUFFIX))
        board = hapi.Board("test", device.link, 0)
        haply, pantograph = hapi.Device(5, board), hapi.Pantograph(3)
        haply.set_mechanism(pantograph)
        for number, offset, place in ((1, 168, 2), (2, 12, 1)):
            haply.add_actuator(number, COUNTERCLOCKWISE, place)
            haply.add_encoder(number, COUNTERCLOCKWISE, offset, 4880, place)
        haply.device_set_parameters()
        for _ in range(200):  # ms
            haply.set_device_torques([0.5, 0.25])
            haply.device_write_torques()
            haply.device_read_data()
            x, y = haply.get_device_position(haply.get_device_angles())
        found = truth.look()
        assert found is not None
        # From the left motor, not from our origin; offsets are cut to whole counts.
        assert math.dist(found.truth.position, (x - 0.019, y - 0.105)) < 3e-3
        told = haply.set_device_torques([0.5, 0.25])
        assert found.torque == pytest.approx(told[::-1], abs=2e-3)
        truth.close()
        board._Board__port.close()


def maker() -> Any:
    """Return the maker's client, which is under the GPL and so in no extra."""
    return pytest.importorskip("HaplyHAPI", reason="needs the maker's client: make hapi")
