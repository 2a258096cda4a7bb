"""A live graph with an emulated ODrive."""

import signal

import pytest
from live_graph import live_graph
from waiting import until

from forcebound.devices.truth_file import TruthFile
from forcebound.recording import read

pytestmark = pytest.mark.live


def test_a_knob_feels_a_wall_and_is_free_when_the_device_process_is_killed() -> None:
    # A busy machine lets the board and the process wait.
    with live_graph("odrive_knob", "watchdog_limit:=400 ms", is_alone=False) as graph:
        graph.until(lambda: list(graph.runtime.glob("*.truth")), "the emulator")
        (path,) = graph.runtime.glob("*.truth")
        truth = TruthFile(path)
        graph.until(lambda: (found := truth.look()) is not None and any(found.torque), "a wall")
        graph.signal("device", signal.SIGKILL)
        until(lambda: (found := truth.look()) is not None and not any(found.torque), "zero torque")
        truth.close()
        graph.process.wait()
        assert graph.process.returncode == 1, graph.log
        columns = read(graph.record).telemetry
        assert columns.applied_force.any()
        assert columns.true_energy.min() >= -0.005  # the allowance of the launch file
