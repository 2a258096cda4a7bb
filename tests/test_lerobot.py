"""integrations/: the plug-ins of lerobot, against its sources and, live, in its loop."""

import ast
import importlib
import json
import math
import os
import re
import signal
import subprocess
import sys
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from live_graph import PROCESSES_OF_THEIR_OWN, LiveGraph, live_graph
from waiting import TIMEOUT, until

from forcebound.errors import ConfigError
from forcebound.haptics.environments import Environment
from forcebound.messages.packets import Telemetry
from forcebound.testing import check_environment
from forcebound_lerobot import ONSET, Follower, Observations

ROOT = Path(__file__).parent.parent
STAND_IN = ROOT / "tests/lerobot_stand_in"
SESSION = ROOT / "tests/lerobot_session.py"
PAGE = ROOT / "docs/lerobot.md"
JOINTS = ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll", "gripper")
DEGREE = math.pi / 180
STILL = (0.0,) * 6
#: Versions of Python whose newest lerobot is another one: 0.4 and 0.6.
PYTHONS = ("3.10", "3.12")


# Against the sources of lerobot


@pytest.fixture(scope="module", params=PYTHONS)
def lerobot(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with the sources of a lerobot, without what it depends on."""
    folder = tmp_path_factory.mktemp("lerobot")
    which = ("--no-deps", "--only-binary=:all:", "--python-version", request.param, "lerobot")
    pip = [sys.executable, "-m", "pip", "download", "--quiet", *which, "--dest", str(folder)]
    done = subprocess.run(pip, capture_output=True, text=True)
    wheels = list(folder.glob("lerobot-*.whl"))
    if not wheels:
        pytest.skip(f"no wheel of lerobot can be had: {done.stderr.strip()[-200:]}")
    with zipfile.ZipFile(wheels[0]) as wheel:
        wheel.extractall(folder)
    return folder


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Variables of a process that has the plug-ins, as pip installs them, and the stand-in."""
    folder = tmp_path_factory.mktemp("plug-ins")
    sources = folder / "integrations"
    sources.mkdir()
    for file in (ROOT / "integrations").glob("*.*"):
        (sources / file.name).write_bytes(file.read_bytes())
    words = ["install", "--quiet", "--no-deps", "--target", folder / "there", sources]
    subprocess.run([sys.executable, "-m", "pip", *map(str, words)], check=True)
    path = os.pathsep.join([str(folder / "there"), str(STAND_IN)])
    return {**os.environ, "PYTHONPATH": path}


def members(source: str, name: str) -> dict[str, tuple[str, ...]]:
    """Arguments of the public methods of a class, and its fields; of what is abstract, marked."""
    [found] = [
        node
        for node in ast.parse(source).body
        if isinstance(node, ast.ClassDef) and node.name == name
    ]
    known: dict[str, tuple[str, ...]] = {}
    for node in found.body:
        if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
            known[node.target.id] = ("field",)
        elif isinstance(node, ast.FunctionDef) and not node.name.startswith("_"):
            marks = [ast.unparse(one) for one in node.decorator_list]
            defaults = [ast.unparse(one) for one in node.args.defaults]
            arguments = [one.arg for one in node.args.args]
            known[node.name] = (*sorted(marks), *arguments, *defaults)
    return known


@pytest.mark.parametrize(
    ("file", "base", "config"),
    [
        ("robots/robot.py", "Robot", "RobotConfig"),
        ("teleoperators/teleoperator.py", "Teleoperator", "TeleoperatorConfig"),
    ],
)
def test_the_stand_in_has_the_abstract_members_of_the_real_base_classes(
    lerobot: Path, file: str, base: str, config: str
) -> None:
    real = members((lerobot / "lerobot" / file).read_text(), base)
    shared = members((STAND_IN / "lerobot/__init__.py").read_text(), "Device")
    own = members((STAND_IN / "lerobot" / f"{file.split('/')[0]}.py").read_text(), base)
    assert shared | own == real
    settings = (lerobot / "lerobot" / file).with_name("config.py").read_text()
    stood_in = (STAND_IN / "lerobot" / f"{file.split('/')[0]}.py").read_text()
    fields = {"id": ("field",), "calibration_dir": ("field",)}
    assert members(stood_in, config) == fields
    assert fields.items() <= members(settings, config).items()
    assert "@dataclass(kw_only=True)" in settings


DISCOVER = """
import importlib.util, json, logging, sys, types, draccus
sys.modules["draccus.choice_types"] = draccus
spec = importlib.util.spec_from_file_location("import_utils", sys.argv[1])
real = importlib.util.module_from_spec(spec)
spec.loader.exec_module(real)
real.register_third_party_plugins()
from lerobot.robots import RobotConfig
raw = {"type": "forcebound", "follower": {"type": "wall"}}
import lerobot_robot_wall
robot = real.make_device_from_device_class(draccus.decode(RobotConfig, raw))
print(json.dumps([sorted(draccus.ChoiceRegistry.choices), str(type(robot))]))
"""


def test_lerobot_finds_and_makes_what_is_installed(
    lerobot: Path, installed: dict[str, str]
) -> None:
    words = [sys.executable, "-c", DISCOVER, str(lerobot / "lerobot/utils/import_utils.py")]
    done = subprocess.run(words, capture_output=True, text=True, env=installed)
    assert done.returncode == 0, done.stderr
    choices, robot = json.loads(done.stdout)
    assert {"RobotConfig forcebound", "TeleoperatorConfig forcebound"} <= set(choices)
    assert "lerobot_robot_forcebound.ForceboundRobot" in robot


# The robot and the teleoperator


@pytest.fixture
def plug_ins(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """lerobot is the stand-in, for this test."""
    before = set(sys.modules)
    monkeypatch.syspath_prepend(STAND_IN)
    yield
    for name in set(sys.modules) - before:
        if name.partition(".")[0].startswith(("lerobot", "draccus")):
            del sys.modules[name]


@pytest.mark.usefixtures("plug_ins")
def test_the_robot_is_its_follower_for_lerobot() -> None:
    from lerobot_robot_forcebound import ForceboundRobot, ForceboundRobotConfig

    importlib.import_module("lerobot_robot_wall")  # registers the follower
    config = ForceboundRobotConfig(follower={"type": "wall"}, link="of_this_test")
    robot = ForceboundRobot(config)
    assert robot.name == robot.robot_type == "wall"
    assert robot.observation_features == robot.action_features | {"front": (2, 2, 3)}
    robot.connect()
    try:
        with pytest.raises(ConfigError):  # a second one under the same name
            Observations("of_this_test")
        action = {f"{joint}.pos": 2.0 for joint in JOINTS}
        assert robot.send_action(action) == action
        assert robot.get_observation()["gripper.pos"] == 1.0
    finally:
        robot.disconnect()


# The environment


def model(**fields: Any) -> Follower:
    """A spring of 2 N m/rad to a follower whose gripper is in percent of 60 degrees."""
    units = (*[DEGREE] * 5, 0.6 * DEGREE)
    given = {"joints": JOINTS, "unit": units, "stiffness": 2.0, "damping": 0.0, "link": "test"}
    return Follower(**{**given, **fields})


@contextmanager
def observed(
    numbers: Mapping[str, float], **fields: Any
) -> Iterator[tuple[Environment, Observations]]:
    """An environment that has received an observation, at 1 s."""
    with closing(Observations("test")) as sender, closing(model(**fields).open(6)) as environment:

        def is_here() -> bool:
            sender.send(numbers)
            environment.force("hand", STILL, STILL, 1.0)
            return bool(environment.published.events)

        until(is_here, "an observation")
        environment.force("hand", STILL, STILL, 1.0)  # takes what was sent beside the first
        yield environment, sender


FREE = {f"{joint}.pos": 0.0 for joint in JOINTS}


def kinds(environment: Environment) -> list[str]:
    return [kind for kind, _, _ in environment.published.events]


def test_the_leader_is_pulled_to_the_follower_in_the_followers_units() -> None:
    place = FREE | {"shoulder_pan.pos": 10.0, "gripper.pos": 50.0}
    with observed(place) as (environment, _):
        assert not any(environment.force("hand", STILL, STILL, 1.0))
        half = environment.force("hand", STILL, STILL, 1.0 + 0.2 * ONSET)
        whole = environment.force("hand", STILL, STILL, 1.0 + 0.39 * ONSET)
        expected = [-2.0 * 10.0 * DEGREE, 0.0, 0.0, 0.0, 0.0, -2.0 * 30.0 * DEGREE]
        assert half == pytest.approx([0.2 * one for one in expected])
        assert whole == pytest.approx([0.39 * one for one in expected])
    action = model().action((0.0, DEGREE, 0.0, 0.0, 0.0, 30.0 * DEGREE))
    assert action == pytest.approx(FREE | {"shoulder_lift.pos": 1.0, "gripper.pos": 50.0})


def test_a_silent_follower_gives_no_force_and_comes_back_slowly() -> None:
    place = FREE | {"shoulder_pan.pos": 10.0}
    with observed(place, observation_age=0.1) as (environment, sender):
        assert any(environment.force("hand", STILL, STILL, 1.09))
        assert not any(environment.force("hand", STILL, STILL, 1.11))
        assert kinds(environment) == ["follower_seen", "follower_silent"]

        def is_back() -> bool:
            sender.send(place)
            environment.force("hand", STILL, STILL, 2.0)
            return kinds(environment)[2:] == ["follower_seen"]

        until(is_back, "an observation")
        assert not any(environment.force("hand", STILL, STILL, 2.0))
        assert any(environment.force("hand", STILL, STILL, 2.09))


@pytest.mark.parametrize(
    "place", [{"gripper.pos": 1.0}, FREE | {"gripper.pos": math.nan}, {"front": 1.0}]
)
def test_an_observation_that_lacks_something_gives_no_force_and_one_event(
    place: dict[str, float],
) -> None:
    with observed(place) as (environment, _):
        assert not any(environment.force("hand", (1.0,) * 6, STILL, 1.1))
        assert kinds(environment) == ["observation_refused"]


def test_the_leader_feels_the_measured_effort_of_the_follower() -> None:
    place = FREE | {f"{joint}.effort": 0.0 for joint in JOINTS} | {"elbow_flex.effort": 3.0}
    fields = {"stiffness": 0.0, "effort": "effort", "effort_unit": 0.5}
    with observed(place, **fields) as (environment, _):
        felt = environment.force("hand", STILL, STILL, 1.0 + 0.2 * ONSET)
        # It pushes what it touches towards larger positions; that resists the leader's hand.
        assert felt == pytest.approx([0.0, 0.0, 0.2 * 1.5, 0.0, 0.0, 0.0])


def test_the_environment_keeps_its_promises() -> None:
    check_environment(model(), axes=[6])


@pytest.mark.parametrize(
    ("fields", "field"),
    [
        ({"unit": 0.0}, "unit"),
        ({"joints": ("one",)}, "joints"),
        ({"zero": (0.0, 0.0)}, "zero"),
        ({"effort": "current"}, "effort_unit"),
    ],
)
def test_what_does_not_fit_is_named(fields: dict[str, Any], field: str) -> None:
    with pytest.raises(ConfigError) as raised:
        model(**fields).check_axes(6)
    assert raised.value.field == field


# Live


@pytest.fixture
def leader(tmp_path: Path) -> Path:
    """The leader of the page, whose hand presses."""
    [text] = re.findall(r"^```yaml\n(# leader.yaml\n.*?)^```$", PAGE.read_text(), re.M | re.S)
    path = tmp_path / "leader.yaml"
    path.write_text(text)
    return path


@contextmanager
def running(
    installed: Mapping[str, str], leader: Path
) -> Iterator[tuple[LiveGraph, dict[str, str]]]:
    """The graph of a leader, and the variables of a process of lerobot beside it."""
    own = {"PYTHONPATH": installed["PYTHONPATH"]}
    with live_graph(str(leader), prefix=(), variables=own, is_alone=False) as graph:
        graph.wait_until_engaged()
        yield graph, {**installed, **graph.variables}


@contextmanager
def session(variables: Mapping[str, str], sources: Path | str) -> Iterator[subprocess.Popen[str]]:
    """A session of lerobot, in a process of its own."""
    robot = {"type": "forcebound", "follower": {"type": "wall"}}
    words = (str(sources), json.dumps({"type": "forcebound"}), json.dumps(robot))
    command = [sys.executable, str(SESSION), *words]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, env={**variables})
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


def wait_for_force(graph: LiveGraph, is_there: bool) -> None:
    """Wait until the follower is felt, or there is no force; how much passes is the law's."""

    def has(telemetry: Telemetry) -> bool:
        if is_there:
            return abs(telemetry.commanded_force[0]) > 0.3
        return not any(telemetry.commanded_force) and not any(telemetry.applied_force)

    graph.wait_for_telemetry(has, "a force" if is_there else "no force")


class TestLive:
    pytestmark = PROCESSES_OF_THEIR_OWN

    @pytest.mark.usefixtures("plug_ins")
    def test_no_position_is_taken_for_a_force_and_the_end_of_the_graph_is_an_error(self) -> None:
        from lerobot_teleoperator_forcebound import (
            ForceboundTeleoperator,
            ForceboundTeleoperatorConfig,
        )

        with live_graph("joint_arms", is_alone=False) as graph:
            graph.wait_until_engaged()
            config = ForceboundTeleoperatorConfig(run=graph.run_dir, hand="left")
            with pytest.raises(ConfigError):
                ForceboundTeleoperator(config)
            config = ForceboundTeleoperatorConfig(run=graph.run_dir, hand="leader")
            teleop = ForceboundTeleoperator(config)
            with pytest.raises(ConnectionError):
                teleop.get_action()
            teleop.connect()
            try:
                assert teleop.get_action().keys() == teleop.action_features.keys()
                assert teleop.action_features.keys() >= {"base.pos", "gripper.pos"}
                assert not teleop.feedback_features
                assert not {"enable_torque", "disable_torque"} & set(dir(teleop))
                with pytest.warns(UserWarning, match=r"base\.pos"):
                    teleop.send_feedback({"base.pos": 1.0})
                graph.process.send_signal(signal.SIGINT)
                graph.outcome()
                with pytest.raises(ConnectionError):  # an action of before comes first
                    until(lambda: not teleop.get_action(), "an error")
            finally:
                teleop.disconnect()
        assert not teleop.is_connected

    def test_the_unmodified_loop_lets_the_leader_feel_the_wall_of_the_follower(
        self, lerobot: Path, installed: dict[str, str], leader: Path
    ) -> None:
        with running(installed, leader) as (graph, variables):
            with session(variables, lerobot) as process:
                wait_for_force(graph, True)
                graph.wait(2.0)
                process.send_signal(signal.SIGINT)
                _, log = process.communicate(timeout=TIMEOUT)
                assert process.returncode == 0, log
            wait_for_force(graph, False)
            ended = graph.end()
        columns = ended.columns
        assert columns.true_energy.min() >= -1e-9
        assert columns.position[:, 0].max() > 15.0 * DEGREE  # beyond the wall of the follower
        asked = np.abs(columns.commanded_force).max(0)
        assert asked[0] > 0.4  # N m
        assert (asked[1:] < 0.5 * asked[0]).all()
        assert np.abs(columns.applied_force[:, 0]).max() > 0.1  # of it, what the law lets pass
        assert ended.events("follower_seen")

    @pytest.mark.parametrize("harm", [signal.SIGKILL, signal.SIGSTOP])
    def test_a_session_that_is_killed_or_hangs_leaves_no_force(
        self, installed: dict[str, str], leader: Path, harm: signal.Signals
    ) -> None:
        with running(installed, leader) as (graph, variables):
            with session(variables, "") as process:
                wait_for_force(graph, True)
                process.send_signal(harm)
                wait_for_force(graph, False)
                if harm is signal.SIGSTOP:
                    process.send_signal(signal.SIGCONT)
                    wait_for_force(graph, True)
            ended = graph.end()
        assert ended.columns.true_energy.min() >= -1e-9
        assert ended.events("follower_silent")
