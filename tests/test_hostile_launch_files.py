"""Launch files that were passed on, or damaged: a ConfigError in bounded time."""

from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from launch_texts import GOOD, problems_of, written

from forcebound.errors import ConfigError
from forcebound.graph.document import SHIPPED, shipped
from forcebound.graph.loader import from_document, load
from forcebound.graph.resolved import to_document

SHIPPED_TEXTS = [(SHIPPED / name).read_bytes() for name in shipped()]

HOSTILE = {
    "deep flow": "[" * 100_000,
    "deep keys": "? " * 120_000,
    "an alias of itself": "a: &a [*a]",
    "an enormous exponent": GOOD.replace("6 s", "1e999999999 s"),
    "a unit without end": GOOD.replace("10 N/mm", "1 " + "N/" * 50_000),
    "substitutions without end": GOOD.replace("10 N/mm", "$(" * 100_000),
    "thousands of unknown keys": GOOD + "".join(f"sead{i}: 1\n" for i in range(5000)),
    "a path without end": GOOD.replace("kind: wall", "kind: " + "w" * 200_000 + ".py"),
    "a path that cannot be": GOOD.replace("kind: wall", 'kind: "a\\0.py"'),
    "an include without end": GOOD + "include: " + "w" * 200_000,
}


@pytest.mark.parametrize("text", HOSTILE.values(), ids=HOSTILE)
def test_a_hostile_file_is_refused(tmp_path: Path, text: str) -> None:
    assert "graph.yaml" in problems_of(written(tmp_path, text))


@pytest.mark.parametrize("text", ["$(arg}", "${env:X)", "$(}", "${)", "$(", "${", "$()", "${}"])
def test_brackets_that_do_not_match_are_no_substitution(tmp_path: Path, text: str) -> None:
    message = problems_of(written(tmp_path, GOOD.replace("$(arg law)", f"'{text}'")))
    assert f":10:8: unknown substitution {text!r}" in message


@st.composite
def mutated(draw: st.DrawFn) -> bytes:
    """A shipped launch file with some pieces cut, doubled, moved or replaced."""
    text = draw(st.sampled_from(SHIPPED_TEXTS))
    words = st.sampled_from([*b" ".join(SHIPPED_TEXTS).split(), b"&a ", b"*a", b"\n", b"1e999"])
    for _ in range(draw(st.integers(1, 6))):
        start = draw(st.integers(0, len(text)))
        end = draw(st.integers(start, min(start + 40, len(text))))
        piece = draw(st.just(b"") | words | st.binary(max_size=6) | st.just(text[start:end] * 2))
        text = text[:start] + piece + text[end:]
    return text


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(mutated())
def test_a_mutated_launch_file_gives_a_configuration_or_a_config_error(
    tmp_path: Path, data: bytes
) -> None:
    path = written(tmp_path, data)
    try:
        config = load(path)
    except ConfigError:
        return
    assert from_document(to_document(config)) == config
