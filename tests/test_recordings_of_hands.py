"""Recordings of two hands: verified, read by channel, drawn."""

from pathlib import Path

import pytest
from invoking import invoke
from launch_texts import written

from forcebound.errors import ConfigError
from forcebound.graph.loader import load
from forcebound.messages.packets import Telemetry
from forcebound.recordings.recording import Recording, read
from forcebound.results.panels import signal_panels
from forcebound.results.signals import curves_of
from forcebound.run.virtual import run_virtual_hands

RAIL = """\
from dataclasses import dataclass

from forcebound.haptics.devices.phantom import PhantomPremium15


@dataclass(frozen=True, kw_only=True)
class Rail(PhantomPremium15):
    lengths: tuple[float, ...] = (0.1, 0.2)
"""
PAIR = """\
forcebound: 1
include: leader_follower_transfer.yaml
hands:
  default: { device: { kind: rail.py, damping: 0.3 N s/m, friction: [0.1 N], lengths: [1, 2] } }
  leader: { device: { energy_partner: follower } }
  follower: { device: { energy_partner: leader, force_sensor: false } }
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the recording pair.mcap of two hands on a device of the user's own."""
    path: Path = tmp_path_factory.mktemp("pair")
    written(path, RAIL, "rail.py")
    run_virtual_hands(load(written(path, PAIR)), 0.3, path / "pair.mcap")
    return path


@pytest.fixture
def recording(folder: Path) -> Recording:
    return read(folder / "pair.mcap")


def test_a_device_of_ones_own_is_verified_with_its_recorded_numbers(folder: Path) -> None:
    run = str(folder / "pair.mcap")
    refused = invoke("replay", run, "--verify")
    assert refused.exit_code == 2
    assert "device:=FILE.py" in refused.stderr
    done = invoke("replay", run, "--verify", f"device:={folder / 'rail.py'}")
    assert done.exit_code == 0
    assert done.output.count("300 of 300 ticks, 0 differ") == 2


def test_what_is_not_as_recorded_is_named_of_its_hand_alone(folder: Path) -> None:
    own = f"device:={folder / 'rail.py'}"
    other = ("replay", str(folder / "pair.mcap"), "--verify", own, "leader.device.damping:=0.29")
    done = invoke(*other)
    assert done.exit_code == 1
    leader, follower = done.output.split("follower:")
    assert "300 differ" in leader
    assert "not as recorded: device.damping" in leader
    assert "0 differ" in follower
    assert "not as recorded" not in follower
    done = invoke(*other, "lead.device.damping:=0.29")
    assert done.exit_code == 2
    assert "'leader'" in done.stderr


def test_a_replay_of_a_device_of_ones_own_has_its_recorded_numbers(folder: Path) -> None:
    own = [f"{hand}.device:={folder / 'rail.py'}" for hand in ("leader", "follower")]
    again = folder / "again.mcap"
    assert invoke("replay", str(folder / "pair.mcap"), *own, "--record", str(again)).exit_code == 0
    for hand in ("leader", "follower"):
        old, new = (read(path, hand=hand) for path in (folder / "pair.mcap", again))
        assert new.launch["device"] == old.launch["device"]
        assert new.packets("telemetry") == old.packets("telemetry")


def test_packets_are_read_by_the_name_of_their_channel(recording: Recording) -> None:
    for name in ("leader/telemetry", "/leader/telemetry"):
        packets = recording.packets(name)
        assert len(packets) == 300
        assert all(isinstance(one, Telemetry) and one.hand == "leader" for one in packets)
    for wrong in ("nobody/telemetry", "leader/telemetri"):
        with pytest.raises(ConfigError, match=r"there are .*telemetry"):
            recording.packets(wrong)


def test_hands_stand_in_the_order_of_the_file_and_empty_signals_nowhere(
    recording: Recording, folder: Path
) -> None:
    assert recording.hands == ("leader", "follower")
    curves = [curve for one in recording.by_hand.values() for curve in curves_of(one)]
    assert {curve.about.unit for curve in curves} == {"m", "N"}
    assert [*signal_panels(curves)] == ["signals m"]  # there is no force sensor
    done = invoke("plot", str(folder / "pair.mcap"), "-o", str(folder / "pair.png"))
    assert done.output.index("leader: certified") < done.output.index("follower: certified")
    assert "against" not in done.output  # two hands of a run are no two runs


def test_a_recorded_leader_moves_the_hand_of_another_launch_file(folder: Path) -> None:
    run, again = folder / "pair.mcap", folder / "onto.mcap"
    words = ("replay", run, "--hand", "leader", "--onto")
    assert invoke(*words, "three_axes", "--record", again).exit_code == 0
    old, new = read(run, hand="leader").telemetry, read(again).telemetry
    count = min(len(old.time), len(new.time))
    before, now = old.position[:count, 0], new.position[:count, 0]
    is_free = before < 0.009  # m; the solid of the other file begins at 10 mm
    assert before[is_free].max() > 0.008
    assert now[is_free] == pytest.approx(before[is_free], abs=2e-3)


def test_a_replay_onto_what_no_simulated_hand_moves_is_refused(folder: Path) -> None:
    run = folder / "pair.mcap"
    for words in (
        ("--onto", "three_axes"),  # whose hand of the recording?
        ("--hand", "leader", "--onto", "leader_follower"),  # whose of the launch file?
        ("--hand", "leader", "--onto", "haply_inverse3"),
        ("--hand", "leader", "--onto", "stiff_wall", "--network"),
    ):
        assert invoke("replay", run, *words).exit_code == 2
