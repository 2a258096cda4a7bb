"""Several hands in one graph: the launch file, both engines, every command, Python."""

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from invoking import invoke
from launch_texts import problems_of, written
from run_starts import LIMITS

import forcebound
from forcebound.errors import ConfigError
from forcebound.graph.graph import GraphConfig, RealtimeConfig
from forcebound.graph.loader import load
from forcebound.graph.model import restore
from forcebound.graph.parameters import change, node_of, parameters
from forcebound.graph.resolved import run_document, to_document
from forcebound.lab.sweep.plan import load_sweep
from forcebound.lab.sweep.runner import run_case
from forcebound.messages.control import ResumeDevice
from forcebound.messages.topology import Graph, flat
from forcebound.observe.doctor import examine
from forcebound.observe.observation import observe
from forcebound.observe.tuning import find_parameters
from forcebound.recordings.recording import read
from forcebound.roles import LAUNCHER, LOST
from forcebound.run.actions import Announce, Ended, Engaged, Reported, RunPhase, Start, Terminate
from forcebound.run.lifecycle import Lifecycle
from forcebound.run.results import results_of
from forcebound.run.run_directory import RunDocument, graph_in
from forcebound.run.virtual import run_virtual, run_virtual_hands
from forcebound.run.worker import core_of

TWO = """\
forcebound: 1
seed: 1
duration: 1 s
arguments: {wall: 10 N/mm}
hands:
  left:
    include: stiff_wall.yaml
  right:
    include: stiff_wall.yaml
    device: {law: none}
    links: {environment_query: {delay: 2 ms}}
environment: {kind: wall, stiffness: $(arg wall), position: 10 mm}
"""


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return written(tmp_path_factory.mktemp("hands"), TWO, "two.yaml")


@pytest.fixture(scope="module")
def config(file: Path) -> GraphConfig:
    return load(file)


@pytest.fixture(scope="module")
def recording(config: GraphConfig, file: Path) -> Path:
    path = file.with_name("two.mcap")
    run_virtual_hands(config, record=path)
    return path


@pytest.mark.parametrize(
    ("old", "new", "place", "named"),
    [
        ("  right:", "  left:", "8:3", "'left'"),
        ("  right:", "  ri-ght:", "8:3", "'ri-ght'"),
        ("  right:", "  2nd:", "8:3", "'2nd'"),
        ("  right:", "  device:", "8:3", "'device'"),
        ("seed: 1", "device: {kind: knob}\nseed: 1", "2:1", "device"),
        ("seed: 1", "links: {}\nseed: 1", "2:1", "links"),
        ("{law: none}", "{axes: 2}", "10:20", "left 1"),
        ("{law: none}", "{law: non}", "10:19", "'none'"),
        ("    links:", "    link:", "11:5", "'links'"),
        ("    links:", "    environment:", "11:5", "'environment'"),
        ("delay: 2", "delay: -2", "11:40", "0 to 86400 s"),
        (
            "    include: stiff_wall.yaml\n  right",
            "    include: stif\n  right",
            "7:14",
            "'stif'",
        ),
        (
            "  right:",
            "".join(f"  h{n}: {{include: stiff_wall.yaml}}\n" for n in range(7)) + "  right:",
            "5:1",
            "at most 8",
        ),
    ],
)
def test_a_problem_has_its_place(
    tmp_path: Path, old: str, new: str, place: str, named: str
) -> None:
    assert old in TWO
    path = written(tmp_path, TWO.replace(old, new, 1))
    problems = problems_of(path)
    assert f"{path}:{place}: " in problems
    assert named in problems


def test_a_port_has_one_device(tmp_path: Path) -> None:
    device = "{kind: haply_2diy, port: /dev/ttyACM0}"
    hands = f"hands:\n  a: {{device: {device}}}\n  b: {{device: {device}}}\n"
    text = f"forcebound: 1\nseed: 1\nduration: 1 s\n{hands}environment: {{kind: wall}}\n"
    path = written(tmp_path, text)
    problems = problems_of(path)
    assert f"{path}:6:" in problems
    assert "/dev/ttyACM0" in problems


def test_a_configuration_travels_whole(config: GraphConfig) -> None:
    again = restore(run_document(config))
    assert parameters(again) == parameters(config)
    assert tuple(again.hands) == ("left", "right")
    assert config.of("left").only.servo.law == "certified"
    with pytest.raises(ConfigError, match="left, right"):
        _ = config.only.device


def test_a_hand_alone_keeps_its_phases_and_units(tmp_path: Path) -> None:
    setting = "{left.links.force_command.loss: 0.1, environment.stiffness: 2 N/mm}"
    text = TWO.replace("duration: 1 s", f"phases: [{{name: a, duration: 1 s, set: {setting}}}]")
    config = load(written(tmp_path, text))
    shared = {"environment.stiffness": 2000.0}
    for hand, own in (("left", {"links.force_command.loss": 0.1}), ("right", {})):
        alone = config.of(hand)
        assert dict(alone.phases[0].settings) == shared | own
        assert alone.units["device.rate"] == "kHz"
        assert not any(name.startswith(("left", "right")) for name in alone.units)
        document = flat(to_document(config), hand)
        assert document["phases"][0]["set"] == shared | own
        assert document["units"] == dict(alone.units)


def test_parameters_begin_with_the_hand(config: GraphConfig) -> None:
    delay = "right.links.environment_query.delay"
    assert parameters(config)[delay] == 0.002
    assert {node_of(one, config) for one in (delay, "left.device.law")} == {
        "environment",
        "left/device",
    }
    changed = change(config, {delay: 0.0, "left.device.law": "tdpa"})
    assert [hand.servo.law for hand in changed.hands.values()] == ["tdpa", "none"]
    for name in ("left.device.law", "hands.left.device.law"):
        assert find_parameters(changed, [name]) == {"left.device.law": "tdpa"}
    with pytest.raises(ConfigError, match=r"left\.device\.law or right\.device\.law"):
        change(config, {"device.law": "none"})


def test_beside_another_hand_a_hand_is_the_same_to_the_bit(
    config: GraphConfig, recording: Path
) -> None:
    recorded = results_of(recording)
    for hand, result in recorded.items():
        alone = run_virtual(config.of(hand)).columns
        for column in ("position", "applied_force", "true_energy", "loop_delay"):
            one, other = (getattr(each, column) for each in (alone, result.columns))
            assert np.array_equal(one, other, equal_nan=True), (hand, column)
    assert recorded["left"].summary["true_energy_min_j"] >= 0.0
    assert recorded["right"].summary["true_energy_min_j"] < -0.01


def test_recorded_hands_are_drawn_side_by_side(recording: Path, tmp_path: Path) -> None:
    picture = str(tmp_path / "run.png")
    both = json.loads(invoke("plot", str(recording), "-o", picture, "--json").stdout)
    assert [run["hand"] for run in both["runs"]] == ["left", "right"]
    one = invoke("plot", str(recording), "-o", picture, "--hand", "left", "--json").stdout
    assert [run["hand"] for run in json.loads(one)["runs"]] == ["left"]
    wrong = invoke("plot", str(recording), "-o", picture, "--hand", "middle")
    assert wrong.exit_code == 2
    assert "left, right" in wrong.stderr


def test_each_recorded_hand_has_tables_of_its_own(recording: Path, tmp_path: Path) -> None:
    assert invoke("export", str(recording), "--csv", str(tmp_path)).exit_code == 0
    left, right = ((tmp_path / hand / "telemetry.csv").read_text() for hand in ("left", "right"))
    assert left != right
    assert len(left.splitlines()) == len(right.splitlines()) == 1001


def test_each_recorded_hand_is_verified(recording: Path) -> None:
    found = json.loads(invoke("replay", str(recording), "--verify", "--json").stdout)["hands"]
    assert {hand: (one["verified"], one["is_same"]) for hand, one in found.items()} == {
        "left": (1000, True),
        "right": (1000, True),
    }


def replayed(recording: Path, path: Path, *words: str) -> Mapping[str, Any]:
    result = invoke("replay", str(recording), "--record", str(path), *words)
    assert result.exit_code == 0, result.output
    return results_of(path)


def test_recorded_hands_run_again_together(recording: Path, tmp_path: Path) -> None:
    first = results_of(recording)
    again = replayed(recording, tmp_path / "again.mcap", "left.law:=none", "right.law:=none")
    assert np.array_equal(again["right"].columns.position, first["right"].columns.position)
    assert again["left"].document["device"]["law"] == "none"
    assert again["left"].summary["peak_force_n"] > first["left"].summary["peak_force_n"]


def test_one_recorded_hand_runs_again_with_the_recorded_replies(
    recording: Path, tmp_path: Path
) -> None:
    alone = invoke("replay", str(recording), "--hand", "left")
    assert alone.exit_code == 2
    assert "--environment" in alone.stderr
    again = replayed(recording, tmp_path / "one.mcap", "--hand", "left", "--environment")
    first = results_of(recording)["left"].columns
    assert np.allclose(again["hand"].columns.commanded_force, first.commanded_force, atol=1e-12)


def test_recorded_replies_are_those_to_the_hand_of_the_name(
    recording: Path, tmp_path: Path
) -> None:
    again = replayed(recording, tmp_path / "both.mcap", "--environment")
    for hand, result in results_of(recording).items():
        assert np.allclose(again[hand].columns.position, result.columns.position, atol=1e-9)


def test_the_loop_delay_is_that_of_a_hand(recording: Path) -> None:
    def median(hand: str) -> float:
        found = json.loads(invoke("delay", str(recording), "--hand", hand, "--json").stdout)
        return float(found["loop_delay_ms"]["p50"])

    assert median("left") < 1.0 < 2.0 <= median("right")
    assert "--hand left" in invoke("delay", str(recording)).stderr


def test_the_row_of_a_sweep_has_figures_of_each_hand(file: Path) -> None:
    sweep = "forcebound: 1\nlaunch: two.yaml\nduration: 500 ms\nover: {wall: [1 N/mm, 20 N/mm]}\n"
    plan = load_sweep(written(file.parent, sweep, "sweep.yaml"))
    soft, hard = (run_case(plan, number, case) for number, case in enumerate(plan.cases))
    assert soft["error"] is None
    assert (soft["environment.stiffness"], hard["environment.stiffness"]) == (1e3, 2e4)
    for hand in ("left", "right"):
        assert soft[f"{hand}.peak_force_n"] < hard[f"{hand}.peak_force_n"]
    assert (soft["left.device.law"], soft["right.device.law"]) == ("certified", "none")
    assert "peak_force_n" not in soft


def test_python_has_the_figures_of_each_hand(file: Path, recording: Path) -> None:
    run = forcebound.simulate(file)
    read_again = forcebound.read(recording)
    for hand in ("left", "right"):
        figures = run.hands[hand].figures
        assert figures.summary == read_again.hands[hand].figures.summary
        assert run.last("500 ms").hands[hand].figures.duration == pytest.approx(0.5, abs=2e-3)
    for name in ("figures", "telemetry", "label", "verdict", "events", "document"):
        with pytest.raises(ConfigError, match="which hand"):
            getattr(run, name)
    assert repr(run).startswith("left:\n")
    assert forcebound.plot(run, panels=("force",)).shape == (1, 2)
    runs = forcebound.sweep(file, wall=["1 N/mm", "20 N/mm"], duration="500 ms")
    first, last = runs["left.peak_force"]
    assert first < last


def test_an_environment_of_gymnasium_has_one_hand(file: Path) -> None:
    gym = pytest.importorskip("forcebound.interface.gym")
    with pytest.raises(ConfigError, match="one hand"):
        gym.HapticEnv(file)


def running(graph: Graph) -> Lifecycle:
    """Return a run of a graph whose force is engaged."""
    nodes = tuple(name for name in graph.nodes if name != LAUNCHER)
    lifecycle = Lifecycle(nodes, None, 0, LIMITS, graph=graph)
    for name in nodes:
        lifecycle.advance(1, Reported(name, ()))
    for name in ("left/device", "right/device"):
        lifecycle.advance(2, Engaged(name))
    return lifecycle


def test_a_lost_device_leaves_the_other_hand_its_force(config: GraphConfig) -> None:
    lifecycle = running(config.graph)
    (lost,) = lifecycle.advance(500, Ended("left/device", LOST))
    assert isinstance(lost, Announce)
    assert lost.node == "left/device"
    assert "device resume left" in lost.message
    states = {name: lifecycle.state(name) for name in ("left/device", "right/device")}
    assert states == {"left/device": "lost", "right/device": "running"}
    assert Start("left/device") in lifecycle.advance(600, ResumeDevice("left/device"))
    assert lifecycle.phase is RunPhase.RUNNING


def test_a_device_that_does_not_wait_ends_the_run_of_all_hands(config: GraphConfig) -> None:
    lifecycle = running(config.graph)
    ends = lifecycle.advance(500, Ended("left/device", 1))
    assert lifecycle.phase is RunPhase.STOPPING
    assert Terminate("right/device") in ends


@pytest.mark.live
@pytest.mark.xdist_group("processes")
@pytest.mark.no_cover
def test_every_command_knows_the_hands_of_a_running_graph(file: Path, tmp_path: Path) -> None:
    text = TWO.replace("seed: 1", "seed: 1\nrealtime: {policy: other}")
    text = text.replace("{law: none}", "{law: none, rate: 250 Hz}")
    calm = text.replace("  left:\n", "  left:\n    device: {rate: 250 Hz}\n")
    record = tmp_path / "live.mcap"
    with forcebound.launch(written(tmp_path, calm), record=record) as graph:
        run = ("--run", str(graph.run_dir))

        def found(*words: str) -> Any:
            result = invoke(*words, *run, "--json")
            assert result.exit_code == 0, result.output
            return json.loads(result.stdout)

        rates = found("hz", "--duration", "100ms")
        assert {"left/telemetry", "right/telemetry", "scene"} <= rates.keys()
        (tick,) = invoke("echo", "right/telemetry", "--count", "1", "--json", *run).stdout.split(
            "\n", 1
        )[:1]
        assert json.loads(tick)["hand"] == "right"
        whose = invoke("echo", "telemetry", *run)
        assert whose.exit_code == 2
        assert "left/telemetry or right/telemetry" in whose.stderr
        delays = invoke(
            "delay", str(graph.run_dir), "--hand", "right", "--duration", "1s", "--json"
        )
        assert json.loads(delays.stdout)["ticks"] > 0
        edges = {edge["topic"] for edge in found("graph", "--duration", "100ms")}
        assert {"left/force_command", "right/force_command"} <= edges
        assert found("param", "set", "right.device.law:=certified") == {
            "right.device.law": "certified"
        }
        assert found("param", "list", "--changed") == {"right.device.law": "certified"}
        assert found("param", "get", "left.operator.mass") == {"left.operator.mass": 0.275}
        assert len(found("outage", "10ms")["links"]) == 4
        assert found("outage", "10ms", "left/force_command")["links"] == ["left/force_command"]
        assert "left, right" in invoke("device", "resume", *run).stderr
        kinds = {finding.where for finding in examine(*observe(graph.run_dir, 0.5))}
        assert kinds <= {*graph_in(graph.run_dir).nodes, "left/loop", "right/loop"}
        assert invoke("stop", "left/controller", *run).exit_code == 0
        where = {finding.kind: finding.where for finding in examine(*observe(graph.run_dir, 0.5))}
        assert where["process_stopped"] == "left/controller"
        assert invoke("start", "left/controller", *run).exit_code == 0
        later = tmp_path / "later.mcap"
        invoke("record", str(graph.run_dir), "-o", str(later), "--duration", "500ms")
        assert set(graph.run.hands) == {"left", "right"}
    recorded = read(later).metadata
    assert {"left/energy_before", "right/energy_before"} <= recorded.keys()
    assert set(results_of(later)) == set(results_of(record)) == {"left", "right"}


def test_hands_take_turns_on_the_cores(
    config: GraphConfig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("os.sched_getaffinity", lambda process: {0, 1})
    run = RunDocument(1, 2, str(tmp_path), [], graph=config.graph)
    cores = {name: core_of(run, name, config) for name in config.graph.loop}
    assert {core for name, core in cores.items() if name.startswith("left")} == {2}
    assert {core for name, core in cores.items() if name.startswith("right")} == {1}
    assert cores["environment"] == 2
    pinned = replace(config, realtime=RealtimeConfig(cores=2))
    assert {core_of(run, name, pinned) for name in config.graph.loop} == {2}
