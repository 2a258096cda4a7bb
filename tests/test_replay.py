"""Recordings once more: verified to the bit, and run with other parts."""

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import replace as with_fields
from pathlib import Path
from typing import Any

import pytest
from builders import telemetry_packet
from fakes import answer
from invoking import invoke
from msgspec.structs import replace

from forcebound.errors import ConfigError
from forcebound.graph.graph import HandConfig
from forcebound.graph.loader import load
from forcebound.graph.servo import ServoSettings, dissipation_of
from forcebound.haptics.hands.paths import TrajectoryHand
from forcebound.lab.replay import device_of, graph_of
from forcebound.lab.verification import Verified, verify
from forcebound.messages.packets import TOPICS, DeviceState, Packet, Telemetry, Vector
from forcebound.messages.topology import ONE_HAND
from forcebound.nodes.device import DeviceNode
from forcebound.recordings.recording import Recorder, read
from forcebound.run.build import build_device, build_node
from forcebound.run.results import run_metadata
from forcebound.run.simulation import LateTicks, Simulation
from forcebound.run.virtual import run_virtual
from forcebound.testing import Handle, OpenHandle


def recorded(path: Path, *words: str, duration: float = 0.3) -> Path:
    """Return the recording of a run in virtual time; ``words``: launch file and arguments."""
    run_virtual(load(words[0], words[1:]), duration, path)
    return path


def verified(path: Path) -> Verified:
    recording = read(path)
    return verify(recording, device_of(recording))


def changed(path: Path, change: Mapping[int, Mapping[str, object]], drop: range = range(0)) -> Path:
    """Write a recording with other fields in some ticks, and without others."""
    recording = read(path)
    packets = list(recording.stream(*TOPICS))
    with Recorder(path, recording.metadata) as recorder:
        for packet in packets:
            is_telemetry = isinstance(packet, Telemetry)
            if is_telemetry and packet.seq in drop:
                continue
            fields = change.get(packet.seq, {}) if is_telemetry else {}
            recorder.write(replace(packet, **fields))
    return path


def rewritten(path: Path, launch: dict[str, Any]) -> Path:
    """Write a recording with another launch file, and no packets."""
    Recorder(path, {"launch": json.dumps(launch)}).close()
    return path


def telemetry(path: Path) -> list[Telemetry]:
    return [packet for packet in read(path).packets("telemetry") if isinstance(packet, Telemetry)]


# --- Verification --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "words",
    [
        ("stiff_wall", "law:=certified", "delay:=5ms"),
        ("stiff_wall", "law:=tdpa", "delay:=5ms"),
        ("stiff_wall", "law:=none"),
        ("five_bar_wall",),  # an arm: its readings are angles
        ("three_axes",),
        ("stress",),  # late ticks, a watchdog
    ],
    ids=" ".join,
)
def test_recorded_inputs_give_the_recorded_forces_to_the_bit(
    tmp_path: Path, words: tuple[str, ...]
) -> None:
    found = verified(recorded(tmp_path / "run.mcap", *words))
    assert found.is_same
    assert found.ticks == found.verified > 250
    assert found.commands > 250
    assert found.unknown_commands == 0


@pytest.mark.parametrize("watchdog", ["silent", "reporting", "guarding", "none"])
def test_late_ticks_and_a_watchdog_s_cuts_are_heard_again(tmp_path: Path, watchdog: str) -> None:
    path = tmp_path / "run.mcap"
    config = load("stiff_wall")
    model: Any = config.only.device
    limit = 5e-3 if watchdog == "none" else "auto"
    model = with_fields(model, watchdog=watchdog, watchdog_limit=limit, hand_speed=None)
    config = config.with_hand(device=model)
    run_virtual(config, 0.6, path, late_ticks=LateTicks(rate=40.0))
    assert verified(path).is_same
    cuts = [p for p in read(path).packets("telemetry") if getattr(p, "cut_ns", None) is not None]
    assert bool(cuts) == (watchdog in ("reporting", "guarding"))
    if watchdog == "reporting":
        changed(path, {packet.seq: {"cut_ns": None} for packet in cuts})
        assert not verified(path).is_same


@pytest.mark.parametrize(
    ("tick", "field", "value"),
    [
        (280, "applied_force", lambda force: (math.nextafter(force[0], 0.0),)),
        (200, "position", lambda position: (position[0] + 1e-5,)),
        (250, "force_limit", lambda limit: math.nextafter(limit, 0.0)),
        (280, "read_ns", lambda at: at + 10_000),
    ],
)
def test_a_change_of_one_bit_is_found(
    tmp_path: Path, tick: int, field: str, value: Callable[[Any], Any]
) -> None:
    words = "stiff_wall", "delay:=5ms", "device.hand_speed:=null"
    path = recorded(tmp_path / "run.mcap", *words)
    packet = read(path).packets("telemetry")[tick]
    changed(path, {tick: {field: value(getattr(packet, field))}})
    found = verified(path)
    assert found.differing
    assert not found.is_same
    assert found.difference.startswith("tick 2")


def test_another_law_gives_other_forces(tmp_path: Path) -> None:
    path = recorded(tmp_path / "run.mcap", "stiff_wall", "delay:=5ms")
    same = invoke("replay", path, "--verify")
    assert (same.exit_code, "verified: 300 of 300 ticks, 0 differ" in same.stdout) == (0, True)
    other = invoke("replay", path, "law:=tdpa", "--verify", "--json")
    assert other.exit_code == 1
    document = json.loads(other.stdout)
    assert document["differing"] > 100
    assert not document["is_same"]


def test_a_recording_without_its_first_ticks_is_verified_in_full(
    tmp_path: Path,
) -> None:
    path, config = tmp_path / "run.mcap", load("stiff_wall")
    device = build_device(config.only)
    others = [build_node(kind, config) for kind in ONE_HAND.loop if kind != "device"]
    with Recorder(path, run_metadata(config)) as recorder:
        simulation = Simulation([*others, device], {}, recorder.write)
        simulation.run(50_000_000)
        device.engage()  # as in a live run, where all nodes have come first
        simulation.run(300_000_000)
    assert verified(path).is_same
    found = verified(changed(path, {}, drop=range(20)))
    assert (found.unknown, found.verified, found.is_same) == (0, 280, True)


def test_what_follows_a_missing_tick_is_not_called_verified(tmp_path: Path) -> None:
    path = changed(recorded(tmp_path / "run.mcap", "stiff_wall"), {}, drop=range(100, 102))
    found = verified(path)
    assert (found.ticks, found.verified, found.differing, found.is_same) == (298, 100, 0, False)
    changed(path, {}, drop=range(100))
    with pytest.raises(ConfigError, match="begins with tick 102, when its ledger had begun"):
        verified(path)


def test_a_force_that_no_recorded_command_gives_is_found(tmp_path: Path) -> None:
    path = recorded(tmp_path / "run.mcap", "stiff_wall", "delay:=5ms")
    packet = read(path).packets("telemetry")[250]
    assert isinstance(packet, Telemetry)
    twice = (2.0 * packet.commanded_force[0],)
    found = verified(changed(path, {250: {"commanded_force": twice}}))
    assert (found.unknown_commands, found.is_same) == (1, False)


class OwnDevice(OpenHandle):
    """A device that moves evenly, and can be given a hold limit or not."""

    takes_limit = False

    def read(self, time_ns: int) -> Vector:
        return (1e-10 * time_ns,)

    def set_hold_limit(self, seconds: float) -> float | None:
        return seconds if self.takes_limit else None


@pytest.mark.parametrize("takes_limit", [True, False])
def test_the_recording_states_whether_a_device_takes_a_hold_limit(
    tmp_path: Path, takes_limit: bool
) -> None:
    path, servo = tmp_path / "run.mcap", ServoSettings(engage_time=0.0)
    model = Handle(damping=0.5, friction=0.2)
    device = OwnDevice(model)
    device.takes_limit = takes_limit
    node = DeviceNode(device, dissipation_of(model, servo), servo)
    node.engage()
    received: list[Packet] = []
    with Recorder(path, {"launch": "{}"}) as recorder:
        for _ in range(600):
            sent = node.step(node.wake_ns, received)
            states = [one for one in sent if isinstance(one, DeviceState)]
            received = [answer(one, (3.0,), one.seq) for one in states]
            for packet in (*sent, *received):
                recorder.write(packet)
    found = verify(read(path), HandConfig(model, servo))
    assert found.is_same
    assert found.commands > 250
    assert any(packet.applied_force != (0.0,) for packet in telemetry(path))


def test_verification_takes_no_option_of_a_run(tmp_path: Path) -> None:
    path = recorded(tmp_path / "run.mcap", "stiff_wall", duration=0.01)
    for option in ("--live", "--duration=1s"):
        assert invoke("replay", path, "--verify", option).exit_code == 2


def test_a_recording_chooses_no_code(tmp_path: Path) -> None:
    config = load("stiff_wall")
    metadata = run_metadata(config)
    launch = json.loads(metadata["launch"])
    launch["hands"]["hand"]["device"]["law"] = "/nowhere/law.py:Law"
    path = tmp_path / "run.mcap"
    Recorder(path, metadata | {"launch": json.dumps(launch)}).close()
    with pytest.raises(ConfigError, match=r"names code of its own, /nowhere/law.py:Law"):
        device_of(read(path))
    assert device_of(read(path), ["law:=none"]).servo.law == "none"


# --- Once more, with other parts -----------------------------------------------------------------


def test_a_replay_with_the_same_parts_is_the_same_run(tmp_path: Path) -> None:
    path, again = recorded(tmp_path / "run.mcap", "stiff_wall", "delay:=5ms"), tmp_path / "b.mcap"
    assert invoke("replay", path, "--record", again).exit_code == 0
    assert read(again).packets("telemetry") == read(path).packets("telemetry")


def test_another_law_meets_the_same_hand(tmp_path: Path) -> None:
    path = recorded(tmp_path / "run.mcap", "stiff_wall", "delay:=5ms", duration=0.6)
    found = {}
    for law in ("none", "certified"):
        result = invoke("replay", path, f"law:={law}", "environment.stiffness:=20 N/mm", "--json")
        found[law] = json.loads(result.stdout)
    assert found["none"]["true_energy_min_j"] < -0.001
    assert found["certified"]["true_energy_min_j"] >= -1e-9


def test_the_recorded_network_is_met_again(tmp_path: Path) -> None:
    path = recorded(tmp_path / "run.mcap", "stiff_wall", "delay:=5ms")
    again = tmp_path / "again.mcap"
    assert invoke("replay", path, "--network", "--record", again).exit_code == 0
    delays = [
        {p.seq: p.loop_delay for p in read(run).packets("telemetry") if isinstance(p, Telemetry)}
        for run in (path, again)
    ]
    assert delays[1] == delays[0]
    near = json.loads(
        invoke("replay", path, "--network", "controller:=local_model", "--json").stdout
    )
    assert near["same_tick_share"] > 0.9  # what is far is the environment


def test_the_target_of_a_recorded_hand_is_found_from_its_force(tmp_path: Path) -> None:
    path = recorded(tmp_path / "run.mcap", "stiff_wall", duration=0.6)
    hand, recorded_hand = load("stiff_wall").only.operator, TrajectoryHand(path)
    assert hand is not None
    for time in (0.05, 0.2, 0.35, 0.5):
        assert recorded_hand.target(time)[0] == pytest.approx(hand.target(time)[0], abs=1e-4)
    positions = {p.seq: {"true_position": None, "hand_force": None} for p in telemetry(path)}
    on_hardware = TrajectoryHand(changed(path, positions))
    for packet in telemetry(path)[1::100]:
        assert on_hardware.target(packet.elapsed) == packet.position


def test_a_pointer_s_hand_becomes_one_that_follows_its_path(tmp_path: Path) -> None:
    path = recorded(tmp_path / "run.mcap", "stiff_wall")
    launch = read(path).launch
    launch["operator"] = {"kind": "pointer", "mass": 0.1, "stiffness": 500.0, "damping": 1.0}
    with Recorder(path, {"launch": json.dumps(launch)}) as recorder:
        recorder.write(telemetry_packet(1, true_position=(0.0,), hand_force=(1.0,)))
    hand = graph_of(read(path), feeds=("hand",)).only.operator
    assert isinstance(hand, TrajectoryHand)
    assert (hand.file, hand.mass, hand.stiffness, hand.damping) == (path, 0.1, 500.0, 1.0)
    assert hand.target(0.0) == (1.0 / 500.0,)


def test_a_device_at_a_port_is_only_used_if_the_user_says_so(tmp_path: Path) -> None:
    path = recorded(tmp_path / "run.mcap", "five_bar_wall")
    launch = read(path).launch
    launch["device"] = {"kind": "haply_2diy", "law": "certified"}
    rewritten(path, launch)
    with pytest.raises(ConfigError, match="recorded on a device at a serial port; name a simulat"):
        graph_of(read(path))
    assert graph_of(read(path), ["device:=five_bar"]).only.servo.law == "certified"


def test_wrong_settings_are_named(tmp_path: Path) -> None:
    recording = read(recorded(tmp_path / "run.mcap", "stiff_wall", duration=0.01))
    for setting, message in (
        ("law", "'law'"),
        ("law:=sertified", "'certified'"),
        ("wall.stiffness:=3", "unknown setting"),
        ("environment.stifness:=3", "stiffness"),
        ("environment.stiffness:=3 Hz", "Hz"),
    ):
        with pytest.raises(ConfigError, match=message):
            graph_of(recording, [setting])


def test_a_recording_without_a_path_or_a_launch_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    Recorder(path, {"launch": "{}"}).close()
    with pytest.raises(ConfigError, match="no tick with an engaged force"):
        TrajectoryHand(path)
    with pytest.raises(ConfigError, match="holds no launch file"):
        graph_of(read(path))
