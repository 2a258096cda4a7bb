"""The audit: certified laws stay passive, and a broken law is found."""

import dataclasses
import json
import re
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import pytest
from click.testing import CliRunner

from forcebound.cli import main
from forcebound.errors import ConfigError
from forcebound.haptics.laws import (
    ENERGY_TOLERANCE,
    LAWS,
    DeviceConstants,
    ForceBounder,
    Sample,
)
from forcebound.haptics.laws.law import State
from forcebound.lab.table import read_table
from forcebound_proofs.attack import ATTACKS, MARGIN, Budget, Outcome, attack_named, attack_of
from forcebound_proofs.audit import Options, replay, run
from forcebound_proofs.cases import encode
from forcebound_proofs.law_cases import (
    ADVERSARIES,
    CLOCKS,
    RANGES,
    SENSORS,
    case_of,
    clock_of,
    dissipation_of,
)
from forcebound_proofs.law_run import run_law
from forcebound_proofs.laws import PAIRS

CERTIFIED_LAWS = sorted(name for name, law in LAWS.items() if law.is_certified)
OTHER_LAWS = sorted(set(LAWS) - set(CERTIFIED_LAWS))
RUNS, SMOKE = 400, 500
SECONDS = 1.0


def result_of(law: str, case: str | int, seconds: float = SECONDS) -> Outcome:
    return run_law(law, case_of(str(case), seconds))


def lowest_of(law: str, runs: int) -> float:
    return min(result_of(law, seed).margin_j for seed in range(1, runs + 1))


@pytest.mark.parametrize("law", CERTIFIED_LAWS)
def test_a_certified_law_never_lets_the_energy_fall_below_zero(law: str) -> None:
    assert lowest_of(law, SMOKE) >= -ENERGY_TOLERANCE


@pytest.mark.parametrize("law", ["none", "less_conservative", "more_conservative", "aol", "tdpa"])
def test_the_audit_catches_the_laws_that_leak(law: str) -> None:
    assert lowest_of(law, 100) < -1e-3


@pytest.mark.parametrize("law", ["none", *CERTIFIED_LAWS])
def test_the_plant_of_the_audit_makes_no_energy(law: str) -> None:
    for seed in range(50):
        details = result_of(law, seed).details
        assert details["balance_min_j"] >= -1e-12 * max(1.0, abs(details["energy_min_j"]))


@pytest.mark.no_cover  # too many samples
@pytest.mark.parametrize(
    "law", [*CERTIFIED_LAWS, *(pytest.param(law, marks=pytest.mark.slow) for law in OTHER_LAWS)]
)
def test_the_compiled_audit_and_the_live_bounder_are_the_same_law_bit_by_bit(law: str) -> None:
    for seed in range(12):
        scenario = case_of(str(seed), 0.3)
        trace = run_law(law, scenario).trace
        bounder = ForceBounder(law, dissipation_of(scenario))
        bounder.start(0, (0.0,))
        # The trace has seconds; rounding gives the whole nanoseconds back.
        columns = [trace[name].tolist() for name in ("time", "reading", "commanded", "force")]
        for time, reading, asked, force in zip(*columns, strict=True):
            time_ns = round(time * 1e9)
            bounded = bounder.bound(time_ns, (reading,), (asked,))
            bounder.settle(bounded)
            assert bounded == (force,)


def test_every_kind_of_trouble_occurs_and_often_several_at_once() -> None:
    cases = [case_of(str(seed), SECONDS) for seed in range(300)]
    adversaries = list(ADVERSARIES)
    met = {f"{adversaries[case.adversary]}/{SENSORS[case.sensor]}" for case in cases}
    assert met == set(PAIRS)
    rough = [case for case in cases if case.jitter and case.overruns and case.resolution]
    assert sum(case.delay > 0 for case in rough) > 15
    for name, least in (("loss", 90), ("corruption", 60)):
        assert sum(getattr(case, name) > 0 for case in cases) > least


def test_a_searched_case_is_made_again_from_its_code() -> None:
    rng = np.random.default_rng(1)
    for number in range(len(PAIRS)):
        pair = divmod(number, len(SENSORS))
        code = encode((*pair, int(rng.integers(32))), rng.random(len(RANGES)).tolist())
        case = case_of(code, SECONDS)
        assert (case.name, case.adversary, case.sensor) == (code, *pair)
        assert case_of(code, SECONDS) == case
        dissipation_of(case)  # refuses what is out of range


def test_a_case_has_the_clock_that_the_papers_laws_assume_or_another_one() -> None:
    exact = case_of(encode((0, 0, 0), [0.0] * len(RANGES)), SECONDS)
    others = exact._replace(resolution=1e-5), exact._replace(resolution=1e-5, jitter=0.1)
    assert [clock_of(one) for one in (exact, *others)] == list(CLOCKS)


def test_the_summary_and_the_page_say_which_law_is_passive_and_how_to_see_it_again() -> None:
    laws = attack_named("laws")
    found = laws.series(["none", "certified"], (), Budget(20, 24))
    rows = laws.summary(row for series in found for row in series.rows())
    assert sum(series.runs for series in found) == 88
    assert [row["law"] for row in rows] == ["none", "certified"]
    assert [row["verdict"] for row in rows] == ["leaks", "passive"]
    assert all(row["holds"] for row in rows)  # "none" promises nothing
    assert rows[0][MARGIN] < -1.0
    for row in rows:
        for kind, runs in (("random", 20), ("search", 24)):
            assert row["kind"][kind]["runs"] == runs
            again = replay(row["law"], row["kind"][kind]["case"])
            assert again[MARGIN] == row["kind"][kind][MARGIN]
        assert sum(cell["runs"] for cell in row["clock"].values()) == 44
    text = "\n".join(laws.section(rows))
    assert "| `certified` | 0 | 0 | 0 |" in text
    assert f"| leaks | {rows[0]['case']} |" in text


def test_the_command_ends_with_status_1_only_for_a_broken_promise(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    report, rows = tmp_path / "audit.md", tmp_path / "rows.parquet"
    options = ["audit", "--runs", "10", "--search", "0", "--workers", "0"]
    chosen = ["--law", "certified", "--certificate", "plain", "--rows", str(rows)]
    done = CliRunner().invoke(main, [*options, *chosen, "--output", str(report), "--json"])
    assert done.exit_code == 0, done.output
    document = json.loads(done.stdout)
    assert document["runs"] == 20
    assert [row["holds"] for row in (*document["laws"], *document["paths"])] == [True, True]
    assert "--law certified --certificate plain --runs 10 --search 0 --seed 1" in report.read_text()
    table = read_table(rows).columns
    assert table["law"] == ["certified"] * 11  # a row for each run, and one for a restart
    monkeypatch.setitem(LAWS, "none", dataclasses.replace(LAWS["none"], is_certified=True))
    done = CliRunner().invoke(main, [*options, "--law", "none"])
    assert done.exit_code == 1, done.output
    assert "BROKEN" in done.stdout


@pytest.mark.parametrize("words", [["audit"], ["audit", "worlds"]])
def test_an_interrupted_audit_that_keeps_its_rows_says_how_to_continue(
    words: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*arguments: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("forcebound_proofs.audit.run_here", interrupted)
    options = ["--runs", "1", "--search", "0"]
    kept = CliRunner().invoke(main, [*words, *options, "--rows", str(tmp_path / "a.parquet")])
    lost = CliRunner().invoke(main, [*words, *options])
    assert ["continues" in one.stderr for one in (kept, lost)] == [True, False]


@pytest.mark.parametrize(
    ("law", "name"),
    [
        ("aol", "laws:3"),
        ("certified", "paths:guarding:s3.17"),
        ("none", "worlds:holed_wall/direct:2"),
        ("certified", "sensitivity:phantom_premium_1_5/delay_400us:s1.3"),
    ],
)
def test_the_command_shows_a_run_of_any_attack_again_and_draws_it(
    law: str, name: str, tmp_path: Path
) -> None:
    picture = tmp_path / "run.png"
    options = ["audit", "replay", law, name, "--output", str(picture), "--json"]
    done = CliRunner().invoke(main, options)
    assert done.exit_code == 0, done.output
    document = json.loads(done.stdout)
    assert document[MARGIN] == replay(law, name)[MARGIN]
    assert document["case"]["name"] == name
    assert picture.read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize("page", ["audit", "audit-worlds"])
def test_every_run_that_a_page_names_can_be_repeated(page: str) -> None:
    text = (Path(__file__).parent.parent / "docs" / f"{page}.md").read_text(encoding="utf-8")
    names = set(re.findall(rf"\b(?:{'|'.join(ATTACKS)}):[^\s`|]+", text))
    assert len(names) > 40
    for name in names:
        attack, rest = attack_of(name)
        attack.make(rest)


def test_an_unknown_law_an_unknown_run_and_an_audit_without_runs_are_refused() -> None:
    with pytest.raises(ConfigError, match="known are aol"):
        result_of("unbound", 1)
    with pytest.raises(ConfigError, match="known are aol"):
        run({"laws": ()}, ["unbound"], Options(runs=1, searched=0, workers=0))
    with pytest.raises(ConfigError, match="runs must be >= 1"):
        run({"laws": ()}, ["certified"], Options(runs=0, searched=0, workers=0))
    for name in ("176", "walls:176", ":176", "laws:", "laws:x", "laws:c0", "paths:plain:x3.1"):
        with pytest.raises(ConfigError):
            replay("certified", name)


@pytest.mark.slow
def test_a_tenth_of_the_audit() -> None:
    document = run({"laws": ()}, list(LAWS), Options(runs=600, searched=600))
    assert document["runs"] >= 10_000
    rows = {row["law"]: row for row in document["laws"]}
    for law in CERTIFIED_LAWS:
        assert rows[law][MARGIN] >= -1e-9
    for law in OTHER_LAWS:
        assert rows[law]["kind"]["random"][MARGIN] < -1e-3
        assert rows[law]["kind"]["search"][MARGIN] < -1e-3


Limit: TypeAlias = tuple[State, float, float]
LIMIT = LAWS["certified"].limit

# Certified laws with one part missing: the audit must find each of them out


def without_watchdog_price(state: State, sample: Sample, device: DeviceConstants) -> Limit:
    return LIMIT(state + sample.penalty, sample, device)


def with_nominal_period(state: State, sample: Sample, device: DeviceConstants) -> Limit:
    ledger, _, added = LIMIT(state, sample, device)
    available = max(ledger - sample.held_price, 0.0)
    largest = device.friction + 2.0 * (device.damping / device.period * available) ** 0.5
    return ledger, largest, added


def with_quantisation_taken_for_travel(
    state: State, sample: Sample, device: DeviceConstants
) -> Limit:
    return LIMIT(state + device.friction * sample.distance - sample.friction_loss, sample, device)


def without_price_of_change(state: State, sample: Sample, device: DeviceConstants) -> Limit:
    return LIMIT(state + sample.change_price, sample, device)


@pytest.mark.parametrize(
    "limit",
    [
        with_nominal_period,
        *(
            pytest.param(limit, marks=pytest.mark.slow)
            for limit in (
                without_watchdog_price,
                with_quantisation_taken_for_travel,
                without_price_of_change,
            )
        ),
    ],
)
def test_the_audit_catches_a_certified_law_with_a_part_missing(
    limit: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    limits_holds = LAWS["certified"].limits_holds and limit is not with_nominal_period
    broken = dataclasses.replace(LAWS["certified"], limit=limit, limits_holds=limits_holds)
    monkeypatch.setitem(LAWS, limit.__name__, broken)
    assert lowest_of(limit.__name__, RUNS) < -100 * ENERGY_TOLERANCE
