"""The campaign of ``make fuzz``, with and without atheris."""

import importlib.util
import subprocess
import sys
from pathlib import Path

import pytest

CAMPAIGN = Path(__file__).parent.parent / "fuzz" / "campaign.py"


def campaign(*words: str) -> subprocess.CompletedProcess[str]:
    program = [sys.executable, *words]
    return subprocess.run(program, capture_output=True, text=True, timeout=120, check=False)


@pytest.mark.skipif(importlib.util.find_spec("atheris") is not None, reason="atheris is installed")
def test_without_atheris_it_says_so_and_fails() -> None:
    done = campaign(str(CAMPAIGN))
    assert done.returncode == 2
    assert "make fuzz" in done.stdout


@pytest.mark.skipif(
    importlib.util.find_spec("atheris") is None, reason="atheris is missing: make fuzz"
)
@pytest.mark.parametrize("target", ["recording", "keys"])
def test_a_short_campaign_finds_nothing(target: str) -> None:
    done = campaign(str(CAMPAIGN), target, "--seconds", "2")
    assert done.returncode == 0, done.stdout + done.stderr[-3000:]
    assert f"{target}: nothing found" in done.stdout
