"""The grid of walls, delays and speeds: how much stiffness the certified laws display."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parent.parent / "experiments" / "certificate_grid.py"


@pytest.mark.slow
def test_the_certified_laws_are_as_stiff_as_they_are_meant_to_be() -> None:
    done = subprocess.run(
        [sys.executable, str(SCRIPT), "--json"], capture_output=True, text=True, check=True
    )
    document = json.loads(done.stdout)
    aims = {aim["law"]: aim for aim in document["aims"]}
    assert len(document["rows"]) == 7 * 24
    assert aims["certified"]["ratio_of_mean_stiffness"] >= 1.0
    assert aims["certified_memoryless"]["ratio_of_mean_stiffness"] >= 1.4
    assert all(aim["ratio_of_mean_rate_hardness"] >= 1.0 for aim in aims.values())
    assert all(row["true_energy_min_j"] >= -1e-9 for row in document["averages"])
