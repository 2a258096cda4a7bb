"""Emulated buses of servos as programs: the makers' clients and our drivers at a real port."""

import json
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, closing, contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import dynamixel_sdk
import numpy as np
import pytest
import scservo_sdk
from live_graph import live_graph
from waiting import TIMEOUT, until

from forcebound.errors import DeviceError
from forcebound.graph.graph import HandConfig
from forcebound.graph.loader import load
from forcebound.graph.resolved import part_document
from forcebound.haptics.devices import Device
from forcebound.haptics.devices.truth_file import SUFFIX, TruthFile
from forcebound.hardware.dynamixel import Dynamixel
from forcebound.hardware.feetech import Feetech
from forcebound.hardware.servo_bus import ServoBus
from forcebound.recordings.recording import read

pytestmark = pytest.mark.live

# A busy machine lets an answer wait; so that this ends no test, a servo may be silent for longer.
MODELS: dict[str, ServoBus] = {
    "dynamixel": Dynamixel(watchdog_limit=1.0),
    "feetech": Feetech(watchdog_limit=1.0),
}
PATIENT = "watchdog_limit:=1 s"
HOLD = 1.0  # s, likewise
TORQUE = -0.1  # N m, of each joint
ON_DEMAND = Path(__file__).parent / "emulate_on_demand.py"


@contextmanager
def emulated(
    kind: str,
    folder: Path,
    *faults: str,
    hand: HandConfig | None = None,
    demand: Path | None = None,
) -> Iterator[tuple[str, TruthFile]]:
    """Start an emulator of six servos, in a hand or held by nobody; its port, and the truth.

    The time of its faults begins with the first reply, or with the first after ``demand`` exists.
    """
    document = {"device": part_document("device", MODELS[kind]), "operator": None}
    if hand is not None:
        document["device"] = part_document("device", hand.device)
        document["operator"] = part_document("operator", hand.operator)
    (folder / "parts").write_text(json.dumps(document))
    link = folder / "bus"
    program = ["-m", "forcebound"] if demand is None else [str(ON_DEMAND), str(demand)]
    command = [sys.executable, *program, "emulate", kind, "--link", str(link)]
    command += ["--parts", str(folder / "parts")]
    for fault in faults:
        command += ["--fault", fault]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL) as process:
        try:
            until(link.is_symlink, "the port")
            with closing(TruthFile(Path(f"{link}{SUFFIX}"))) as truth:
                yield str(link), truth
        finally:
            process.kill()


def torque(truth: TruthFile) -> tuple[float, ...]:
    found = truth.look()
    assert found is not None
    return found.torque


def has_torque(truth: TruthFile) -> bool:
    return any(torque(truth))


def until_at_rest(truth: TruthFile) -> None:
    until(lambda: not has_torque(truth), "no torque")


@pytest.fixture
def unhurried(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the makers' clients wait for long: theirs is 34 ms, and a busy machine takes longer."""
    for kind in (dynamixel_sdk.PortHandler, scservo_sdk.PortHandler):
        monkeypatch.setattr(
            kind, "setPacketTimeout", lambda port, _: port.setPacketTimeoutMillis(5e3)
        )


@pytest.mark.usefixtures("unhurried")
def test_the_makers_client_drives_dynamixels_at_a_port(tmp_path: Path) -> None:
    with emulated("dynamixel", tmp_path) as (link, truth):
        port, packets = dynamixel_sdk.PortHandler(link), dynamixel_sdk.PacketHandler(2.0)
        assert port.openPort()
        for address, value in ((9, 0), (11, 0), (64, 1)):
            result = packets.write1ByteTxRx(port, 3, address, value)
            assert result == (dynamixel_sdk.COMM_SUCCESS, 0)
        assert packets.write2ByteTxRx(port, 3, 102, 300) == (dynamixel_sdk.COMM_SUCCESS, 0)
        until(lambda: any(torque(truth)), "a torque")
        group = dynamixel_sdk.GroupSyncRead(port, packets, 126, 10)
        for servo in range(1, 7):
            group.addParam(servo)
        assert group.txRxPacket() == dynamixel_sdk.COMM_SUCCESS
        assert [group.getData(servo, 126, 2) for servo in range(1, 7)] == [0, 0, 300, 0, 0, 0]
        port.closePort()


@pytest.mark.usefixtures("unhurried")
def test_the_makers_client_drives_feetech_servos_at_a_port(tmp_path: Path) -> None:
    with emulated("feetech", tmp_path) as (link, truth):
        port: Any = scservo_sdk.PortHandler(link)
        packets = scservo_sdk.PacketHandler(0)
        assert port.openPort()
        for address, value in ((7, 0), (33, 2), (40, 1)):
            result = packets.write1ByteTxRx(port, 3, address, value)
            assert result == (scservo_sdk.COMM_SUCCESS, 0)
        writes = scservo_sdk.GroupSyncWrite(port, packets, 44, 2)
        writes.addParam(3, [100, 0])
        assert writes.txPacket() == scservo_sdk.COMM_SUCCESS
        until(lambda: any(torque(truth)), "a torque")
        group = scservo_sdk.GroupSyncRead(port, packets, 60, 2)
        for servo in range(1, 7):
            group.addParam(servo)
        assert group.txRxPacket() == scservo_sdk.COMM_SUCCESS
        assert [group.getData(servo, 60, 2) for servo in range(1, 7)] == [0, 0, 100, 0, 0, 0]
        port.closePort()


#: A fault of the third servo, and what is left of the torque at the end.
OF_THIRD = ("silent", "checksum", "overload", "cut")


@pytest.mark.parametrize(
    ("kind", "fault"),
    [
        *((kind, f"{fault}:at=1500ms,servo=3") for kind in MODELS for fault in OF_THIRD),
        ("dynamixel", "watchdog:at=1500ms,servo=3"),
        *(
            (kind, f"{fault}:at=1500ms")
            for kind in MODELS
            for fault in ("voltage", "reset", "short")
        ),
    ],
)
def test_a_fault_ends_in_no_torque_and_one_error_that_names_the_servo(
    tmp_path: Path, kind: str, fault: str
) -> None:
    opened: list[Device] = []  # none, if on a busy machine the fault comes before
    with emulated(kind, tmp_path, fault) as (link, truth):
        with pytest.raises(DeviceError) as failure:
            drive(replace(MODELS[kind], port=link), opened)
        until_at_rest(truth)
        named = "servo 3 (elbow)" if "servo=3" in fault else "servo "
        assert named in str(failure.value)
        for device in opened:
            with pytest.raises(DeviceError) as again:
                device.read(time.monotonic_ns())
            assert str(again.value) == str(failure.value)
            device.close()
        assert not any(torque(truth))


def drive(model: ServoBus, opened: list[Device]) -> None:
    """Open the device, put it into a list, and write a torque until it fails."""
    device = model.open(None, HOLD)
    opened.append(device)
    device.engage(time.monotonic_ns())
    end = time.monotonic() + TIMEOUT
    while time.monotonic() < end:
        device.read(time.monotonic_ns())
        device.write(time.monotonic_ns(), (TORQUE,) * 6)


#: Of the arms of servo_arms: which one fails, how, and what the error names.
FAILURES = [
    ("leader", "silent:at=0s,servo=3", "servo 3 (elbow)"),
    ("follower", "cut:at=0s,servo=2", "servo 2 (shoulder)"),
    ("follower", "overload:at=0s,servo=1", "servo 1 (base)"),
]


@pytest.mark.xdist_group("processes")
@pytest.mark.no_cover
@pytest.mark.parametrize(("hand", "fault", "named"), FAILURES)
def test_a_fault_of_an_arm_takes_the_force_of_both_and_is_named_once(
    tmp_path: Path, hand: str, fault: str, named: str
) -> None:
    config = load("servo_arms", [PATIENT])
    demand = tmp_path / "demand"
    with ExitStack() as stack:
        truths, ports = {}, []
        for name, each in config.hands.items():
            folder = tmp_path / name
            folder.mkdir()
            faults = (fault,) if name == hand else ()
            device = emulated("dynamixel", folder, *faults, hand=each, demand=demand)
            link, truths[name] = stack.enter_context(device)
            ports.append(f"{name}:={link}")
        graph = stack.enter_context(live_graph("servo_arms", PATIENT, *ports, is_alone=False))
        for name, truth in truths.items():
            graph.until(partial(has_torque, truth), f"a force on the {name}")
        demand.touch()
        status, _ = graph.outcome()
        assert status == 1, graph.log
        assert graph.log.count(f"[{hand}/device] forcebound: ") == 1, graph.log
        assert named in graph.log
        for truth in truths.values():
            until_at_rest(truth)
        recording = read(graph.record)
        assert recording.complete
        lowest = 0.0
        for name in config.hands:
            columns = recording.by_hand[name].telemetry
            assert columns.applied_force.any()
            assert np.isfinite(columns.true_energy).all()
            lowest += columns.true_energy.min()
        assert lowest >= -sum(each.servo.allowance for each in config.hands.values())
