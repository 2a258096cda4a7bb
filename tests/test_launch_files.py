import json
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from launch_texts import GOOD, problems_of, written

from forcebound.errors import ConfigError
from forcebound.graph.document import GROUPS, descriptions, shipped
from forcebound.graph.fields import fields_of
from forcebound.graph.graph import KINDS, SECTION_SETTINGS
from forcebound.graph.loader import arguments_of, from_document, load
from forcebound.graph.model import always, restore
from forcebound.graph.resolved import run_document, to_document
from forcebound.graph.schema import json_schema
from forcebound.graph.servo import ServoSettings
from forcebound.graph.tree import scalar
from forcebound.messages.topology import IMPAIRABLE, ONE_HAND, flat

# --- what ships ----------------------------------------------------------------------------------


@pytest.fixture(params=shipped())
def shipped_name(request: pytest.FixtureRequest) -> str:
    return str(request.param)


def test_every_shipped_file_is_in_one_group_and_has_a_line() -> None:
    grouped = [name for names in GROUPS.values() for name in names]
    assert sorted(f"{name}.yaml" for name in grouped) == shipped()
    lines = [line for named in descriptions().values() for line in named.values()]
    assert len(lines) == len(grouped)
    assert all(line.endswith(".") for line in lines)


def test_every_shipped_file_takes_the_common_arguments(shipped_name: str) -> None:
    arguments = {argument.name: argument for argument in arguments_of(shipped_name)}
    common = {"law", "delay", "compute_delay", "seed"}  # a hand or world may replace the others
    assert common <= set(arguments)
    assert all(argument.help for argument in arguments.values())


@pytest.mark.parametrize("name", ["stiff_wall", "time_varying_wall", "delayed_wall"])
def test_the_common_arguments_do_what_they_say(name: str) -> None:
    config = load(
        name,
        [
            "law:=none",
            "stiffness:=3 N/mm",
            "approach_speed:=35 mm/s",
            "delay:=4 ms",
            "compute_delay:=1 ms",
            "seed:=7",
        ],
    )
    document = to_document(config)
    assert config.only.servo.law == "none"
    assert document["environment"]["stiffness"] == 3000.0
    assert document["hands"]["hand"]["operator"]["approach_speed"] == 0.035
    assert (
        config.only.links["environment_query"].delay == config.only.links["environment_reply"].delay
    )
    assert config.only.links["environment_reply"].delay == 0.004
    assert config.environment.compute_delay == 0.001
    assert config.seed == 7


def test_a_resolved_document_is_a_launch_file_in_plain_json(
    shipped_name: str, schema: dict[str, Any], tmp_path: Path
) -> None:
    config = load(shipped_name)
    document = to_document(config)
    text = json.dumps(document, allow_nan=False)
    assert restore(json.loads(text), always) == config
    assert load(written(tmp_path, text)) == config
    assert accepts(schema, document)
    assert accepts(schema, as_plain(shipped_name))


@pytest.mark.parametrize("kind", ONE_HAND.loop)
def test_a_node_process_loads_no_parser_of_launch_files_or_recordings(
    kind: str, tmp_path: Path
) -> None:
    document = written(tmp_path, json.dumps(run_document(load("stress"))), "launch.json")
    program = (
        "import json, sys\n"
        "from forcebound.graph.model import restore\n"
        "from forcebound.run import worker\n"
        "makes = worker.parts_of(sys.argv[2])\n"
        "config = restore(json.load(open(sys.argv[1])), makes)\n"
        "worker.build_node(sys.argv[2], config)\n"
        "worker.Tuner(config)\n"
        "parsers = {'mcap', 'ruamel.yaml'}\n"
        "sys.exit(str(sorted(parsers & set(sys.modules)) or ''))\n"
    )
    command = [sys.executable, "-c", program, str(document), kind]
    out = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert out.stderr.strip() == ""


@pytest.mark.parametrize("change", [{"seed": None}, {"device": {}}, {"links": 3}])
def test_what_is_no_resolved_document_is_refused(change: dict[str, Any]) -> None:
    damaged = {**flat(to_document(load("stiff_wall"))), **change}
    with pytest.raises(ConfigError, match="no resolved launch document"):
        restore({name: value for name, value in damaged.items() if value is not None})


def model_in(environment: dict[str, Any]) -> dict[str, Any]:
    return {
        name: value
        for name, value in environment.items()
        if name not in SECTION_SETTINGS["environment"]
    }


def test_the_stiff_wall_is_the_experiment_of_the_paper() -> None:
    document = to_document(load("stiff_wall"))
    assert model_in(document["environment"]) == {
        "kind": "wall",
        "stiffness": 10_000.0,
        "position": 0.01,
    }
    assert document["environment"]["compute_delay"] == 0.0
    assert document["hands"]["hand"]["operator"] == {
        "kind": "pressing",
        "mass": 0.275,
        "stiffness": 950.0,
        "damping": 2.8,
        "start": -0.01,
        "end": 0.014,
        "approach_speed": 0.2,
    }
    assert document["duration"] == 6.0


@pytest.mark.parametrize("name", ["stiff_wall", "stiff_wall.yaml", "launch/stiff_wall.yaml"])
def test_a_shipped_file_is_found_from_any_folder(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert load(name) == load(Path("launch") / "stiff_wall")


def test_a_file_on_disk_goes_before_a_shipped_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    written(tmp_path, GOOD.replace("duration: 6 s", "duration: 1 s"), "stiff_wall.yaml")
    assert load("stiff_wall.yaml").duration == 1.0


# --- what can be said ----------------------------------------------------------------------------


def test_what_is_not_said_keeps_its_default(tmp_path: Path) -> None:
    config = load(written(tmp_path, GOOD))
    assert config.only.servo == ServoSettings()
    assert config.environment.compute_delay == 0.0
    assert config.realtime.cores == "auto"
    assert flat(to_document(config))["controller"] == {"kind": "direct"}
    assert set(config.only.links) == {"environment_query"}


@pytest.mark.parametrize(
    ("old", "new", "path", "value"),
    [
        ("seed: 1", "seed: 0x10", ("seed",), 16),
        ("6 s", "'6 s'", ("duration",), 6.0),
        ("6 s", "6", ("duration",), 6.0),
        ("6 s", "6000 ms", ("duration",), 6.0),
        ("seed: 1", "seed: 1\ndescription: a $(arg law) run", ("description",), "a certified run"),
        ("seed: 1", "seed: 1\nrealtime: {cores: 3}", ("realtime", "cores"), 3),
        ("seed: 1", "seed: 1\nrealtime: {cores: none}", ("realtime", "cores"), "none"),
        ("seed: 1", "seed: 1\nrealtime:", ("realtime", "policy"), "fifo"),
        ("delay: 2 ms", "loss: 5 %", ("links", "environment_query", "loss"), 0.05),
        ("seed: 1", "seed: ${env:FB_SEED}", ("seed",), 42),
        ("seed: 1", "seed: ${env:FB_NONE:-5}", ("seed",), 5),
        (
            "delay: 2 ms",
            "delay: '${env:FB_SEED} ms'",
            ("links", "environment_query", "delay"),
            0.042,
        ),
        ("{kind: pressing}", "{kind: pressing, mass: 300 g}", ("operator", "mass"), 0.3),
    ],
)
def test_a_value_can_be_written_in_many_ways(
    old: str,
    new: str,
    path: tuple[str, ...],
    value: object,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("FB_SEED", "42")
    monkeypatch.delenv("FB_NONE", raising=False)
    found: Any = flat(to_document(load(written(tmp_path, GOOD.replace(old, new, 1)))))
    for key in path:
        found = found[key]
    assert found == value
    assert type(found) is type(value)


def test_windows_line_ends_and_a_byte_order_mark_are_fine(tmp_path: Path) -> None:
    plain = load(written(tmp_path, GOOD))
    assert load(written(tmp_path, b"\xef\xbb\xbf" + GOOD.replace("\n", "\r\n").encode())) == plain


def test_a_path_is_relative_to_the_file_that_says_it(tmp_path: Path) -> None:
    (tmp_path / "paths").mkdir()
    written(tmp_path / "paths", "t,x\n0,0\n1,0.01\n", "hand.csv")
    text = GOOD.replace("{kind: pressing}", "{kind: trajectory, file: paths/hand.csv}")
    config = load(written(tmp_path, text))
    assert flat(to_document(config))["operator"]["file"] == str(tmp_path / "paths" / "hand.csv")
    assert from_document(to_document(config)) == config


@pytest.mark.parametrize(
    ("text", "meaning"),
    [
        ("1", 1),
        ("-3", -3),
        ("0o17", 15),
        ("0xff", 255),
        ("1e3", 1000.0),
        (".5", 0.5),
        ("true", True),
        ("yes", "yes"),
        ("~", None),
        ("null", None),
        ("012", 12),
        ("1_000", "1_000"),
        ("2026-01-01", "2026-01-01"),
        ("10 N/mm", "10 N/mm"),
        ("9" * 5000, float("inf")),
    ],
    ids=lambda value: str(value)[:20],
)
def test_an_unquoted_word_means_what_yaml_1_2_says(text: str, meaning: object) -> None:
    assert scalar(text) == meaning
    assert type(scalar(text)) is type(meaning) or isinstance(meaning, str)


# --- includes ------------------------------------------------------------------------------------


def test_the_including_file_wins_key_by_key(tmp_path: Path) -> None:
    written(tmp_path, GOOD, "base.yaml")
    path = written(
        tmp_path,
        "forcebound: 1\ninclude: base.yaml\nduration: 2 s\narguments: {law: none}\n"
        "operator: {mass: 300 g}\n",
        "top.yaml",
    )
    config = load(path)
    assert (config.duration, config.seed, config.only.servo.law) == (2.0, 1, "none")
    assert config.only.operator is not None
    assert config.only.operator.mass == 0.3
    assert {a.name: (a.default, a.help) for a in arguments_of(path)}["law"] == (
        "none",
        "bounding law",
    )


def test_another_kind_replaces_the_whole_section(tmp_path: Path) -> None:
    written(tmp_path, GOOD, "base.yaml")
    path = written(
        tmp_path,
        "forcebound: 1\ninclude: base.yaml\nenvironment: {kind: damper, damping: 3 N s/m}\n",
        "top.yaml",
    )
    environment = to_document(load(path))["environment"]
    assert model_in(environment) == {"kind": "damper", "damping": 3.0}


def test_a_problem_in_an_included_file_has_its_place_there(tmp_path: Path) -> None:
    base = written(tmp_path, GOOD.replace("duration: 6 s", "duration: 6 kg"), "base.yaml")
    top = written(tmp_path, "forcebound: 1\nsede: 3\ninclude: base.yaml\n", "top.yaml")
    message = problems_of(top)
    assert f"{base}:7:11: duration: expected a time" in message
    assert f"{top}:2:1: unknown key in the launch file: 'sede'; did you mean 'seed'?" in message


def test_files_that_include_each_other_are_refused(tmp_path: Path) -> None:
    written(tmp_path, "include: b.yaml\n", "a.yaml")
    written(tmp_path, "forcebound: 1\ninclude: a.yaml\n", "b.yaml")
    message = problems_of(tmp_path / "a.yaml")
    assert f"{tmp_path / 'b.yaml'}:2:10: files include each other: " in message
    assert "a.yaml includes b.yaml includes a.yaml" in message.replace(f"{tmp_path}/", "")


# --- editors -------------------------------------------------------------------------------------


def test_no_parameter_of_a_device_shares_its_name_with_a_servo_setting() -> None:
    for kind in KINDS["device"].values():
        assert not set(fields_of(kind)) & {"kind", *fields_of(ServoSettings)}
    for kind in KINDS["environment"].values():
        assert not set(fields_of(kind)) & {"kind", *SECTION_SETTINGS["environment"]}


@pytest.fixture(scope="module")
def schema() -> dict[str, Any]:
    return json_schema()


def test_every_kind_can_be_described_to_an_editor(schema: dict[str, Any]) -> None:
    properties = schema["properties"]
    for section, table in KINDS.items():
        assert len(properties[section]["anyOf"]) == len(table) + 1  # a user's file
    assert set(properties["links"]["properties"]) == set(IMPAIRABLE)
    json.dumps(schema, allow_nan=False)


def accepts(schema: dict[str, Any], value: Any) -> bool:
    """Whether a JSON schema accepts a value; of the keywords those that json_schema uses."""
    types: dict[str, tuple[type, ...]] = {
        "object": (dict,),
        "array": (list,),
        "string": (str,),
        "number": (int, float),
        "integer": (int,),
        "boolean": (bool,),
        "null": (type(None),),
    }
    if "type" in schema:
        names = schema["type"] if isinstance(schema["type"], list) else [schema["type"]]
        if not any(
            isinstance(value, types[name]) and (name == "boolean" or not isinstance(value, bool))
            for name in names
        ):
            return False
    if "const" in schema and value != schema["const"]:
        return False
    if "enum" in schema and value not in schema["enum"]:
        return False
    if "pattern" in schema and not re.search(schema["pattern"], str(value)):
        return False
    if "anyOf" in schema and not any(accepts(option, value) for option in schema["anyOf"]):
        return False
    if isinstance(value, dict):
        properties = schema.get("properties", {})
        others = schema.get("additionalProperties", True)
        for name, entry in value.items():
            option = properties.get(name, others)
            if option is False or (isinstance(option, dict) and not accepts(option, entry)):
                return False
        return all(name in value for name in schema.get("required", ()))
    return True


def as_plain(name: str) -> Any:
    from ruamel.yaml import YAML

    from forcebound.graph.document import SHIPPED

    return YAML(typ="safe", pure=True).load((SHIPPED / name).read_text())


@pytest.mark.parametrize(
    "change", [{"surprise": 1}, {"duration": True}, {"environment": {"kind": "wal"}}]
)
def test_the_schema_refuses_what_the_loader_refuses(
    schema: dict[str, Any], change: dict[str, Any]
) -> None:
    assert not accepts(schema, {**as_plain("stiff_wall.yaml"), **change})


def test_a_resolved_document_may_be_older_than_a_setting() -> None:
    document = run_document(load("stiff_wall"))
    del document["hands"]["hand"]["device"]["velocity_cutoff"]
    assert restore(document).only.servo == load("stiff_wall").only.servo
