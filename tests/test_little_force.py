"""Why a law gives little force, from telemetry and the report of a bounder, case by case."""

import dataclasses
from typing import Any

import pytest
from builders import MS, telemetry_packet
from msgspec.structs import replace

from forcebound.analysis.bounder import causes_of_little_force
from forcebound.analysis.summary import summarize
from forcebound.analysis.tables import summary_rows
from forcebound.config.loader import load
from forcebound.launch.virtual import run_virtual
from forcebound.messages.control import BounderReport
from forcebound.nodes.events import BOUNDER_REPORTED, EventLog
from forcebound.telemetry import TelemetryColumns

DEVICE: dict[str, Any] = {
    "law": "certified",
    "rate": 1000.0,
    "hold_limit": "auto",
    "damping": 0.27,
    "friction": 0.12,
    "resolution": 3e-5,
    "watchdog": "silent",
}
PUNCTUAL = BounderReport(hold_limit=1.02e-3, longest_hold_limit=1.02e-3)
TICKS = 1000


def pressed(applied: float = 1.5, **fields: Any) -> TelemetryColumns:
    """Return a second in which 8 N are commanded, by default with little force."""
    forces = {"commanded_force": (8.0,), "applied_force": (applied,)}
    return TelemetryColumns.from_packets(
        [telemetry_packet(k, **forces | fields) for k in range(TICKS)]
    )


def causes(columns: TelemetryColumns, report: Any = PUNCTUAL, **device: Any) -> list[str]:
    return [cause.code for cause in causes_of_little_force(columns, DEVICE | device, report)]


def test_a_force_that_is_not_limited_needs_no_cause() -> None:
    assert causes(pressed(applied=8.0)) == []
    assert causes(pressed(), law="none") == []


def test_where_all_is_well_and_the_force_is_little_it_is_the_dissipation() -> None:
    assert causes(pressed(applied=1.9)) == ["dissipation"]
    assert causes(pressed(applied=2.1)) == []


def test_an_answer_of_another_tick_is_a_delay() -> None:
    assert causes(pressed(loop_delay=0.9e-3)) == ["dissipation"]
    assert causes(pressed(loop_delay=5e-3)) == ["delay"]


def test_missed_ticks_are_a_cause_from_one_in_a_hundred_on() -> None:
    columns = pressed()
    for every, cause in ((200, "dissipation"), (50, "missed_ticks")):
        missed = dataclasses.replace(columns, deadline_misses=columns.seq // every)
        assert causes(missed) == [cause]


def test_an_overrun_a_second_matters_with_a_silent_watchdog_and_not_with_another() -> None:
    report = replace(PUNCTUAL, overruns=1)
    assert causes(pressed(), report) == ["overruns_at_auto"]
    assert causes(pressed(), report, hold_limit=1.02) == ["overruns"]
    assert causes(pressed(), report, watchdog="reporting") == ["dissipation"]
    assert causes(pressed(), report, watchdog="none") == ["dissipation"]
    many = replace(PUNCTUAL, overruns=9)
    assert causes(pressed(), many, watchdog="reporting") == ["overruns_at_auto"]


def test_a_long_hold_limit_is_set_or_learned_from_late_ticks() -> None:
    report = replace(PUNCTUAL, hold_limit=4e-3)
    assert causes(pressed(), report) == ["late_ticks"]
    assert causes(pressed(), report, hold_limit=4.0) == ["long_hold_limit"]
    assert causes(pressed(), report, law="tdpa") == ["law_not_certified"]  # it has no ledger


def test_a_full_ledger_is_a_cause_if_the_launch_file_has_a_cap() -> None:
    full = pressed(estimated_energy=1e-3)
    assert causes(full) == ["dissipation"]
    assert causes(full, energy_cap=1e-3) == ["energy_cap"]
    assert causes(pressed(estimated_energy=1e-4), energy_cap=1e-3) == ["dissipation"]


def test_imperfections_and_a_coarse_encoder_are_causes() -> None:
    assert causes(pressed(), write_delay=1e-4, lag=1e-4) == ["imperfections"]
    columns = pressed(applied=2.0)
    restless = dataclasses.replace(
        columns, applied_force=columns.applied_force * (columns.seq % 2)[:, None]
    )
    assert causes(restless) == ["resolution"]
    assert causes(restless, resolution=0.0) == ["dissipation"]


def test_the_report_of_the_bounder_is_in_the_summary() -> None:
    report = BounderReport(
        overruns=3,
        hold_limit=1.1e-3,
        longest_hold_limit=4e-3,
        refused_readings=2,
        late_writes=5,
        longest_write_delay=2e-4,
        largest_allowance=5e-4,
        allowance_repaid=True,
    )
    events = [EventLog("device").emit(9 * MS, BOUNDER_REPORTED, "", report.as_texts())]
    sources = {"damping": "measured", "friction": "measured", "lag": "assumed"}
    device = DEVICE | {"energy_cap": 0.02, "sources": sources}
    summary = summarize(pressed(), {"device": device}, events)
    assert summary["hold_limit_overruns"] == 3
    assert summary["hold_limit_ms"] == pytest.approx({"mean": 1.1, "longest": 4.0})
    rows = dict(summary_rows(summary))
    assert rows["hold limit mean/longest"] == "1.10/4.00 ms"
    assert rows["refused readings"] == "2"
    late = "5, up to 0.2 ms after the reading: device.write_delay"
    assert rows["writes later than stated"] == late
    assert rows["largest allowance used"] == "0.500 mJ, repaid"
    assert rows["energy cap"] == "20.00 mJ"
    assert rows["numbers of the device"] == "1 assumed, 2 measured"


def test_a_run_without_a_report_says_nothing_of_it() -> None:
    summary = summarize(pressed(), {"device": DEVICE})
    assert summary["refused_readings"] is None
    assert summary["hold_limit_ms"] == {"mean": None, "longest": None}
    assert "refused readings" not in dict(summary_rows(summary))


def test_a_punctual_run_reports_its_bounder_and_has_enough_force() -> None:
    summary = run_virtual(load("stiff_wall"), 1.0).summary
    assert summary["hold_limit_overruns"] == 0
    assert summary["hold_limit_ms"] == pytest.approx({"mean": 1.02, "longest": 1.02})
    assert summary["little_force"] == []
