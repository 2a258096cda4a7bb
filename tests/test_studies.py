"""The experiments outside the package run."""

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from benchmarks.__main__ import NAMES as BENCHMARKS
from experiments.__main__ import NAMES, main
from forcebound.haptics.environments.solids_of_files import RABBIT
from forcebound.haptics.geometry.mesh_file import read_mesh

ROOT = Path(__file__).parent.parent


def study(name: str, *words: str) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(
        [sys.executable, "-m", "experiments", name, *words],
        cwd=ROOT,
        capture_output=True,
        text=True,
    )


@pytest.mark.parametrize("name", NAMES)
def test_an_experiment_explains_its_options(name: str) -> None:
    done = CliRunner().invoke(main, [name, "--help"])
    assert done.exit_code == 0, done.output
    assert "Usage" in done.output


def test_the_docs_name_experiments_and_benchmarks_that_there_are() -> None:
    known = {"experiments": set(NAMES), "benchmarks": {*BENCHMARKS, "NAME"}}
    texts = [*(ROOT / "docs").glob("*.md"), *(ROOT / "launch").glob("*.yaml"), *ROOT.glob("*.md")]
    found = [
        each
        for file in texts
        if file.name != "CHANGELOG.md"
        for each in re.findall(r"python -m (experiments|benchmarks)[\s.]+(\w+)", file.read_text())
    ]
    assert len(found) >= 15
    assert [f"{kind} {name}" for kind, name in found if name not in known[kind]] == []


def test_a_picture_in_a_folder_that_is_missing_is_refused_before_the_work() -> None:
    done = CliRunner().invoke(main, ["two_hands", "box", "--out", "missing/picture.png"])
    assert done.exit_code == 2
    assert "missing" in done.stderr


def test_the_rabbit_is_what_its_script_makes(tmp_path: Path) -> None:
    made = tmp_path / "rabbit.ply"
    done = study("rabbit", "--out", str(made))
    assert done.returncode == 0, done.stderr
    ours, shipped = read_mesh(made), read_mesh(RABBIT)
    assert ours.is_closed
    assert np.array_equal(ours.faces, shipped.faces)
    assert np.abs(ours.vertices - shipped.vertices).max() < 1e-7
