"""An environment in a user's own file: from the launch file to every process and back."""

import json
import pickle
import subprocess
import sys
from pathlib import Path

import pytest
from invoking import invoke
from launch_texts import GOOD, problems_of, written
from live_graph import live_graph

from forcebound.errors import ConfigError
from forcebound.graph.graph import GraphConfig
from forcebound.graph.loader import from_document, load, load_tried
from forcebound.graph.model import never, restore
from forcebound.graph.parameters import change, with_values
from forcebound.graph.phases import timetable
from forcebound.graph.resolved import part_document, run_document, to_document
from forcebound.haptics.environments import open_environment
from forcebound.messages.packets import Vector
from forcebound.run.build import build_node, parts_of
from forcebound.run.results import run_metadata
from forcebound.run.virtual import run_virtual

ROOT = Path(__file__).parent.parent
EXAMPLES = ROOT / "examples" / "python"

SPRING = """\
from dataclasses import dataclass
from typing import Annotated

from forcebound.haptics.environments import StatelessEnvironment
from forcebound.messages.packets import Vector
from forcebound.quantities import NOT_NEGATIVE, Length, Stiffness


@dataclass(frozen=True)
class MySpring(StatelessEnvironment):
    stiffness: Annotated[Stiffness, NOT_NEGATIVE] = 500.0
    rest: Length = 0.0

    def force(self, user: str, position: Vector, velocity: Vector, elapsed: float) -> Vector:
        return (self.stiffness * (position[0] - self.rest), *[0.0] * (len(position) - 1))
"""
LAUNCH = GOOD.replace("kind: wall", "kind: my_spring.py")


def own(folder: Path, source: str = SPRING, launch: str = LAUNCH) -> Path:
    """A launch file with an environment beside it."""
    written(folder, source, "my_spring.py")
    return written(folder, launch)


def force_of(config: GraphConfig, position: Vector) -> Vector:
    model = config.environment.model
    return open_environment(model, len(position)).force("", position, (0.0,) * len(position), 0.0)


# --- the whole way -------------------------------------------------------------------------------


def test_a_file_beside_the_launch_file_is_an_environment_with_units(tmp_path: Path) -> None:
    config = load(own(tmp_path), ["stiffness:=2 N/mm"])
    assert force_of(config, (0.001, 0.0)) == (2.0, 0.0)


def test_the_document_names_file_and_class_and_makes_an_equal_configuration(
    tmp_path: Path,
) -> None:
    config = load(own(tmp_path))
    document = json.loads(json.dumps(to_document(config)))
    assert document["environment"] == document["environment"] | {
        "kind": f"{tmp_path / 'my_spring.py'}:MySpring",
        "stiffness": 10_000.0,
        "rest": 0.0,
        "compute_delay": 0.0,
    }
    assert from_document(document) == config


def test_the_recording_holds_path_and_source(tmp_path: Path) -> None:
    metadata = run_metadata(load(own(tmp_path)))
    assert metadata["environment_source"] == SPRING
    assert str(tmp_path / "my_spring.py") in metadata["launch"]
    assert "environment_source" not in run_metadata(load("stiff_wall"))


def test_its_parameters_can_be_changed_as_those_of_any_other(tmp_path: Path) -> None:
    config = load(own(tmp_path))
    changed = change(config, {"environment.stiffness": "3 N/mm"})
    assert force_of(changed, (0.001,)) == (3.0,)
    with pytest.raises(ConfigError, match="must be >= 0 N/m, got -1 N/m"):
        change(config, {"environment.stiffness": -1})


def test_its_code_runs_in_no_other_process(tmp_path: Path) -> None:
    document = run_document(load(own(tmp_path)))
    document["phases"] = [
        {"name": "late", "duration": 1.0, "set": {"environment.compute_delay": 0.002}},
        {"name": "soft", "duration": 1.0, "set": {"environment.rest": 0.001}},
    ]
    document["environment"] |= {"kind": str(tmp_path / "not_read.py"), "compute_delay": 0.001}
    config = restore(document, never)
    assert config.environment.compute_delay == 0.001
    late, soft = timetable(config)
    assert with_values(config, late.values).environment.compute_delay == 0.002
    soft_model = with_values(config, soft.values).environment.model
    assert part_document("environment", soft_model)["rest"] == 0.001
    for kind in ("device", "controller"):
        build_node(kind, restore(document, parts_of(kind))).close()
    with pytest.raises(ConfigError, match="not_read"):
        restore(document, parts_of("environment"))


def test_another_process_knows_it_again(tmp_path: Path) -> None:
    model = load(own(tmp_path)).environment.model
    (tmp_path / "pickled").write_bytes(pickle.dumps(model))
    program = "import pickle, sys; print(pickle.load(open(sys.argv[1], 'rb')))"
    out = subprocess.run(
        [sys.executable, "-c", program, str(tmp_path / "pickled")],
        capture_output=True,
        text=True,
        check=True,
        timeout=60,
    )
    assert out.stdout.strip() == repr(model)


@pytest.mark.live
def test_it_runs_live(tmp_path: Path) -> None:
    with live_graph(str(own(tmp_path)), is_alone=False) as graph:
        graph.wait_until_forced()
        ended = graph.end()
    assert ended.exit_status == 0, ended.log
    assert ended.columns.commanded_force.any()


def test_a_relative_path_starts_from_the_file_that_says_it(tmp_path: Path) -> None:
    (tmp_path / "inner").mkdir()
    own(tmp_path / "inner")
    above = "forcebound: 1\ninclude: inner/graph.yaml\nseed: 2\n"
    config = load(written(tmp_path, above, "above.yaml"))
    assert to_document(config)["environment"]["kind"].startswith(str(tmp_path / "inner"))


def test_an_argument_may_name_the_file_from_the_current_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    own(tmp_path)
    launch = LAUNCH.replace("kind: my_spring.py", "kind: $(arg mode)").replace(
        "mode: {default: soft, choices: [soft, hard]}", "mode: wall"
    )
    (tmp_path / "elsewhere").mkdir()
    path = written(tmp_path / "elsewhere", launch)
    monkeypatch.chdir(tmp_path)
    assert "MySpring" in to_document(load(path, ["mode:=my_spring.py"]))["environment"]["kind"]


def test_several_classes_are_told_apart_by_name(tmp_path: Path) -> None:
    two = SPRING + SPRING.replace("MySpring", "Other")
    assert "my_spring.py defines several: MySpring, Other; name one" in problems_of(
        own(tmp_path, two)
    )
    path = own(tmp_path, two, LAUNCH.replace("my_spring.py", "my_spring.py:Other"))
    assert type(load(path).environment.model).__name__ == "Other"


def test_what_a_file_prints_does_not_get_into_a_document(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    load(own(tmp_path, SPRING + "print('loaded')\n"))
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err == "loaded\n"


# --- errors --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("  stiffness: $", "  stifness: $", "'stifness'; did you mean 'stiffness'?"),
        ("$(arg stiffness)", "5 s", ":14:14: stiffness: expected a stiffness in N/m"),
        ("$(arg stiffness)", "-5", "stiffness: must be >= 0 N/m, got -5 N/m"),
        ("my_spring.py", "mine.py", "mine.py: No such file or directory; a relative path starts"),
        ("my_spring.py", "my_spring.py:Mine", "does not define 'Mine'; it has: MySpring"),
        ("my_spring.py", "'my_spring.py:'", "unknown environment kind 'my_spring.py:'"),
        ("my_spring.py", "lerobot", "pip install ./integrations"),
        (
            "pressing",
            "my_spring.py",
            "MySpring of my_spring.py must be a frozen dataclass that inherits",
        ),
    ],
)
def test_a_problem_in_the_launch_file_has_its_place(
    tmp_path: Path, old: str, new: str, message: str
) -> None:
    problems = problems_of(own(tmp_path, launch=LAUNCH.replace(old, new, 1)))
    assert message in problems
    assert "graph.yaml:" in problems


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("from typing", "import nonsense\nfrom typing", "my_spring.py:2: import nonsense"),
        ("def force", "def force(", "my_spring.py:14: def force((self"),
        ("from typing", "raise SystemExit(3)\nfrom typing", "SystemExit: 3\n  in "),
        ("from typing", "\0from typing", "cannot load my_spring.py"),
        ("(frozen=True)", "", "must be a frozen dataclass: write @dataclass(frozen=True)"),
        ("def force", "def push", "class MySpring of my_spring.py has no method force"),
        (", elapsed: float)", ")", "force must take 4 arguments besides self"),
        ("rest: Length = 0.0", "rest: Nothing = 0.0", "NameError: name 'Nothing'"),
        ("    rest: Length", "    kind: Length", "a parameter cannot be called 'kind'"),
        ("rest: Length = 0.0", "rest: float = float('nan')", "rest cannot be written down"),
        ("rest: Length", "rest: compile", "a launch file cannot give 'rest' of the type"),
        (" = 500.0\n    rest: Length = 0.0", "\n    rest: Length", "environment needs 'rest'"),
        (
            "    def force",
            "    def __post_init__(self) -> None:\n        self.rest[0]\n\n    def force",
            "TypeError: 'float' object is not subscriptable",
        ),
    ],
)
def test_a_problem_in_the_users_file_is_told_with_its_line(
    tmp_path: Path, old: str, new: str, message: str
) -> None:
    problems = problems_of(own(tmp_path, SPRING.replace(old, new, 1)))
    assert message in problems
    assert "graph.yaml:" in problems


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        ("1 / 0, (", "my_spring.py:15: return 1 / 0"),
        ("'x', (", "expected a tuple with 1 number in N, one per axis; got 2"),
    ],
)
def test_a_wrong_answer_is_found_where_a_command_tries_the_file_and_not_by_loading_it(
    tmp_path: Path, answer: str, message: str
) -> None:
    path = own(tmp_path, SPRING.replace("return (", f"return {answer}", 1))
    load(path)
    with pytest.raises(ConfigError) as caught:
        load_tried(path)
    assert message in str(caught.value)
    assert "graph.yaml:" in str(caught.value)


def test_a_file_can_be_mended_after_an_error(tmp_path: Path) -> None:
    problems_of(own(tmp_path, "import nonsense\n"))
    assert force_of(load(own(tmp_path)), (0.0,)) == (0.0,)


def test_a_class_that_no_launch_file_can_name_is_refused_with_what_to_do() -> None:
    with pytest.raises(ConfigError, match="keep the class in a file and name it in a launch file"):
        part_document("environment", object())


# --- the command and the template ----------------------------------------------------------------


def test_the_template_keeps_the_contract_and_its_launch_file_runs() -> None:
    result = invoke("check", "environment", str(EXAMPLES / "my_environment.py"), "--rest", "0mm=0N")
    assert result.exit_code == 0, result.output
    assert "BROKEN" not in result.output
    config = load(EXAMPLES / "my_environment.yaml")
    summary = run_virtual(config, duration=1.0).summary
    assert summary["true_energy_min_j"] >= -1e-9
    assert summary["displayed_stiffness_n_per_m"] == pytest.approx(1000.0, rel=0.01)


def test_the_check_prints_one_document(tmp_path: Path) -> None:
    own(tmp_path)
    kind = str(tmp_path / "my_spring.py")
    result = invoke("check", "environment", kind, "stiffness:=1 N/mm", "--axes", "2", "--json")
    assert result.exit_code == 0
    document = json.loads(result.stdout)
    assert document["passed"]
    assert document["part"]["stiffness"] == 1000.0
    assert document["at_rest"][0] == {"position_m": -0.01, "force_n": -10.0}
    assert document["seconds_per_answer"]["median"] > 0
    kept = {"opens", "answers", "shape", "finite", "pure", "signals", "users", "value"}
    assert set(document["promises"]) == kept


def test_the_check_fails_with_what_was_expected_what_came_and_where(tmp_path: Path) -> None:
    own(tmp_path, SPRING.replace("*[0.0] * (len(position) - 1)", ""))
    result = invoke("check", "environment", str(tmp_path / "my_spring.py"))
    assert result.exit_code == 1
    assert "BROKEN  shape" in result.output
    assert "expected a tuple with 2 numbers in N, one per axis" in result.output
    assert "breaks its contract" in result.stderr


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["nothing.py"], "nothing.py: No such file"),
        (["wall", "stifness:=1"], "argument stifness:=1: unknown key in environment: 'stifness'"),
        (["wall", "kind:=damper"], "'kind' is given twice, or is no parameter"),
        (["wall", "--rest", "5 s=0"], "--rest 5 s=0: expected a length in m"),
    ],
)
def test_a_wrong_word_of_the_check_is_told(words: list[str], message: str) -> None:
    result = invoke("check", "environment", *words)
    assert result.exit_code == 2
    assert message in result.stderr
