"""Commands that come with the proofs: wrong input is refused before the work begins."""

import sys
from pathlib import Path

import pytest
from invoking import invoke


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("reproduce", "fig99"), "fig99"),
        (("audit", "--law", "certifed"), "certifed"),
        (("audit", "--output", "/nowhere/audit.md"), "no folder /nowhere"),
        (("audit", "--output", "README"), "must end in .md"),
        (("audit", "worlds", "--world", "moon"), "'moon'"),
        (("audit", "worlds", "--controller", "hope"), "'hope'"),
        (("audit", "replay", "none", "laws:" + "9" * 30), "a seed must be at most"),
        (("audit", "replay", "none", "176"), "such as laws:176"),
        (("audit", "replay", "none", "laws:1", "--output", "run.txt"), "end in .png or .svg"),
    ],
)
def test_wrong_input_ends_with_a_message_and_status_2(words: tuple[str, ...], message: str) -> None:
    result = invoke(*words)
    assert result.exit_code == 2
    assert message in result.stderr
    assert "Traceback" not in result.stderr
    assert "left:" not in result.stderr, "no progress of what does not begin"


def test_an_audit_without_its_package_is_refused_before_the_random_runs(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(sys.modules, "cma", None)
    result = invoke("audit", "--runs", "1000000", "--search", "10", "--law", "certified")
    assert result.exit_code == 2
    assert "pip install forcebound-proofs" in result.stderr


def test_a_picture_that_cannot_be_written_is_refused_before_the_run(tmp_path: Path) -> None:
    picture = str(tmp_path / "none" / "run.png")
    result = invoke("audit", "replay", "certified", "laws:3", "-o", picture)
    assert result.exit_code == 2
    assert "cannot write the picture" in result.stderr
    assert not result.stdout
