"""Values of a launch file that are given by their paths, in place of those of the file."""

from pathlib import Path
from typing import Any

import pytest
from invoking import invoke
from launch_texts import GOOD, problems_of, written

from forcebound.errors import ConfigError
from forcebound.graph.loader import load
from forcebound.graph.resolved import to_document
from forcebound.haptics.environments.walls import Wall

PHASES = "phases: [{name: soft, duration: 1 s, set: {environment.stiffness: 1 N/mm}}]\n"


def value_of(file: Path | str, path: str, *overrides: str) -> Any:
    """The value at a path of the resolved document, its keys by ``/``."""
    found: Any = to_document(load(file, overrides))
    for key in path.split("/"):
        found = found[key]
    return found


@pytest.mark.parametrize(
    ("override", "path", "value"),
    [
        ("environment.stiffness:=2 N/mm", "environment/stiffness", 2000.0),
        ("environment.stiffness:=300", "environment/stiffness", 300.0),
        ("environment.compute_delay:=2 ms", "environment/compute_delay", 0.002),  # not in the file
        ("environment.fixtures.speed.limit:=1 m/s", "environment/fixtures/speed/limit", 1.0),
        ("device.rate:=2 kHz", "hands/hand/device/rate", 2000.0),
        ("device.law:=none", "hands/hand/device/law", "none"),  # an argument in the file
        ("hands.hand.device.law:=none", "hands/hand/device/law", "none"),
        ("operator.mass:=500 g", "hands/hand/operator/mass", 0.5),
        ("links.environment_query.loss:=10 %", "hands/hand/links/environment_query/loss", 0.1),
        ("links.force_command.delay:=3 ms", "hands/hand/links/force_command/delay", 0.003),
        ("realtime.policy:=other", "realtime/policy", "other"),
    ],
)
def test_a_value_given_by_its_path_is_that_of_the_file(
    override: str, path: str, value: object, tmp_path: Path
) -> None:
    file = written(tmp_path, GOOD)
    assert value_of(file, path, override) == pytest.approx(value)
    rest = to_document(load(file, [override]))
    assert value_of(file, "seed") == rest["seed"]
    assert value_of(file, "hands/hand/device/kind") == rest["hands"]["hand"]["device"]["kind"]


def test_what_is_beside_a_value_stays(tmp_path: Path) -> None:
    file = written(tmp_path, GOOD)
    config = load(file, ["links.environment_query.loss:=10 %", "stiffness:=3 N/mm"])
    link = config.only.links["environment_query"]
    assert (link.delay, link.loss) == (0.002, 0.1)
    assert config.environment.model == Wall(stiffness=3000.0)
    assert config.units["links.environment_query.loss"] == "%"


def test_a_path_reaches_an_included_file(tmp_path: Path) -> None:
    file = written(tmp_path, "forcebound: 1\ninclude: stiff_wall.yaml\n")
    assert value_of(file, "environment/position", "environment.position:=2 mm") == 0.002


def test_the_phases_of_a_file_begin_with_values_given_by_path(tmp_path: Path) -> None:
    file = written(tmp_path, GOOD.replace("duration: 6 s\n", PHASES))
    config = load(file, ["environment.stiffness:=1 N/mm"])
    assert config.phases[0].settings == {}  # as the file now says
    assert load(file).phases[0].settings == {"environment.stiffness": 1000.0}


@pytest.mark.parametrize(
    ("override", "path"),
    [
        ("left.device.law:=none", "hands/left/device/law"),
        ("hands.left.device.law:=none", "hands/left/device/law"),
        ("right.operator.mass:=1 kg", "hands/right/operator/mass"),
        ("right.links.force_command.loss:=1 %", "hands/right/links/force_command/loss"),
        ("environment.thickness:=30 mm", "environment/thickness"),
    ],
)
def test_with_several_hands_a_path_changes_the_value_of_one(override: str, path: str) -> None:
    before, after = to_document(load("two_hands")), to_document(load("two_hands", [override]))
    before["units"] = after["units"] = None
    changed = [one for one in _leaves(after) if one not in _leaves(before)]
    section = path.rpartition("/")[0]  # the whole of a link that the file does not have
    assert path in {place for place, _ in changed}
    assert all(place.startswith(section) for place, _ in changed)


def _leaves(value: Any, place: str = "") -> list[tuple[str, Any]]:
    if not isinstance(value, dict):
        return [(place, value)]
    return [one for key in value for one in _leaves(value[key], f"{place}/{key}".lstrip("/"))]


@pytest.mark.parametrize(
    ("override", "words"),
    [
        ("environment.stifness:=2 N/mm", "'stiffness'"),
        ("device.rat:=2 kHz", "'rate'"),
        ("links.environment_rep.delay:=2 ms", "'environment_reply'"),
        ("environment.stiffness:=2 kg", "a mass"),
        ("environment.stiffness:=many", "'many'"),
        ("device.law:=nonsense", "'nonsense'"),
        ("operator.kind:=nobody", "'nobody'"),
        ("links.environment_query.delay:=200 s", "age_limit"),
    ],
)
def test_a_wrong_value_is_refused_at_the_argument(
    override: str, words: str, tmp_path: Path
) -> None:
    (line, *_) = problems_of(written(tmp_path, GOOD), override).splitlines()
    assert words in line
    place = f"argument {override}: "
    assert line.startswith(place) != (words == "age_limit")  # a check of several sections


def test_a_wrong_value_of_one_hand_is_refused_at_the_argument() -> None:
    (line,) = problems_of("two_hands", "left.device.lw:=none").splitlines()
    assert line.startswith("argument left.device.lw:=none: ")
    assert "'law'" in line


def test_a_name_without_a_dot_is_an_argument(tmp_path: Path) -> None:
    file = written(tmp_path, GOOD)
    assert "unknown argument 'environment'" in problems_of(file, "environment:=none")
    assert value_of(file, "environment/stiffness", "stiffness:=2") == 2.0


def test_every_problem_of_arguments_and_paths_is_said_at_once(tmp_path: Path) -> None:
    file = written(tmp_path, GOOD)
    said = problems_of(file, "environment.stiffness:=2 kg", "device.rate:=2 kg", "lw:=none")
    assert [line.split(":=")[0] for line in said.splitlines()] == [
        "argument lw",
        "argument device.rate",
        "argument environment.stiffness",
    ]


def test_commands_take_values_by_their_paths(tmp_path: Path) -> None:
    recording = tmp_path / "run.mcap"
    words = ["environment.stiffness:=2 N/mm", "--duration", "100ms", "--json"]
    done = invoke("simulate", "stiff_wall", *words, "--record", str(recording))
    assert done.exit_code == 0, done.stderr
    done = invoke("replay", str(recording), "device.law:=none", "--json")
    assert done.exit_code == 0, done.stderr
    assert invoke("simulate", "stiff_wall", "environment.stiffness:=2 kg").exit_code == 2


@pytest.mark.parametrize(
    "overrides",
    [
        ("law:=none", "device.law:=certified"),
        ("stiffness:=1 N/mm", "environment.stiffness:=2 N/mm"),
        ("device.rate:=1 kHz", "device.rate:=2 kHz"),
    ],
)
def test_a_value_is_given_once_as_an_argument_or_by_its_path(overrides: tuple[str, str]) -> None:
    with pytest.raises(ConfigError, match="is given twice") as caught:
        load("stiff_wall", overrides)
    assert f"first argument {overrides[0]}" in str(caught.value)


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("enviroment.stiffness:=2", "unknown section or hand 'enviroment'; did you mean 'environ"),
        ("seed.x:=3", "unknown section or hand 'seed'"),
        ("links.environment_query.delay.x:=5 ms", "argument links.*delay: expected a time in s"),
    ],
)
def test_a_path_that_leads_nowhere_is_refused_at_the_argument(override: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        load("stiff_wall", [override])


def test_a_path_without_a_hand_is_refused_where_there_are_several() -> None:
    with pytest.raises(ConfigError, match=r"whose device\.law\? .* left\.device\.law or right\."):
        load("two_hands", ["device.law:=none"])
