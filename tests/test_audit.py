"""The audit: that the certified laws hold, and that it would find out if they did not."""

import dataclasses
from typing import Any

import numpy as np
import pytest

from forcebound.audit import (
    ENERGY_TOLERANCE,
    Case,
    audit,
    dissipation_of,
    draw_case,
    main,
    replay,
    run_campaign,
)
from forcebound.bounding import LAWS, BoundingLaw, ForceBounder
from forcebound.errors import ConfigError

CERTIFIED_LAWS = sorted(name for name, law in LAWS.items() if law.is_certified)
RUNS = 400
SECONDS = 1.0
COLUMNS = {"time": 0, "reading": 2, "asked": 3, "force": 4}


@pytest.mark.parametrize("law", CERTIFIED_LAWS)
def test_a_certified_law_never_lets_the_energy_fall_below_zero(law: str) -> None:
    (worst,) = audit([law], RUNS, seed=1, seconds=SECONDS)
    assert worst.is_passive
    assert worst.energy_min >= -1e-9
    assert worst.loss_and_work_min >= -1e-9


@pytest.mark.parametrize("law", ["none", "less_conservative", "more_conservative", "aol", "tdpa"])
def test_the_audit_catches_the_laws_that_leak(law: str) -> None:
    (worst,) = audit([law], 100, seed=1, seconds=SECONDS)
    assert not worst.is_passive
    assert worst.energy_min < -1e-3


@pytest.mark.parametrize("law", ["none", *CERTIFIED_LAWS])
def test_the_plant_of_the_audit_makes_no_energy(law: str) -> None:
    for seed in range(50):
        result, _ = replay(law, seed, SECONDS)
        assert result.balance_min >= -1e-12 * max(1.0, abs(result.energy_min))


@pytest.mark.parametrize("law", sorted(LAWS))
def test_the_compiled_audit_and_the_live_bounder_are_the_same_law_bit_by_bit(law: str) -> None:
    for seed in range(12):
        result, trace = replay(law, seed, 0.3)
        bounder = ForceBounder(law, dissipation_of(result.case))
        bounder.start(0, (0.0,))
        # The trace adds up seconds; whole nanoseconds come back by rounding.
        for row in trace:
            reading, asked, force = (row[COLUMNS[name]] for name in ("reading", "asked", "force"))
            time_ns = round(row[COLUMNS["time"]] * 1e9)
            bounded = bounder.bound(time_ns, (reading,), (asked,))
            bounder.settle(bounded)
            assert bounded == (force,)


def test_a_run_is_replayed_bit_by_bit_from_its_seed() -> None:
    first, trace = replay("certified", 7, SECONDS)
    again, trace_again = replay("certified", 7, SECONDS)
    assert first == again
    assert np.array_equal(trace, trace_again)
    assert replay("certified", 8, SECONDS)[0].case != first.case


def test_every_kind_of_trouble_occurs() -> None:
    cases = [draw_case(seed, SECONDS) for seed in range(300)]
    assert {case.adversary for case in cases} == set(range(6))
    assert {case.sensor for case in cases} == set(range(4))

    def share(trouble: Any) -> float:
        return sum(1 for case in cases if trouble(case)) / len(cases)

    def is_rough(case: Case) -> bool:
        return case.jitter > 0 and case.overruns > 0 and case.resolution > 0 and case.delay > 0

    assert share(lambda case: case.loss > 0) > 0.3
    assert share(lambda case: case.corruption > 0) > 0.2
    assert share(is_rough) > 0.05


def test_a_campaign_says_which_law_holds() -> None:
    rows = run_campaign(40, ["none", "certified"], seed=1, seconds_each=0.5)
    assert [row["law"] for row in rows] == ["none", "certified"]
    assert [row["is_certified"] for row in rows] == [False, True]
    assert [row["holds"] for row in rows] == [True, True]  # "none" promises nothing
    assert rows[0]["energy_min_j"] < -1.0
    worst, _ = replay("none", rows[0]["worst_seed"], 0.5)
    assert worst.energy_min == rows[0]["energy_min_j"]


def test_the_campaign_of_the_command_line_ends_with_status_1_only_for_a_broken_promise(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    options = ["--runs", "40", "--seconds", "0.5"]
    assert main([*options, "--law", "none", "--law", "certified"]) == 0
    table = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in table] == ["law", "none", "certified"]
    assert table[1].endswith("not certified")
    assert table[2].endswith("holds")
    monkeypatch.setitem(LAWS, "broken", dataclasses.replace(LAWS["none"], is_certified=True))
    assert main([*options, "--law", "broken"]) == 1
    assert "BROKEN" in capsys.readouterr().out


def test_an_unknown_law_and_an_audit_without_runs_are_refused() -> None:
    with pytest.raises(ConfigError, match="known are aol"):
        replay("unbound", 1, SECONDS)
    with pytest.raises(ConfigError, match="runs must be >= 1"):
        audit(["certified"], 0, 1)


# Certified laws with one part missing: the audit must find each of them out


def without_watchdog_price() -> dict[str, Any]:
    limit = LAWS["certified"].limit

    def patched(state, asked, elapsed, *rest):  # type: ignore[no-untyped-def]  # compiled
        return limit(state, asked, min(elapsed, rest[-2]), *rest)

    return {"limit": patched}


def with_nominal_period() -> dict[str, Any]:
    limit = LAWS["certified"].limit

    def patched(state, asked, *rest):  # type: ignore[no-untyped-def]  # compiled
        ledger, largest, added = limit(state, asked, *rest)
        friction, period, hold_limit = rest[8], rest[10], rest[11]
        return ledger, friction + (largest - friction) * (hold_limit / period) ** 0.5, added

    return {"limit": patched}


def with_quantisation_taken_for_travel() -> dict[str, Any]:
    limit = LAWS["certified"].limit

    def patched(state, asked, elapsed, distance, clear_square, path, *rest):  # type: ignore[no-untyped-def]  # compiled
        return limit(state, asked, elapsed, distance, clear_square, distance, *rest)

    return {"limit": patched}


def without_price_of_change() -> dict[str, Any]:
    def patched(state, applied, change_sum, held_sum, *rest):  # type: ignore[no-untyped-def]  # compiled
        return state

    return {"settle": patched}


@pytest.fixture(
    params=[
        without_watchdog_price,
        with_nominal_period,
        with_quantisation_taken_for_travel,
        without_price_of_change,
    ]
)
def broken_law(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    name = str(request.param.__name__)
    broken: BoundingLaw = dataclasses.replace(LAWS["certified"], **request.param())
    monkeypatch.setitem(LAWS, name, broken)
    return name


def test_the_audit_catches_a_certified_law_with_a_part_missing(broken_law: str) -> None:
    (worst,) = audit([broken_law], RUNS, seed=1, seconds=SECONDS)
    assert worst.loss_and_work_min < -100 * ENERGY_TOLERANCE
