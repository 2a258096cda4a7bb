import re
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from launch_texts import GOOD, problems_of, written

from forcebound.errors import ConfigError
from forcebound.graph.document import MAX_BYTES
from forcebound.graph.graph import GraphConfig
from forcebound.graph.loader import from_document, load, load_tried
from forcebound.graph.problems import unknown
from forcebound.graph.resolved import to_document
from forcebound.messages.topology import flat


@pytest.mark.parametrize(
    ("old", "new", "place", "named"),
    [
        # keys
        ("seed: 1", "sed: 1", "6:1", "'seed'"),
        ("seed: 1", "xyzzy: 1", "6:1", "arguments"),
        ("  stiffness: $", "  stifness: $", "14:3", "'stiffness'"),
        ("  law: $(arg", "  axis: $(arg", "10:3", "'axis'"),
        ("{delay: 2", "{dealy: 2", "16:23", "'delay'"),
        ("environment_query:", "telemetry:", "16:3", "'telemetry'"),
        ("seed: 1", "seed: 1\nseed: 2", "7:1", "'seed'"),
        ("seed: 1", "[1]: 1\nseed: 1", "6:1", "a list"),
        ("seed: 1\n", "", "1:1", "'seed'"),
        ("  kind: wall\n", "", "12:1", "'kind'"),
        ("forcebound: 1\n", "", "1:1", "'forcebound'"),
        ("forcebound: 1", "forcebound: 2", "1:13", "format 1"),
        ("forcebound: 1", "forcebound: true", "1:13", "'true'"),
        # kinds and names
        ("wall\n", "wal\n", "13:9", "'wall'"),
        ("wall\n", "[wall]\n", "13:9", "active_wall"),
        ("premium_1_5", "premium_15", "9:9", "'phantom_premium_1_5'"),
        ("$(arg law)", "certfied", "10:8", "'certified'"),
        ("$(arg law)", "3", "10:8", "text"),
        # values
        ("$(arg stiffness)", "5 s", "14:14", "N/m"),
        ("$(arg stiffness)", "-5", "14:14", ">= 0 N/m"),
        ("$(arg stiffness)", "", "14:3", "nothing"),
        ("$(arg stiffness)", "{a: 1}", "14:14", "N/m"),
        ("6 s", "0 s", "7:11", "> 0 s"),
        ("6 s", "20 periods", "7:11", "'periods'"),
        ("6 s", ".inf", "7:11", "finite"),
        ("6 s", "true", "7:11", "true"),
        ("seed: 1", "seed: 1.5", "6:7", "'1.5'"),
        ("seed: 1", "seed: -1", "6:7", ">= 0"),
        ("seed: 1", "seed: true", "6:7", "'true'"),
        ("2 ms", "-2 ms", "16:30", "0 to 86400 s"),
        ("delay: 2 ms", "loss: 2", "16:29", "0 to 1"),
        ("  law: $", "  reply_wait: 1\n  law: $", "10:15", "< 1"),
        ("  law: $", "  hold_limit: 0.5\n  law: $", "10:15", "1 to 1e+06"),
        ("  law: $", "  hold_limit: long\n  law: $", "10:15", "'auto'"),
        ("  law: $", "  rate: 0 Hz\n  law: $", "10:9", "0.1 to 1e+06 Hz"),
        ("  law: $", "  axes: 9\n  law: $", "10:9", "1 to 8"),
        ("seed: 1", "seed: 1\nrealtime: {policy: rr}", "7:20", "'fifo' or 'other'"),
        ("seed: 1", "seed: 1\nrealtime: {cores: all}", "7:19", "a whole number"),
        ("seed: 1", "seed: 1\nrealtime: {cores: -1}", "7:19", ">= 0"),
        ("seed: 1", "seed: 1\nrealtime: {lock_memory: 1}", "7:25", "true or false"),
        ("{kind: pressing}", "none", "11:11", "a mapping"),
        ("{kind: pressing}", "{kind: trajectory}", "11:1", "'file'"),
        ("pressing", "trajectory, file: no.csv", "11:36", "no.csv"),
        # several sections
        ("2 ms", "100 ms", "8:1", "age_limit"),
        # substitution
        ("$(arg law)", "$(arg lwa)", "10:8", "'law'"),
        ("$(arg law)", "$(args law)", "10:8", "'$(args law)'"),
        ("$(arg law)", "$(arg law", "10:8", "'$(arg law'"),
        ("$(arg law)", "${HOME}", "10:8", "'${HOME}'"),
        ("$(arg law)", "${env:FB_NONE}", "10:8", "FB_NONE"),
        ("6 s", "$(arg mode) s", "7:11", "'soft s'"),
        # arguments
        ("10 N/mm", "$(arg law)", "4:14", "$(arg law)"),
        ("10 N/mm", "[1]", "4:14", "a single value"),
        ("help: bounding", "hepl: bounding", "3:29", "'help'"),
        ("default: soft", "default: sfot", "5:19", "'soft'"),
        ("[soft, hard]", "soft", "5:34", "a list"),
        ("  stiffness: 10", "  big-one: 1\n  stiffness: 10", "4:3", "'big-one'"),
        ("default: certified, ", "", "3:3", "law:=..."),
        # YAML
        ("  law: $", "\tlaw: $", "10:1", "a tab"),
        ("seed: 1", "seed: 1: 2", "6:8", "not YAML"),
        ("seed: 1", "seed: 'x", None, "not YAML"),
        ("seed: 1", "seed: *x", "6:7", "'x'"),
        ("seed: 1", "seed: &x 1", "6:7", "$(arg x)"),
        ("seed: 1", "seed: !mine 1", "6:7", "!mine"),
        ("seed: 1", "seed: \x00", "6:7", "not YAML"),
        ("seed: 1", "seed: 1\n---\na: 1", "7:1", "another document"),
        # includes
        ("seed: 1", "include: no.yaml", "6:10", "'no.yaml'"),
        ("seed: 1", "include: [a]", "6:10", "a list"),
        # phases
        ("duration: 6 s", "phases: []", "7:9", "at least one"),
        ("duration: 6 s", "phases: [{name: a, duration: 0 s}]", "7:30", "> 0 s"),
    ],
)
def test_a_problem_names_its_place(
    old: str, new: str, place: str | None, named: str, tmp_path: Path
) -> None:
    assert old in GOOD
    path = written(tmp_path, GOOD.replace(old, new, 1))
    begin = f"{path}:" if place is None else f"{path}:{place}: "
    lines = problems_of(path).splitlines()
    assert any(line.startswith(begin) and named in line for line in lines), lines


@pytest.mark.parametrize(
    ("content", "fragment"),
    [
        (b"", "graph.yaml: the launch file is empty"),
        (b"# nothing\n", "graph.yaml: the launch file is empty"),
        (b"---\n", "graph.yaml: the launch file is empty"),
        (b"- a\n- b\n", "graph.yaml:1:1: a launch file is a mapping, got a list"),
        (b"stiff wall\n", "graph.yaml:1:1: a launch file is a mapping, got 'stiff wall'"),
        (b"a: 1\nb: \xff\xfe\n", "graph.yaml:2:4: byte 0xff is not UTF-8"),
        (b"[" * 100_000, "nested too deeply"),
        (b"#" * (MAX_BYTES + 1), "more than 256000 bytes"),
    ],
    ids=lambda value: str(value)[:30],
)
def test_what_is_no_launch_file_at_all_is_said_plainly(
    content: bytes, fragment: str, tmp_path: Path
) -> None:
    assert fragment in problems_of(written(tmp_path, content))


def test_a_variable_in_braces_is_told_to_be_quoted(tmp_path: Path) -> None:
    path = written(tmp_path, GOOD.replace("{kind: pressing}", "{kind: ${env:KIND}}"))
    assert "within braces, write it in quotes: '${env:NAME}'" in problems_of(path)


@pytest.mark.parametrize(
    ("name", "near"), [("stif_wall", "stiff_wall"), ("grahp.yaml", "graph.yaml")]
)
def test_the_nearest_file_is_named(tmp_path: Path, name: str, near: str) -> None:
    written(tmp_path, GOOD)
    assert f"did you mean '{near}" in problems_of(tmp_path / name)


def test_a_target_whose_unit_is_missing_is_remarked_on(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    load_tried(written(tmp_path, GOOD))
    assert not caplog.messages
    load_tried(written(tmp_path, GOOD.replace("{kind: pressing}", "{kind: pressing, end: 14}")))
    assert caplog.messages == ["the operator's target goes as far as 14 m: is a unit missing?"]


def test_all_problems_come_at_once_in_the_order_of_the_file(tmp_path: Path) -> None:
    text = (
        GOOD.replace("seed: 1", "sede: 1")
        .replace("6 s", "6 kg")
        .replace("$(arg law)", "certfied")
        .replace("{kind: pressing}", "{kind: pressing, mass: 3 s, approach_speed: -1}")
        .replace("$(arg stiffness)", "$(arg stiff)")
        .replace("2 ms", "-2 ms, loss: 3, jitter: 1 N")
    )
    message = problems_of(written(tmp_path, text))
    places = re.findall(r"graph\.yaml:(\d+:\d+): (\S+)", message)
    assert places == [
        ("1:1", "the"),
        ("6:1", "unknown"),
        ("7:11", "duration:"),
        ("10:8", "law:"),
        ("11:34", "mass:"),
        ("11:55", "approach_speed:"),
        ("14:14", "unknown"),
        ("16:30", "delay:"),
        ("16:43", "loss:"),
        ("16:54", "jitter:"),
    ]


def test_a_problem_shows_its_line_and_a_caret(tmp_path: Path) -> None:
    path = written(tmp_path, GOOD.replace("$(arg law)", "certfied"))
    assert problems_of(path) == (
        f"{path}:10:8: law: unknown law 'certfied'; did you mean 'certified'?\n"
        "   10 |   law: certfied\n"
        "      |        ^"
    )


# --- overrides -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("override", "named"),
    [
        ("stifness:=3", "'stiffness'"),
        ("stiffness=3", "'stiffness:=3'"),
        ("stiffness", "name:=value"),
        ("stiffness:=", "N/m"),
        ("stiffness:=5 s", "N/m"),
        ("law:=certfied", "'certified'"),
        ("mode:=sotf", "'soft'"),
        ("mode:=hard", "uses this argument"),
    ],
)
def test_a_wrong_override_is_named_as_it_was_written(
    override: str, named: str, tmp_path: Path
) -> None:
    first = problems_of(written(tmp_path, GOOD), override).splitlines()[0]
    assert first.startswith(f"argument {override}: ")
    assert named in first


def test_a_wrong_override_also_shows_the_line_that_uses_it(tmp_path: Path) -> None:
    path = written(tmp_path, GOOD)
    assert problems_of(path, "stiffness:=-5 N/mm") == (
        "argument stiffness:=-5 N/mm: stiffness: must be >= 0 N/m, got -5000 N/m\n"
        f"  used at {path}:14:14\n"
        "   14 |   stiffness: $(arg stiffness)\n"
        "      |              ^"
    )


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"duration": "6 kg"}, "document: duration: "),
        ({"device": {"kind": "x"}}, "document: device.kind: unknown"),
        ({"links": [1]}, "document: links: "),
        ({"surprise": None}, "'surprise'"),
    ],
)
def test_a_damaged_document_names_the_path_to_the_value(
    change: dict[str, Any], message: str
) -> None:
    with pytest.raises(ConfigError) as caught:
        from_document({**flat(to_document(load("stiff_wall"))), **change})
    assert message in str(caught.value)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.sampled_from(["law", "stiffness", "mode"]), st.text(max_size=20))
def test_any_override_gives_a_configuration_or_a_config_error(
    tmp_path: Path, name: str, text: str
) -> None:
    path = written(tmp_path, GOOD)
    with suppress(ConfigError):
        assert isinstance(load(path, [f"{name}:={text}"]), GraphConfig)


@pytest.mark.parametrize(
    ("name", "nearest"),
    [
        ("amp", "amplitude"),
        ("damp", "damping"),
        ("speed", "approach_speed"),
        ("dampling", "damping"),
    ],
)
def test_a_name_is_found_by_its_beginning_then_a_word_of_it_then_its_looks(
    name: str, nearest: str
) -> None:
    known = ("amplitude", "approach_speed", "damping")
    assert unknown("argument", name, known).endswith(f"did you mean {nearest!r}?")
