"""The driver of the Haply Inverse3 against the emulated service, as a program."""

import time
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from live_graph import PROCESSES_OF_THEIR_OWN, live_graph
from test_emulators_live import program
from waiting import until

from forcebound.errors import DeviceError
from forcebound.haptics.devices.truth_file import SUFFIX, TruthFile
from forcebound.hardware.haply_inverse3 import HaplyInverse3, OpenInverse3
from forcebound.observe.control import resume_device
from forcebound.recordings.recording import read

pytestmark = PROCESSES_OF_THEIR_OWN

PATIENT = "watchdog_limit:=2 s"  # a busy machine ends no test
ALLOWANCE = 0.005  # J, of the launch file
FORCE = (0.3, 0.0, 0.0)  # N
HOLD = 0.0025  # s

STARTS = [("old", r"version 3\.1.*update the"), ("new", r"version 4\.0.*use an older")]
FAULTS = [
    ("stall", "no reply within"),
    ("unplug", "has not the Inverse3 049D|device-disconnected"),
    ("busy", "device-busy"),
    ("malformed", "expected a state of the Haply service"),
    ("foreign", r"has not the Inverse3 049D \(it has 04BA\)"),
    ("doubled", "two replies to one message"),
    ("ebrake", "ebrake_triggered|no longer ready"),
    ("motor_stall", "stall_detected|no longer ready"),
    ("restart:for=3s", "has ended the session"),
]


def device_at(link: Path, limit: float = 2.0) -> HaplyInverse3:
    until(link.is_symlink, "the emulator")
    return HaplyInverse3(port=str(link), watchdog_limit=limit)


def turn(device: OpenInverse3) -> None:
    device.read(0)
    device.write(0, FORCE)
    time.sleep(1e-3)


def turn_for_ever(model: HaplyInverse3) -> None:
    with closing(model.open(None, HOLD)) as device:
        while True:
            turn(device)


@pytest.mark.parametrize(("fault", "said"), FAULTS, ids=[fault for fault, _ in FAULTS])
def test_a_fault_of_the_service_ends_in_zero_force_and_one_sentence(
    tmp_path: Path, fault: str, said: str
) -> None:
    link, (kind, *rest) = tmp_path / "inverse3", fault.split(":")
    options = f"{kind}:{','.join(('at=0.3s', *rest))}"
    words = ("--port", "0", "--no-hand", "--fault", options)
    with program(link, *words, kind="haply_inverse3"):
        model = device_at(link, 0.5)
        truth = TruthFile(Path(f"{link}{SUFFIX}"))
        with pytest.raises(DeviceError, match=said):
            turn_for_ever(model)
        if kind != "busy":  # whose other session goes on
            until(lambda: (found := truth.look()) and not any(found.torque), "zero force")
        truth.close()


@pytest.mark.parametrize(("fault", "said"), STARTS, ids=[fault for fault, _ in STARTS])
def test_a_service_of_another_version_is_refused(tmp_path: Path, fault: str, said: str) -> None:
    link = tmp_path / "inverse3"
    words = ("--port", "0", "--no-hand", "--fault", f"{fault}:at=0s")
    with program(link, *words, kind="haply_inverse3"):
        with pytest.raises(DeviceError, match=said):
            device_at(link).check_here()
        with pytest.raises(DeviceError, match=said):
            device_at(link).open(None, HOLD)


def test_late_replies_are_used_and_a_second_driver_is_refused(tmp_path: Path) -> None:
    link = tmp_path / "inverse3"
    words = ("--port", "0", "--no-hand", "--fault", "late:at=0.2s,for=0.2s")
    with program(link, *words, kind="haply_inverse3"):
        device = device_at(link).open(None, HOLD)
        end = time.monotonic() + 0.6
        while time.monotonic() < end:
            turn(device)
        assert device.exchanges.late > 0
        with pytest.raises(DeviceError, match="driven by another session"):
            device_at(link).open(None, HOLD)
        turn(device)
        device.close()
        again = device_at(link).open(None, HOLD)  # nothing is left of the first
        turn(again)
        again.close()


@pytest.mark.parametrize("attenuates", ["freely", "never"])
def test_the_wall_is_felt_and_the_hand_gets_no_energy(attenuates: str) -> None:
    with live_graph(
        "haply_inverse3", PATIENT, f"attenuates:={attenuates}", is_alone=False
    ) as graph:
        graph.wait_until_engaged()
        graph.wait_for_telemetry(lambda t: t.applied_force[0] > 0.03, "a wall")
        graph.end()
        columns = read(graph.record).telemetry
        assert np.isfinite(columns.true_energy).mean() > 0.5
        assert np.nanmin(columns.true_energy) >= -ALLOWANCE
        deep = columns.applied_force[:, 0] > 0.03
        assert columns.position[deep, 0].min() > 0.0099  # the wall is at 10 mm


def test_a_service_that_was_restarted_serves_again_when_the_user_says_so(tmp_path: Path) -> None:
    link = tmp_path / "inverse3"
    words = ("haply_inverse3", f"device:={link}", PATIENT, "on_loss:=wait")
    with program(link, "--port", "0", kind="haply_inverse3") as service:
        until(link.is_symlink, "the emulator")
        with live_graph(*words, is_alone=False) as graph:
            graph.wait_until_engaged()
            service.kill()
            graph.until(lambda: graph.node("device").state == "lost", "the loss")
            service.wait()
            link.unlink()
            with program(link, "--port", "0", kind="haply_inverse3"):
                until(link.is_symlink, "the emulator")
                resume_device(graph.run_dir)
                graph.wait_for_telemetry(lambda t: t.engagement == 1.0, "an engaged force")
                assert "has ended the session" in graph.log
