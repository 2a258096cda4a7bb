"""A live graph with an emulated serial device: the wall, the energy, the device's death."""

import signal
from pathlib import Path

import numpy as np
import pytest
from live_graph import PROCESSES_OF_THEIR_OWN, live_graph
from test_emulators_live import program
from waiting import PATIENCE, until

from forcebound.devices.truth_file import TruthFile
from forcebound.recording import read

pytestmark = PROCESSES_OF_THEIR_OWN

# A pseudo-terminal passes bytes on by an ordinary process of the kernel, which a busy machine lets
# wait; so that this ends no test, a board may be silent for longer.
PATIENT = "watchdog_limit:=2 s"


@pytest.mark.parametrize(
    ("launch_file", "allowance"), [("haply_2diy", 0.0), ("odrive_knob", 0.005)]
)
def test_when_the_device_process_is_killed_in_contact_the_torque_becomes_zero(
    launch_file: str, allowance: float
) -> None:
    with live_graph(launch_file, PATIENT, is_alone=False) as graph:
        graph.until(lambda: list(graph.runtime.glob("*.truth")), "the emulator")
        (path,) = graph.runtime.glob("*.truth")
        truth = TruthFile(path)
        graph.until(lambda: (found := truth.look()) is not None and any(found.torque), "a wall")
        graph.signal("device", signal.SIGKILL)
        until(lambda: (found := truth.look()) is not None and not any(found.torque), "zero torque")
        truth.close()
        graph.process.wait(PATIENCE)
        assert graph.process.returncode == 1, graph.log
        columns = read(graph.record).telemetry
        assert columns.applied_force.any()
        # A tick has no truth where the emulator was just writing it.
        assert np.isfinite(columns.true_energy).mean() > 0.5
        assert np.nanmin(columns.true_energy) >= -allowance


def test_an_emulator_of_its_own_that_is_unplugged_ends_the_graph_in_order(tmp_path: Path) -> None:
    link = tmp_path / "board"
    with program(link, "--fault", "unplug") as emulator:
        until(link.exists, "the port")
        with live_graph("haply_2diy", f"device:={link}", PATIENT, is_alone=False) as graph:
            graph.process.wait(PATIENCE)
            assert graph.process.returncode == 1
            assert "unplugged" in graph.log, graph.log
            assert "Traceback" not in graph.log
        emulator.communicate()
        assert emulator.returncode == 0
