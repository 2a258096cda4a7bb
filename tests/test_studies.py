"""The experiments outside the package run."""

import subprocess
import sys
from pathlib import Path

import numpy as np

from forcebound.haptics.environments.solids_of_files import RABBIT
from forcebound.haptics.geometry.mesh_file import read_mesh

EXPERIMENTS = Path(__file__).parent.parent / "experiments"


def study(name: str, *words: str) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(
        [sys.executable, str(EXPERIMENTS / name), *words], capture_output=True, text=True
    )


def test_the_rabbit_is_what_its_script_makes(tmp_path: Path) -> None:
    made = tmp_path / "rabbit.ply"
    done = study("rabbit.py", "--out", str(made))
    assert done.returncode == 0, done.stderr
    ours, shipped = read_mesh(made), read_mesh(RABBIT)
    assert ours.is_closed
    assert np.array_equal(ours.faces, shipped.faces)
    assert np.abs(ours.vertices - shipped.vertices).max() < 1e-7
