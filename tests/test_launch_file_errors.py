import re
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from launch_texts import GOOD, problems_of, written

from forcebound.config.document import MAX_BYTES
from forcebound.config.graph import GraphConfig
from forcebound.config.loader import from_document, load, load_tried
from forcebound.config.problems import unknown
from forcebound.config.resolved import to_document
from forcebound.errors import ConfigError


@pytest.mark.parametrize(
    ("old", "new", "place", "fragment"),
    [
        # keys
        ("seed: 1", "sed: 1", "6:1", "unknown key in the launch file: 'sed'; did you mean 'seed'?"),
        ("seed: 1", "xyzzy: 1", "6:1", "known: arguments, "),
        ("  stiffness: $", "  stifness: $", "14:3", "did you mean 'stiffness'?"),
        ("  law: $(arg", "  axis: $(arg", "10:3", "unknown key in device: 'axis'"),
        ("{delay: 2", "{dealy: 2", "16:23", "unknown key in links.environment_query: 'dealy'"),
        ("environment_query:", "telemetry:", "16:3", "unknown key in links: 'telemetry'"),
        ("seed: 1", "seed: 1\nseed: 2", "7:1", "'seed' is given twice\n    7 | seed: 2"),
        ("seed: 1", "[1]: 1\nseed: 1", "6:1", "a key must be a name, got a list"),
        ("seed: 1\n", "", "1:1", "the launch file needs 'seed'"),
        ("  kind: wall\n", "", "12:1", "environment needs 'kind', one of active_wall, "),
        ("forcebound: 1\n", "", "1:1", "needs 'forcebound: 1'"),
        (
            "forcebound: 1",
            "forcebound: 2",
            "1:13",
            "reads launch files of format 1, this one is '2'",
        ),
        ("forcebound: 1", "forcebound: true", "1:13", "of format 1, this one is 'true'"),
        # kinds and names
        ("wall\n", "wal\n", "13:9", "unknown environment kind 'wal'; did you mean"),
        ("wall\n", "[wall]\n", "13:9", "kind must be one of active_wall, "),
        ("premium_1_5", "premium_15", "9:9", "did you mean 'phantom_premium_1_5'?"),
        ("$(arg law)", "certfied", "10:8", "unknown law 'certfied'; did you mean 'certified'?"),
        ("$(arg law)", "3", "10:8", "law: expected text, got '3'"),
        # values
        ("$(arg stiffness)", "5 s", "14:14", "stiffness: expected a stiffness in N/m"),
        ("$(arg stiffness)", "-5", "14:14", "stiffness: must be >= 0 N/m, got -5 N/m"),
        ("$(arg stiffness)", "", "14:3", "got nothing"),
        ("$(arg stiffness)", "{a: 1}", "14:14", "expected a stiffness in N/m"),
        ("6 s", "0 s", "7:11", "duration: must be > 0 s, got 0 s"),
        ("6 s", "20 periods", "7:11", "unknown unit 'periods'"),
        ("6 s", ".inf", "7:11", "finite; got inf"),
        ("6 s", "true", "7:11", "expected a time in s, for example 5 ms; got true"),
        ("seed: 1", "seed: 1.5", "6:7", "seed: expected a whole number, got '1.5'"),
        ("seed: 1", "seed: -1", "6:7", "seed: must be >= 0, got -1"),
        ("seed: 1", "seed: true", "6:7", "expected a whole number, got 'true'"),
        ("2 ms", "-2 ms", "16:30", "delay: must be >= 0 s"),
        ("delay: 2 ms", "loss: 2", "16:29", "loss: must be 0 to 1"),
        ("  law: $", "  reply_wait: 1\n  law: $", "10:15", "reply_wait: must be >= 0 and < 1"),
        ("  law: $", "  hold_limit: 0.5\n  law: $", "10:15", "hold_limit: must be 1 to 1e+06"),
        ("  law: $", "  hold_limit: long\n  law: $", "10:15", "got 'long'; or 'auto'"),
        ("  law: $", "  rate: 1e29\n  law: $", "10:9", "rate: must be 0.1 to 1e+06 Hz"),
        ("  law: $", "  hold_limit: 1e29\n  law: $", "10:15", "hold_limit: must be 1 to 1e+06"),
        ("6 s", "1e300 s", "7:11", "at most 9e+09 s; got '1e300 s'"),
        ("  law: $", "  rate: 0 Hz\n  law: $", "10:9", "rate: must be 0.1 to 1e+06 Hz, got 0 Hz"),
        ("  law: $", "  axes: 7\n  law: $", "10:9", "axes: must be 1 to 6"),
        (
            "seed: 1",
            "seed: 1\nrealtime: {policy: rr}",
            "7:20",
            "expected 'fifo' or 'other', got 'rr'",
        ),
        (
            "seed: 1",
            "seed: 1\nrealtime: {cores: all}",
            "7:19",
            "expected 'auto' or 'none' or a whole number, got 'all'",
        ),
        ("seed: 1", "seed: 1\nrealtime: {cores: -1}", "7:19", "cores: must be >= 0, got -1"),
        ("seed: 1", "seed: 1\nrealtime: {lock_memory: 1}", "7:25", "expected true or false"),
        ("{kind: pressing}", "none", "11:11", "operator must be a mapping, got 'none'"),
        ("{kind: pressing}", "{kind: trajectory}", "11:1", "operator needs 'file'"),
        ("pressing", "trajectory, file: no.csv", "11:36", "cannot read the trajectory"),
        # several sections
        ("2 ms", "100 ms", "8:1", "an answer takes at least 100 ms (delays of the links"),
        # substitution
        ("$(arg law)", "$(arg lwa)", "10:8", "unknown argument 'lwa'; did you mean 'law'?"),
        ("$(arg law)", "$(args law)", "10:8", "unknown substitution '$(args law)'"),
        ("$(arg law)", "$(arg law", "10:8", "unknown substitution '$(arg law'"),
        ("$(arg law)", "${HOME}", "10:8", "unknown substitution '${HOME}'; known are"),
        ("$(arg law)", "${env:FB_NONE}", "10:8", "environment variable FB_NONE is not set"),
        ("6 s", "$(arg mode) s", "7:11", "got 'soft s'\n    7 | duration: $(arg mode) s"),
        # arguments
        ("10 N/mm", "$(arg law)", "4:14", "$(arg law) cannot stand here"),
        ("10 N/mm", "[1]", "4:14", "a default is a single value"),
        ("help: bounding", "hepl: bounding", "3:29", "unknown key 'hepl'; did you mean 'help'?"),
        ("default: soft", "default: sfot", "5:19", "did you mean 'soft'?"),
        ("[soft, hard]", "soft", "5:34", "choices must be a list"),
        ("  stiffness: 10", "  big-one: 1\n  stiffness: 10", "4:3", "letters, digits and _"),
        ("default: certified, ", "", "3:3", "argument 'law' has no default; give it: law:=..."),
        # YAML
        ("  law: $", "\tlaw: $", "10:1", "a tab; YAML wants spaces here"),
        ("seed: 1", "seed: 1: 2", "6:8", "this is not YAML: mapping values are not allowed here"),
        ("seed: 1", "seed: 'x", None, "this is not YAML: "),
        ("seed: 1", "seed: *x", "6:7", "anchors and aliases (x) are not read; an argument"),
        ("seed: 1", "seed: &x 1", "6:7", "an argument does that: $(arg x)"),
        ("seed: 1", "seed: !!int 1", "6:7", "have no meaning here"),
        ("seed: 1", 'seed: "\\ud800"', "6:7", "half a surrogate pair"),
        ("seed: 1", "seed: \x00", "6:7", "special characters are not allowed"),
        ("seed: 1", "seed: 1\n---\na: 1", "7:1", "a second document begins"),
        # includes
        (
            "seed: 1",
            "include: no.yaml",
            "6:10",
            "there is no launch file 'no.yaml'; `forcebound launch` lists",
        ),
        ("seed: 1", "include: [a]", "6:10", "include must name one launch file, got a list"),
    ],
)
def test_a_problem_names_its_place(
    old: str, new: str, place: str | None, fragment: str, tmp_path: Path
) -> None:
    assert old in GOOD
    path = written(tmp_path, GOOD.replace(old, new, 1))
    message = problems_of(path)
    assert fragment in message
    if place is not None:
        line = next(text for text in message.splitlines() if fragment.split("\n")[0] in text)
        assert line.startswith(f"{path}:{place}: ")


@pytest.mark.parametrize(
    ("content", "fragment"),
    [
        (b"", "graph.yaml: the launch file is empty"),
        (b"# nothing\n", "graph.yaml: the launch file is empty"),
        (b"---\n", "graph.yaml: the launch file is empty"),
        (b"- a\n- b\n", "graph.yaml:1:1: a launch file is a mapping, got a list"),
        (b"stiff wall\n", "graph.yaml:1:1: a launch file is a mapping, got 'stiff wall'"),
        (b"a: 1\nb: \xff\xfe\n", "graph.yaml:2:4: byte 0xff is not UTF-8"),
        (b"[" * 1000, "nested deeper than 40 levels"),
        (b"#" * (MAX_BYTES + 1), "more than 256000 bytes"),
    ],
    ids=lambda value: str(value)[:30],
)
def test_what_is_no_launch_file_at_all_is_said_plainly(
    content: bytes, fragment: str, tmp_path: Path
) -> None:
    assert fragment in problems_of(written(tmp_path, content))


@pytest.mark.parametrize(
    "path", ["no_such_wall", "nowhere/stiff_wall.yaml", "a\0b", "x" * 5000, ""]
)
def test_of_a_missing_file_it_is_said_what_lists_those_that_ship(
    path: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert "`forcebound launch` lists those that come" in problems_of(path) or path == ""


def test_a_slip_in_include_is_told_alone(tmp_path: Path) -> None:
    path = written(tmp_path, "inculde: stiff_wall.yaml\ndevice: {rate: 1 kHz}\n")
    message = problems_of(path)
    assert message.splitlines()[0] == (
        f"{path}:1:1: unknown key in the launch file: 'inculde'; did you mean 'include'?"
    )
    assert "needs" not in message


def test_a_variable_in_braces_is_told_to_be_quoted(tmp_path: Path) -> None:
    path = written(tmp_path, GOOD.replace("{kind: pressing}", "{kind: ${env:KIND}}"))
    assert "within braces, write it in quotes: '${env:NAME}'" in problems_of(path)


@pytest.mark.parametrize(
    ("name", "near"), [("stif_wall", "stiff_wall"), ("grahp.yaml", "graph.yaml"), ("a\0b", "")]
)
def test_the_nearest_file_is_named(tmp_path: Path, name: str, near: str) -> None:
    written(tmp_path, GOOD)
    message = problems_of(tmp_path / name)
    assert f"did you mean '{near}" in message if near else "those that come with" in message


def test_a_target_whose_unit_is_missing_is_remarked_on(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    load_tried(written(tmp_path, GOOD))
    assert not caplog.messages
    load_tried(written(tmp_path, GOOD.replace("{kind: pressing}", "{kind: pressing, end: 14}")))
    assert caplog.messages == ["the operator's target goes as far as 14 m: is a unit missing?"]


def test_a_folder_is_not_a_launch_file(tmp_path: Path) -> None:
    assert problems_of(tmp_path) == (
        f"{tmp_path}: cannot read the launch file: it is a folder, not a file"
    )


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
        ("10:8", "unknown"),
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
        f"{path}:10:8: unknown law 'certfied'; did you mean 'certified'?\n"
        "   10 |   law: certfied\n"
        "      |        ^"
    )


def test_a_long_line_is_shown_around_its_caret(tmp_path: Path) -> None:
    filler = "x" * 500
    message = problems_of(
        written(tmp_path, GOOD.replace("seed: 1", f"? '{filler}'\n: 1\nseed: {{'{filler}': 1}}"))
    )
    assert max(len(line) for line in message.splitlines()[1:]) < 600
    excerpts = [line for line in message.splitlines() if re.match(r" +\d+ \|", line)]
    assert excerpts
    assert max(map(len, excerpts)) <= 108


# --- overrides -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("override", "fragment"),
    [
        (
            "stifness:=3",
            "argument stifness:=3: unknown argument 'stifness'; did you mean 'stiffness'?",
        ),
        ("stiffness=3", "argument stiffness=3: expected name:=value; did you mean 'stiffness:=3'?"),
        ("stiffness", "argument stiffness: expected name:=value"),
        ("stiffness:=", "argument stiffness:=: stiffness: expected a stiffness in N/m"),
        ("stiffness:=5 s", "argument stiffness:=5 s: stiffness: expected a stiffness in N/m"),
        (
            "law:=certfied",
            "argument law:=certfied: unknown law 'certfied'; did you mean 'certified'?",
        ),
        ("law:=\udcff", "argument law:=?: unknown law '?'"),
        ("mode:=sotf", "unknown choice for argument 'mode': 'sotf'; did you mean 'soft'?"),
        ("mode:=hard", "argument mode:=hard: nothing in the launch file uses this argument"),
        ("law:=" + "x" * 1000, "xxx...: unknown law 'xxx"),
    ],
    ids=lambda value: ascii(value)[:40],
)
def test_a_wrong_override_is_named_as_it_was_written(
    override: str, fragment: str, tmp_path: Path
) -> None:
    assert fragment in problems_of(written(tmp_path, GOOD), override)


def test_a_wrong_override_also_shows_the_line_that_uses_it(tmp_path: Path) -> None:
    path = written(tmp_path, GOOD)
    assert problems_of(path, "stiffness:=-5 N/mm") == (
        "argument stiffness:=-5 N/mm: stiffness: must be >= 0 N/m, got -5000 N/m\n"
        f"  used at {path}:14:14\n"
        "   14 |   stiffness: $(arg stiffness)\n"
        "      |              ^"
    )


def test_a_wrong_default_shows_both_lines(tmp_path: Path) -> None:
    path = written(tmp_path, GOOD.replace("10 N/mm", "10 s"))
    message = problems_of(path)
    assert message.startswith(f"{path}:4:14: stiffness: expected a stiffness in N/m")
    assert f"  used at {path}:14:14\n" in message


def test_an_override_given_twice_is_refused(tmp_path: Path) -> None:
    message = problems_of(written(tmp_path, GOOD), "law:=none", "law:=aol")
    assert message == (
        "argument law:=aol: argument 'law' is given twice\n  first argument law:=none"
    )


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"duration": "6 kg"}, "document: duration: duration: expected a time in s"),
        ({"device": {"kind": "x"}}, "document: device.kind: unknown device kind 'x'; known: "),
        ({"seed": 10**5000}, "document: seed: seed: expected a whole number"),
        ({"seed": object()}, "document: seed: seed: expected a whole number"),
        ({"links": [1]}, "document: links: links must be a mapping, got a list"),
        ({"surprise": None}, "document: unknown key in the launch file: 'surprise'"),
    ],
    ids=lambda value: str(list(value))[:30] if isinstance(value, dict) else "",
)
def test_a_damaged_document_names_the_path_to_the_value(
    change: dict[str, Any], message: str
) -> None:
    with pytest.raises(ConfigError) as caught:
        from_document({**to_document(load("stiff_wall")), **change})
    assert message in str(caught.value)


FRAGMENTS = st.sampled_from(
    [line + "\n" for line in GOOD.splitlines()]
    + [
        "  ",
        "- ",
        "? ",
        ": ",
        "&a ",
        "*a ",
        "!!str ",
        "$(arg law)",
        "${env:X:-1}",
        "{",
        "}",
        "[",
        "]",
    ]
    + ["%YAML 1.1\n---\n", "---\n", "...\n", "include: graph.yaml\n", "\t", "'", '"', "|\n", "#"]
)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    st.binary(max_size=60)
    | st.text(max_size=60).map(lambda text: text.encode("utf-8", "surrogatepass"))
    | st.lists(FRAGMENTS, max_size=30).map(lambda parts: "".join(parts).encode())
)
def test_any_bytes_give_a_configuration_or_a_config_error(tmp_path: Path, data: bytes) -> None:
    path = written(tmp_path, data)
    try:
        assert isinstance(load(path), GraphConfig)
    except ConfigError as error:
        str(error).encode()


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.sampled_from(["law", "stiffness", "mode"]), st.text(max_size=20))
def test_any_override_gives_a_configuration_or_a_config_error(
    tmp_path: Path, name: str, text: str
) -> None:
    path = written(tmp_path, GOOD)
    try:
        assert isinstance(load(path, [f"{name}:={text}"]), GraphConfig)
    except ConfigError as error:
        str(error).encode()


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


def test_a_file_that_cannot_be_read_is_named_once(tmp_path: Path) -> None:
    links = "links:\n  environment_query: {trace: gone.csv}\n"
    problems = problems_of(written(tmp_path, GOOD.partition("links:")[0] + links))
    assert problems.count("gone.csv: No such file or directory") == 1
    assert "[Errno" not in problems
