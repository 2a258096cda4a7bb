"""The studies outside the package run: the fit of Table 1 and the grid of the certificate."""

import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from forcebound.haptics.environments.solids_of_files import RABBIT
from forcebound.haptics.geometry.mesh_file import read_mesh

EXPERIMENTS = Path(__file__).parent.parent / "experiments"


def study(name: str, *words: str) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(
        [sys.executable, str(EXPERIMENTS / name), *words], capture_output=True, text=True
    )


@pytest.mark.parametrize("name", ["fit_table1.py", "certificate_grid.py"])
def test_a_study_explains_its_options(name: str) -> None:
    done = study(name, "--help")
    assert done.returncode == 0, done.stderr
    assert "usage" in done.stdout


def test_a_short_fit_of_table_1_prints_a_hand_and_what_it_predicts() -> None:
    pytest.importorskip("cma", reason="cma is not installed (extra: lab)")
    done = study("fit_table1.py", "--generations", "1", "--without", "aol")
    assert done.returncode == 0, done.stderr
    errors = re.search(r"fitted ([\d.]+)  predicted ([\d.]+)", done.stdout)
    assert errors is not None, done.stdout
    assert all(0.0 < float(error) < 3.0 for error in errors.groups())
    assert len(done.stdout.splitlines()[-1].split(",")) == 8


def test_the_rabbit_is_what_its_script_makes(tmp_path: Path) -> None:
    made = tmp_path / "rabbit.ply"
    done = study("rabbit.py", "--out", str(made))
    assert done.returncode == 0, done.stderr
    ours, shipped = read_mesh(made), read_mesh(RABBIT)
    assert ours.is_closed
    assert np.array_equal(ours.faces, shipped.faces)
    assert np.abs(ours.vertices - shipped.vertices).max() < 1e-7


@pytest.mark.slow
def test_the_certified_laws_are_as_stiff_as_they_are_meant_to_be() -> None:
    document = json.loads(study("certificate_grid.py", "--json").stdout)
    aims = {aim["law"]: aim for aim in document["aims"]}
    assert len(document["rows"]) == 7 * 24
    assert aims["certified"]["ratio_of_mean_stiffness"] >= 1.0
    assert aims["certified_memoryless"]["ratio_of_mean_stiffness"] >= 1.4
    assert all(aim["ratio_of_mean_rate_hardness"] >= 1.0 for aim in aims.values())
    assert all(row["true_energy_min_j"] >= -1e-9 for row in document["averages"])
