"""The fit of Table 1 and the grid of the certificate run."""

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner

from forcebound_proofs import certificate_grid, late_ticks
from forcebound_proofs.__main__ import NAMES, main

DOCS = Path(__file__).parent.parent / "docs"


def study(name: str, *words: str) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(
        [sys.executable, "-m", "forcebound_proofs", name, *words], capture_output=True, text=True
    )


@pytest.mark.parametrize("name", NAMES)
def test_a_study_explains_its_options(name: str) -> None:
    done = CliRunner().invoke(main, [name, "--help"])
    assert done.exit_code == 0, done.output
    assert "Options:" in done.stdout


def test_a_page_that_cannot_be_written_is_refused_before_the_work() -> None:
    done = CliRunner().invoke(main, ["certificate_grid", "--page", "page.txt"])
    assert done.exit_code == 2
    assert "'page.txt'" in done.stderr


def test_a_short_fit_of_table_1_prints_a_hand_and_what_it_predicts() -> None:
    done = CliRunner().invoke(main, ["fit_table1", "--generations", "1", "--without", "aol"])
    assert done.exit_code == 0, done.output
    errors = re.search(r"fitted ([\d.]+)  predicted ([\d.]+)", done.stdout)
    assert errors is not None, done.stdout
    assert all(0.0 < float(error) < 3.0 for error in errors.groups())
    assert len(done.stdout.splitlines()[-1].split(",")) == 8


def test_the_page_of_prices_is_made_of_its_text_and_has_every_row() -> None:
    page = (DOCS / "prices.md").read_text(encoding="utf-8")
    parts = re.split(r"{\w+}", certificate_grid.PAGE.read_text(encoding="utf-8"))
    assert re.fullmatch(".+".join(map(re.escape, parts)), page, re.DOTALL), "run: make proofs"
    for row in (*certificate_grid.PRICES, *certificate_grid.MISTAKES):
        assert f"| {row} |" in page


@pytest.mark.parametrize(
    ("law", "drags"), [("tdpa", True), ("certified", False), ("certified_fading", False)]
)
def test_only_a_law_that_adds_damping_drags_in_free_motion(law: str, drags: bool) -> None:
    case = {"law": law, "hand": "taps", "delay": 1, "hold_limit": 1.02}
    (row,) = certificate_grid.measure([case])
    assert (row["drag_n"] > 1e-3) == drags
    assert drags or row["drag_n"] == 0.0


@pytest.mark.parametrize("number", certificate_grid.MISTAKES)
def test_a_wrong_number_costs_energy_and_the_power_stays_below_its_bound(number: str) -> None:
    case = {"law": "certified", "hand": "taken", "number": number, "hold_limit": 1.02}
    (row,) = certificate_grid.measure([case])
    if number == "nothing":
        assert row["true_energy_min_j"] >= -1e-9
        assert 0.5 * row["power_bound_w"] < row["power_w"] <= row["power_bound_w"]
    else:
        assert row["true_energy_min_j"] < -1e-3


def test_late_ticks_cost_a_silent_watchdog_force_and_a_guarding_one_little() -> None:
    cell = {"law": "certified", "hold_limit": 1.25, "seed": 1, "duration": 0.8}
    cases = [{**cell, "watchdog": one, "rate": 20.0} for one in ("guarding", "silent")]
    guarding, silent = late_ticks.measure(cases)
    assert guarding["stiffness"] > 2.0 * silent["stiffness"]
    assert min(row["energy"] for row in (guarding, silent)) >= -1e-9


@pytest.mark.slow
def test_the_certified_laws_are_as_stiff_as_they_are_meant_to_be() -> None:
    document = json.loads(study("certificate_grid", "--json").stdout)
    aims = [aim for aim in document["aims"] if aim["aim"] is not None]
    assert len(document["rows"]) == 7 * 24
    assert [aim["law"] for aim in aims] == ["certified", "certified_fading"]
    assert all(aim["ratio_of_mean_stiffness"] >= aim["aim"] >= 1.0 for aim in aims)
    assert all(aim["ratio_of_mean_rate_hardness"] >= 1.0 for aim in aims)
    assert all(row["true_energy_min_j"] >= -1e-9 for row in document["averages"])


def test_the_studies_are_listed_outside_the_clone(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "forcebound_proofs", "--help"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "identification_bounds" in done.stdout
