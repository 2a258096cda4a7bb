"""The dead-man button: without it no force, which comes back over the ramp."""

from pathlib import Path

import pytest
from fakes import DISSIPATION
from launch_texts import written

from forcebound.errors import ConfigError
from forcebound.graph.loader import load
from forcebound.graph.servo import ServoSettings
from forcebound.lab.replay import device_of
from forcebound.lab.runs import unserved
from forcebound.lab.verification import verify
from forcebound.messages.packets import DeviceState, Event, Telemetry
from forcebound.nodes.device import DeviceNode
from forcebound.recordings.recording import read
from forcebound.run.virtual import run_virtual
from forcebound.testing import Handle, OpenHandle

FILE = """forcebound: 1
description: A hand that lets go of its button.
include: stiff_wall.yaml
device: {{ dead_man: {bit}, engage_time: 0.1 s }}
operator:
  kind: stroking
  mass: 0.2 kg
  stiffness: 300 N/m
  damping: 5 N s/m
  start: 15 mm
  end: 15 mm
  stroke: [0 mm]
  presses: [{{ button: 2, start: 0.1 s, end: 0.5 s }}, {{ button: 2, start: 0.7 s, end: 2 s }}]
"""


def test_force_needs_the_button_and_returns_over_the_ramp(tmp_path: Path) -> None:
    config = load(str(written(tmp_path, FILE.format(bit=2))))
    path = tmp_path / "run.mcap"
    run_virtual(config, 1.0, path)
    recording = read(path)
    down = {
        state.seq: bool((state.buttons or 0) >> 2 & 1)
        for state in recording.packets("device_state")
        if isinstance(state, DeviceState)
    }
    ticks = [packet for packet in recording.packets("telemetry") if isinstance(packet, Telemetry)]
    for tick in ticks:
        if not down[tick.seq]:
            assert tick.commanded_force == tick.applied_force == (0.0,)
            assert tick.device_seq is None
    assert {down[tick.seq] for tick in ticks} == {True, False}
    for start, end in ((0.1, 0.2), (0.7, 0.8)):
        ramp = [t.engagement for t in ticks if start + 0.002 < t.elapsed < end - 0.002]
        assert ramp == sorted(ramp)
        assert ramp[0] < 0.05
        assert ramp[-1] > 0.95
        held = [t.applied_force[0] for t in ticks if end + 0.02 < t.elapsed < end + 0.2]
        assert min(held) > 0.1  # what friction lets the law give a hand at rest in the wall
    faults = [e for e in recording.packets("event") if isinstance(e, Event) and e.is_fault]
    assert faults == []  # a button that is let go is none
    verified = verify(recording, device_of(recording))
    assert verified.is_same
    assert verified.commands > 500


def test_another_button_gives_no_force(tmp_path: Path) -> None:
    config = load(str(written(tmp_path, FILE.format(bit=1))))
    columns = run_virtual(config, 0.5).columns
    assert not columns.applied_force.any()


def test_a_device_without_buttons_is_refused_and_closed() -> None:
    device = OpenHandle(Handle())
    with pytest.raises(ConfigError) as error:
        DeviceNode(device, DISSIPATION, ServoSettings(law="none", dead_man=0))
    assert error.value.field == "dead_man"
    assert device.closed == 1


def test_a_sweep_runs_such_a_case_in_the_graph(tmp_path: Path) -> None:
    with_button = load(str(written(tmp_path, FILE.format(bit=2))))
    without = load(str(written(tmp_path, FILE.format(bit="null"))))
    assert set(unserved(with_button)) - set(unserved(without)) == {"a dead-man button"}
