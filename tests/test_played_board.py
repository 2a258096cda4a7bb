"""The driver that ships as an example, against a board that a thread plays."""

import math
import os
import struct
import threading
from binascii import crc_hqx
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from forcebound.cli import main
from forcebound.graph.parts import member_of

DRIVER = str(Path(__file__).parent.parent / "examples/python/my_driver.py")
ANGLE = 0.25  # rad

pytestmark = pytest.mark.live


class PlayedBoard:
    """The program on the microcontroller, on a pseudo-terminal."""

    def __init__(self) -> None:
        self.descriptor, port = os.openpty()
        self.port = os.ttyname(port)
        self._slave = port  # open, so that the terminal outlives its users
        self.torques: list[float] = []
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def end(self) -> list[float]:
        """End when all is read; return the torques."""
        if self._slave >= 0:
            os.close(self._slave)
            self._slave = -1
            self._thread.join()
            os.close(self.descriptor)
        return self.torques

    def _run(self) -> None:
        with suppress(OSError):  # nobody has it open any more
            self._serve()

    def _serve(self) -> None:
        unread = b""
        while data := os.read(self.descriptor, 100):
            unread += data
            while len(unread) >= 7:
                text, checksum, unread = unread[:5], unread[5:7], unread[7:]
                assert crc_hqx(text, 0xFFFF) == int.from_bytes(checksum, "little")
                self.torques.append(struct.unpack("<cf", text)[1])
                reply = struct.pack("<cf", b"A", ANGLE)
                checksum = struct.pack("<H", crc_hqx(reply, 0xFFFF))
                os.write(self.descriptor, reply + checksum)


@pytest.fixture
def board() -> Iterator[PlayedBoard]:
    board = PlayedBoard()
    yield board
    board.end()


def opened(board: PlayedBoard) -> Any:
    model = member_of("device", DRIVER, [f"port:={board.port}", "watchdog_limit:=60 s"])
    return model.open(None, 1.25e-3)


def test_the_example_keeps_the_contract(board: PlayedBoard) -> None:
    words = ["check", "device", DRIVER, f"port:={board.port}", "watchdog_limit:=60 s"]
    result = CliRunner().invoke(main, words, catch_exceptions=False)
    assert result.exit_code == 0, result.output
    assert set(board.end()) == {0.0}


def test_it_reads_at_the_lever_and_writes_torque_that_resists(board: PlayedBoard) -> None:
    device = opened(board)
    assert device.read(0) == pytest.approx((0.05 * ANGLE,))
    assert device.write(0, (1.0,)) == (1.0,)
    assert board.torques[-1] == pytest.approx(-0.05)
    assert device.write(0, (-50.0,)) == (-2.0,)
    assert device.write(0, (math.nan,)) == (0.0,)
    read_ns, effect_ns = device.stamps()
    assert read_ns < effect_ns
    device.close()
    assert board.end()[-1] == 0.0
