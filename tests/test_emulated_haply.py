"""The driver of the Haply 2DIY on the emulated board, in virtual time."""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal

import pytest

from forcebound.errors import DeviceError
from forcebound.graph.loader import load
from forcebound.graph.servo import dissipation_of
from forcebound.haptics.devices.truth_file import TruthFile
from forcebound.haptics.hands.hands import PressingHand
from forcebound.haptics.laws import ForceBounder
from forcebound.hardware.emulators.emulation import Emulation
from forcebound.hardware.emulators.faults import Faults, parse_fault
from forcebound.hardware.emulators.program import EMULATORS
from forcebound.hardware.hapi import WIRINGS, rest_message
from forcebound.hardware.haply_2diy import Haply2DIY, OpenHaply

ROUND_TRIP_NS = 100_000
PERIOD_NS = 1_000_000
HAND = PressingHand(mass=0.1, stiffness=200.0, damping=2.0, approach_speed=0.1)
SURFACE, STIFFNESS = 0.010, 2000.0  # m, N/m


class EmulatedLine:
    """A :class:`forcebound.hardware.line.Line` to an emulation; also its own port and clock."""

    silence = 0.01  # s
    is_at_rest = False

    def __init__(self, model: Haply2DIY, truth: TruthFile, *faults: str) -> None:
        self.port = self
        self.truth = truth
        self.time_ns = 1_000_000_000
        self.failures: list[DeviceError] = []
        planned = Faults([parse_fault(text) for text in faults])
        self.emulation = Emulation(*EMULATORS["haply_2diy"](model, HAND), planned, truth)
        self.emulation.start(self.time_ns)
        self._sent = b""
        self.lost: int | None = None  # place of a byte of the next message
        self._rest = rest_message(model.address, WIRINGS[model.version])

    def clock(self) -> int:
        return self.time_ns

    def wait_until(self, time_ns: int) -> None:
        while self.time_ns < time_ns:
            self.time_ns = min(self.time_ns + PERIOD_NS, time_ns)
            self.emulation.step(b"", self.time_ns)
            self.emulation.settle(self.time_ns)

    def send(self, message: bytes, has_force: bool) -> None:
        if self.failures:
            raise self.failures[0]
        self.time_ns += ROUND_TRIP_NS // 2
        if self.lost is not None:
            message, self.lost = message[: self.lost] + message[self.lost + 1 :], None
        self._sent += self.emulation.step(message, self.time_ns)
        self.emulation.settle(self.time_ns)

    def drain(self) -> bytes:
        sent, self._sent = self._sent, b""
        return sent

    def read(self, count: int, deadline_ns: int) -> bytes:
        data, self._sent = self._sent[:count], self._sent[count:]
        self.time_ns = deadline_ns if len(data) < count else self.time_ns + ROUND_TRIP_NS // 2
        return data

    def fail(self, failure: DeviceError) -> None:
        self.failures.append(failure)
        self.emulation.step(self._rest, self.time_ns)
        self.emulation.settle(self.time_ns)

    def close(self) -> None:
        self.truth.close()


@pytest.fixture
def truth(tmp_path: Path) -> Iterator[TruthFile]:
    file = TruthFile(tmp_path / "port.truth", creates=True)
    yield file
    file.close()


def opened(model: Haply2DIY, truth: TruthFile, *faults: str) -> tuple[OpenHaply, EmulatedLine]:
    line: Any = EmulatedLine(model, truth, *faults)
    return OpenHaply(model, line, line.clock), line


@pytest.mark.parametrize("version", [2, 3])
def test_the_driver_knows_where_the_tip_is_and_turns_the_motors_its_way(
    truth: TruthFile, version: Literal[2, 3]
) -> None:
    device, line = opened(Haply2DIY(version=version), truth)
    line.wait_until(line.time_ns + 1_500 * PERIOD_NS)  # the hand brings the tip to its path
    reading = device.read(0)
    resists = device.write(0, (0.02, -0.03))
    found = truth.look()
    assert found is not None
    assert found.torque == pytest.approx([-torque for torque in resists], abs=1e-9)
    assert math.dist(found.truth.position, device.kinematics.position(reading)) < 1e-4


def test_a_bounded_wall_gives_the_hand_nothing_by_the_emulators_truth(truth: TruthFile) -> None:
    model = Haply2DIY()
    device, line = opened(model, truth)
    bounder = ForceBounder("certified", dissipation_of(model, load("haply_2diy").only.servo), 2)
    bounder.start(device.stamps()[0], device.read(0))
    truth.announce()
    truth.engage(line.time_ns)
    forces, energies = [], []
    for _ in range(2500):
        angles = device.read(0)
        tip = device.kinematics.position(angles)
        force = STIFFNESS * max(tip[0] - SURFACE, 0.0), 0.0
        bounded = bounder.bound(device.stamps()[0], angles, device.kinematics.torque(angles, force))
        applied = device.write(0, bounded)
        bounder.settle(applied, device.stamps()[1])
        forces.append(math.hypot(*applied))
        found = truth.read()
        assert found is not None
        energies.append(found.energy)
        line.wait_until(line.time_ns + PERIOD_NS - 2 * ROUND_TRIP_NS)
    assert max(forces) > 0.01
    assert min(energies) >= 0.0


@pytest.mark.parametrize("fault", ["short", "nan", "stall", "lost"])
def test_a_fault_ends_in_a_device_error(truth: TruthFile, fault: str) -> None:
    device, _ = opened(Haply2DIY(), truth, f"{fault}:at=50ms")
    with pytest.raises(DeviceError):
        read_for_ever(device)


def read_for_ever(device: OpenHaply) -> None:
    while True:
        device.read(0)


@pytest.mark.parametrize("place", range(10))
def test_a_torque_ends_in_time_wherever_a_byte_is_lost(truth: TruthFile, place: int) -> None:
    force = (-0.11, 0.11)
    device, line = opened(Haply2DIY(port="auto"), truth)
    line.wait_until(line.time_ns + 1_500 * PERIOD_NS)  # the hand brings the tip to its path
    device.read(0)
    device.write(0, force)
    since, line.lost = line.time_ns, place
    with pytest.raises(DeviceError):
        device.write(0, force)
    found = truth.look()
    assert found is not None
    assert found.torque == (0.0, 0.0)
    assert found.torque_ns - since <= 1e9 * Haply2DIY(port="auto").longest_force


def test_a_board_that_was_reset_is_named(truth: TruthFile) -> None:
    device, _ = opened(Haply2DIY(), truth, "reset:at=50ms")
    with pytest.raises(DeviceError, match="the board was reset"):
        read_for_ever(device)
