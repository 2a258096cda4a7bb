"""A live graph with an emulated serial device: the wall, the energy, the device's death."""

import os
import signal
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from invoking import invoke
from live_graph import PROCESSES_OF_THEIR_OWN, live_graph
from waiting import until

from forcebound.haptics.devices.truth_file import TruthFile
from forcebound.observe.control import resume_device
from forcebound.recordings.recording import read

pytestmark = PROCESSES_OF_THEIR_OWN

# A pseudo-terminal passes bytes on by an ordinary process of the kernel, which a busy machine lets
# wait; so that this ends no test, a board may be silent for longer.
PATIENT = "watchdog_limit:=2 s"


@pytest.mark.parametrize(
    ("launch_file", "allowance"),
    [
        ("haply_2diy", 0.015),
        ("odrive_knob", 0.010),
        ("haply_inverse3", 0.005),
        ("dynamixel_arm", 0.010),
        ("feetech_arm", 0.010),
    ],
)
def test_when_the_device_process_is_killed_in_contact_the_torque_becomes_zero(
    launch_file: str, allowance: float
) -> None:
    with live_graph(launch_file, PATIENT, is_alone=False) as graph:
        graph.until(lambda: list(graph.runtime.glob("*.truth")), "the emulator")
        (path,) = graph.runtime.glob("*.truth")
        with closing(TruthFile(path)) as truth:

            def has_torque() -> bool | None:
                return None if (found := truth.look()) is None else any(found.torque)

            graph.until(has_torque, "a wall")
            graph.signal("device", signal.SIGKILL)
            until(lambda: has_torque() is False, "zero torque")
        status, _ = graph.outcome()
        assert status == 1, graph.log
        columns = read(graph.record).telemetry
        assert columns.applied_force.any()
        assert np.isfinite(columns.true_energy).all()
        assert columns.true_energy.min() >= -allowance
        assert ", 0 differ\n" in invoke("replay", graph.record, "--verify").output  # motor's steps


def started_by(device: int) -> dict[str, int]:
    """Process ids of the guardian and the emulator of a device process."""
    children = Path(f"/proc/{device}/task/{device}/children").read_text().split()
    commands = {int(child): Path(f"/proc/{child}/cmdline").read_bytes() for child in children}
    names = {"guardian": b"guardian_process", "emulator": b"emulate"}
    return {
        name: child for name, word in names.items() for child in commands if word in commands[child]
    }


def is_running(pid: int) -> bool:
    try:
        status = Path(f"/proc/{pid}/stat").read_text()
    except FileNotFoundError:
        return False
    return status.rpartition(")")[2].split()[0] != "Z"


def test_without_its_guardian_a_force_waits_for_the_user_and_nothing_outlives_the_launcher() -> (
    None
):
    with live_graph("haply_2diy", PATIENT, is_alone=False) as graph:
        graph.wait_until_engaged()
        first = graph.pid("device")
        os.kill(started_by(first)["guardian"], signal.SIGSTOP)
        graph.until(lambda: graph.node("device").state == "lost", "the loss")
        resume_device(graph.run_dir)
        graph.wait_for_telemetry(lambda t: t.engagement == 1.0, "an engaged force")
        second = graph.pid("device")
        started = started_by(second)
        assert set(started) == {"guardian", "emulator"}
        for pid in started.values():
            os.kill(pid, signal.SIGSTOP)
        os.kill(second, signal.SIGKILL)  # nobody writes zero, or ends what it has started
        graph.outcome()
        assert graph.log.count("the guardian of the port is silent") == 1
        assert not [pid for pid in (first, second, *started.values()) if is_running(pid)]
