"""Emulators in virtual time: board, mechanism, hand, faults and truth together."""

import math
import os
import struct
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from test_haply_board import NO_TORQUE, PUSH, SETUP, degrees
from waiting import until

from forcebound.errors import ConfigError, DeviceError
from forcebound.haptics.devices import Truth
from forcebound.haptics.devices.truth_file import NOBODY, TruthFile, truth_beside
from forcebound.haptics.hands.hands import PressingHand
from forcebound.hardware import feetech_frames
from forcebound.hardware.emulators.emulation import Emulation
from forcebound.hardware.emulators.faults import Fault, Faults, parse_fault
from forcebound.hardware.emulators.feetech_bus import GOAL, MODE, TORQUE
from forcebound.hardware.emulators.program import EMULATORS
from forcebound.hardware.emulators.pty import PseudoPort, serve
from forcebound.hardware.feetech import Feetech, OpenFeetechs
from forcebound.hardware.haply_2diy import Haply2DIY
from forcebound.hardware.odrive import ODrive
from forcebound.hardware.servo_requests import orders
from forcebound.stop import Stop

MS = 1_000_000
HAND = PressingHand(mass=0.1, stiffness=200.0, damping=2.0, approach_speed=0.1)


@pytest.fixture
def truth(tmp_path: Path) -> Iterator[TruthFile]:
    file = TruthFile(tmp_path / "port.truth", creates=True)
    yield file
    file.close()


class Client:
    """A client that exchanges once a millisecond."""

    def __init__(
        self,
        truth: TruthFile,
        *faults: Fault,
        hand: PressingHand | None = HAND,
    ):
        parts = EMULATORS["haply_2diy"](Haply2DIY(), hand)
        self.emulation = Emulation(*parts, Faults(faults), truth)
        self.time_ns = 5_000 * MS
        self.emulation.start(self.time_ns)
        self.emulation.step(SETUP, self.time_ns)

    def exchange(self, message: bytes = NO_TORQUE) -> bytes:
        self.time_ns += MS
        reply = self.emulation.step(message, self.time_ns)
        self.emulation.settle(self.time_ns)
        return reply

    def exchange_for(self, seconds: float) -> list[bytes]:
        return [self.exchange() for _ in range(round(seconds * 1000))]


def test_the_hand_carries_the_tip_from_home_to_its_path_and_then_moves(truth: TruthFile) -> None:
    client = Client(truth)
    truth.announce()
    client.exchange_for(2.0)
    found = truth.read()
    assert found is not None
    assert math.dist(found.position, (-0.010, 0.0)) < 1e-3
    truth.engage(client.time_ns)
    client.exchange_for(1.0)
    found = truth.read()
    assert found is not None
    assert math.dist(found.position, (0.014, 0.0)) < 1e-3


def test_the_hand_brings_the_tip_home_when_the_port_is_closed(truth: TruthFile) -> None:
    client = Client(truth)
    client.exchange_for(2.5)
    client.emulation.release(client.time_ns)
    assert truth.engaged_ns == NOBODY
    for _ in range(1500):
        client.exchange(b"")
    home = client.exchange(SETUP + NO_TORQUE)
    found = truth.read()
    assert found is not None
    assert degrees(home) == pytest.approx((11.95, 167.98), abs=0.01)
    assert math.dist(found.position, (0.0, -0.0693)) < 2e-3  # friction holds it short of home


def test_an_arm_that_nobody_holds_is_thrown_into_its_stops_and_put_back(truth: TruthFile) -> None:
    client = Client(truth, hand=None)
    truth.announce()
    home = degrees(client.exchange())
    for torques in ((-0.1, 0.1), (0.1, 0.1)):  # the elbows apart, into a singular pose; both aside
        truth.engage(client.time_ns)
        thrown = b"\2\5" + struct.pack("<2f", *torques)
        for _ in range(100):
            client.exchange(thrown)
        assert degrees(client.exchange()) != home
        truth.announce()
        client.exchange()
        assert degrees(client.exchange()) == home


def test_torque_is_held_when_nobody_speaks(truth: TruthFile) -> None:
    client = Client(truth)
    client.exchange(PUSH)
    since = client.time_ns
    for _ in range(50):
        client.exchange(b"")
    found = truth.look()
    assert found is not None
    assert found.torque == pytest.approx((0.05, -0.02), abs=1e-4)
    assert found.torque_ns == since
    assert client.emulation.longest_hold == pytest.approx(0.050)
    client.exchange()
    for _ in range(100):
        client.exchange(b"")
    assert client.emulation.longest_hold == pytest.approx(0.051)


def test_a_torque_that_does_work_on_the_hand_is_seen_in_the_energy(truth: TruthFile) -> None:
    client = Client(truth)
    for _ in range(10):
        client.exchange()
    for k in range(300):  # to and fro, always with the motion
        torque = math.copysign(0.12, math.sin(2.0 * math.pi * k / 60.0))
        client.exchange(b"\2\5" + struct.pack("<2f", torque, torque))
    assert client.emulation.lowest_energy < -1e-4
    calm = Client(truth)
    calm.exchange_for(0.3)
    assert calm.emulation.lowest_energy == 0.0


@pytest.mark.parametrize(
    ("text", "is_spoiled"),
    [
        ("short:at=10ms", lambda reply: len(reply) == 8),
        ("noise:at=10ms", lambda reply: len(reply) == 9),
        ("nan:at=10ms", lambda reply: all(map(math.isnan, degrees(reply)))),
    ],
)
def test_a_fault_of_a_reply_spoils_one(
    truth: TruthFile, text: str, is_spoiled: Callable[[bytes], bool]
) -> None:
    good = Client(truth).exchange_for(0.02)
    replies = Client(truth, parse_fault(text)).exchange_for(0.02)
    (place,) = [k for k in range(20) if replies[k] != good[k]]
    assert place == 10
    assert is_spoiled(replies[10])


def test_a_fault_of_a_time_spoils_every_reply_in_it(truth: TruthFile) -> None:
    replies = Client(truth, parse_fault("short:at=5ms,for=4ms")).exchange_for(0.02)
    assert [k for k in range(20) if len(replies[k]) == 8] == [5, 6, 7, 8]


def test_a_stall_answers_all_at_its_end(truth: TruthFile) -> None:
    replies = Client(truth, parse_fault("stall:at=5ms,for=4ms")).exchange_for(0.02)
    assert [len(reply) for reply in replies[4:11]] == [9, 0, 0, 0, 0, 45, 9]


@pytest.mark.parametrize(
    "text", ["fire", "short:2s", "short:at=2s,at=3s", "stall:at=-1s", "stall:for=1 N"]
)
def test_what_is_no_fault_is_refused(text: str) -> None:
    with pytest.raises(ConfigError, match=r"fault|expected"):
        parse_fault(text)


def test_the_truth_is_what_was_written(truth: TruthFile, tmp_path: Path) -> None:
    assert truth.look() is None
    written = Truth((1.0, 2.0), (3.0, 4.0), (5.0, 6.0), -7.0)
    truth.write(8, written, (9.0,), 10)
    beside = truth_beside(str(tmp_path / "port"))
    assert beside is not None
    assert beside.look() == (8, written, (9.0,), 10)
    beside.close()


WRITER = """
import sys
from pathlib import Path
from forcebound.haptics.devices import Truth
from forcebound.haptics.devices.truth_file import TruthFile

truth = TruthFile(Path(sys.argv[1]))
k = 0.0
while True:
    k += 1.0
    truth.write(int(k), Truth((k, k), (k, k), (k, k), k), (k,), int(k))
"""


def test_the_truth_is_whole_and_never_missing_while_an_emulator_writes(
    truth: TruthFile, tmp_path: Path
) -> None:
    writer = subprocess.Popen([sys.executable, "-c", WRITER, str(tmp_path / "port.truth")])
    try:
        until(truth.look, "the first record")
        for _ in range(20_000):
            found = truth.look()
            assert found is not None
            numbers = {*found.truth.position, found.truth.energy, *found.torque}
            assert numbers == {float(found.time_ns)}
    finally:
        writer.kill()
        writer.wait()


def test_a_file_of_somebody_else_is_no_truth(tmp_path: Path) -> None:
    other = tmp_path / "port.truth"
    other.write_bytes(bytes(1000))
    with pytest.raises(DeviceError, match="no file of an emulator"):
        TruthFile(other)
    assert truth_beside(str(tmp_path / "port")) is None
    assert truth_beside(str(tmp_path / "none")) is None


def test_a_port_in_a_folder_that_is_not_there_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"board.truth: there is no folder .*nowhere"):
        PseudoPort(tmp_path / "nowhere" / "board")


def test_an_emulator_that_nobody_uses_ends_only_when_the_last_order_has_acted(
    tmp_path: Path,
) -> None:
    model = Feetech()
    zero, _ = OpenFeetechs.rest(model)
    on = [(MODE, {1: b"\2"}), (TORQUE, {1: b"\1"}), (GOAL, {1: b"\xff\0"})]
    with PseudoPort(tmp_path / "bus") as port, Stop() as stop:
        port.show(port.name)
        board, mechanism = EMULATORS["feetech"](model, None)
        emulation = Emulation(board, mechanism, Faults(()), port.truth)
        emulation.start(time.monotonic_ns())
        user = os.open(port.name, os.O_RDWR | os.O_NOCTTY)
        os.write(user, orders(feetech_frames, on) + feetech_frames.read(1, TORQUE, 1))
        while not (any(mechanism.torque) and emulation.replies):
            emulation.step(port.read(), time.monotonic_ns())
        os.write(user, zero)
        os.close(user)
        serve(emulation, port, stop, until_unused=True)
        assert not any(mechanism.torque)


def test_a_board_that_is_reset_keeps_its_torque_and_gives_no_angles(truth: TruthFile) -> None:
    client = Client(truth, parse_fault("reset:at=2ms"))
    replies = [client.exchange(PUSH) for _ in range(3)]
    assert [len(reply) for reply in replies] == [9, 9, 1]
    client.exchange(NO_TORQUE)
    found = truth.look()
    assert found is not None
    assert found.torque == pytest.approx((0.05, -0.02), abs=1e-4)


def test_an_odrive_that_is_reset_gives_no_torque() -> None:
    board, _ = EMULATORS["odrive"](ODrive(), None)
    start = b"w axis0.controller.config.control_mode 1\nw axis0.requested_state 8\n"
    board.receive(start + b"w axis0.controller.config.enable_torque_mode_vel_limit 0\n", 0)
    board.receive(b"c 0 0.1\n", 10 * MS)
    assert board.torque == pytest.approx((0.1,))
    board.reset()
    board.receive(b"c 0 0.1\n", 20 * MS)
    assert board.torque == (0.0,)
