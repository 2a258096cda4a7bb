"""Summaries of runs with known stiffness, rate-hardness, bounces and energies."""

import math
from pathlib import Path

import pytest
from msgspec.structs import replace
from pressed import WALL, config, pressing, summary_of, ticks

from forcebound.messages.events import EventLog
from forcebound.recordings.telemetry import TelemetryColumns
from forcebound.results.figures import FIGURES
from forcebound.results.summary import summarize
from forcebound.results.tables import summary_rows

KEYS = Path(__file__).parent / "golden" / "summary_keys.txt"  # recordings and programs have them


def test_the_keys_of_a_summary_stay_as_they_are() -> None:
    assert [figure.key for figure in FIGURES] == KEYS.read_text().split()


# --- Stiffness and hardness ----------------------------------------------------------------------


@pytest.mark.parametrize("speed", [0.02, 0.2])
def test_the_rate_hardness_of_a_spring_is_its_stiffness_at_any_speed(speed: float) -> None:
    summary = summary_of(ticks(pressing(speed), shown=540.0))
    assert summary["rate_hardness_n_per_m"] == pytest.approx(540.0)


def test_the_rate_hardness_looks_at_the_first_ten_milliseconds_only() -> None:
    run = ticks(pressing(0.1), shown=540.0)
    softer = [
        replace(t, applied_force=(0.0,)) if t.position[0] > WALL + 0.1 * 0.0125 else t for t in run
    ]
    assert summary_of(softer)["rate_hardness_n_per_m"] == pytest.approx(540.0)


def test_a_hand_that_starts_in_the_wall_and_leaves_has_no_rate_hardness() -> None:
    leaving = summary_of(ticks(lambda elapsed: 0.014 - 0.1 * elapsed, duration=1.0))
    assert leaving["rate_hardness_n_per_m"] is None


def test_the_displayed_stiffness_leaves_out_what_comes_before_two_and_after_five_seconds() -> None:
    run = ticks(pressing(), shown=540.0)
    spoilt = [
        t if 2.0 <= t.elapsed <= 5.0 else replace(t, applied_force=(8.5 * (t.position[0] > WALL),))
        for t in run
    ]
    assert summary_of(spoilt)["displayed_stiffness_n_per_m"] == pytest.approx(540.0)


def test_a_short_run_takes_its_last_two_fifths_for_the_steady_state() -> None:
    run = ticks(pressing(), shown=540.0, duration=1.0)
    spoilt = [t if t.elapsed >= 0.6 else replace(t, applied_force=(0.0,)) for t in run]
    assert summary_of(spoilt)["displayed_stiffness_n_per_m"] == pytest.approx(540.0)


# --- Peaks and shares ----------------------------------------------------------------------------


def test_the_peaks_are_the_largest_force_and_the_deepest_reading() -> None:
    summary = summary_of(ticks(pressing(end=0.014), shown=540.0))
    assert summary["peak_penetration_m"] == pytest.approx(0.004)
    assert summary["peak_force_n"] == pytest.approx(540.0 * 0.004)
    assert summary["penetration_at_rest_m"] == pytest.approx(0.004)


@pytest.mark.parametrize(("shown", "share"), [(540.0, 1.0), (10_000.0, 0.0)])
def test_the_bounder_is_active_where_less_is_applied_than_asked(shown: float, share: float) -> None:
    assert summary_of(ticks(pressing(), shown=shown))["bounder_active_share"] == share


def test_without_a_surface_the_bounder_is_judged_where_force_is_asked() -> None:
    run = ticks(pressing(), shown=540.0)
    damper = config() | {"environment": {"kind": "damper", "damping": 5.0}}
    summary = summary_of(run, damper)
    assert summary["bounder_active_share"] == 1.0
    assert summary["peak_force_n"] > 0.0
    assert summary["displayed_stiffness_n_per_m"] is None
    assert summary["contact_bounces"] is None


def test_the_same_tick_share_counts_forces_that_answer_their_own_state() -> None:
    run = [replace(t, device_seq=t.seq - 1 if t.seq % 4 == 0 else t.seq) for t in ticks(pressing())]
    assert summary_of(run)["same_tick_share"] == pytest.approx(0.75)


def test_the_loop_delay_leaves_out_forces_without_an_answer() -> None:
    run = [
        replace(t, loop_delay=None, device_seq=None) if i < 100 else replace(t, loop_delay=i * 1e-6)
        for i, t in enumerate(ticks(pressing(), duration=1.1))
    ]
    delay = summary_of(run)["loop_delay_ms"]
    assert delay["p50"] == pytest.approx(0.5995)
    assert delay["p99"] == pytest.approx(1.08901)
    assert delay["max"] == pytest.approx(1.099)


def test_misses_and_refused_packets_are_those_at_the_end() -> None:
    run = [replace(t, deadline_misses=t.seq // 10, rejected={"age": t.seq}) for t in ticks(abs)]
    summary = summary_of(run)
    assert summary["deadline_misses"] == 599
    assert summary["rejected_packets"] == {"age": 5999}
    assert ("rejected packets", "5999 age") in summary_rows(summary)


def test_a_write_after_the_hold_limit_is_an_overrun_and_skipped_ticks_are_one() -> None:
    run = ticks(pressing(), duration=1.0)
    late = [replace(t, time_ns=t.time_ns + 260_000 * (t.seq == 500)) for t in run]
    in_time = [replace(t, time_ns=t.time_ns + 250_000 * (t.seq == 500)) for t in run]
    skipped = [t for t in run if not 300 <= t.seq < 303]
    assert summary_of(run)["hold_limit_overruns"] == 0
    assert summary_of(late)["hold_limit_overruns"] == 1
    assert summary_of(in_time)["hold_limit_overruns"] == 0
    assert summary_of(skipped)["hold_limit_overruns"] == 1
    assert ("hold-limit overruns", "1") in summary_rows(summary_of(late))


def test_ticks_without_a_force_after_a_fault_belong_to_the_run() -> None:
    run = [replace(t, engagement=float(t.seq < 2000)) for t in ticks(pressing())]
    summary = summary_of(run)
    assert summary["samples"] == 6000
    assert summary["duration_s"] == pytest.approx(5.999)


def test_an_event_may_stand_for_several_faults() -> None:
    log = EventLog("controller")
    events = [
        log.emit(1, "packets_refused", "", is_fault=True),
        log.emit(2, "packets_refused", "", {"suppressed": "6"}, is_fault=True),
        log.emit(3, "environment_serves", ""),
    ]
    summary = summarize(TelemetryColumns.from_packets([]), {}, events)
    assert summary["faults"] == {"packets_refused": 8}


# --- Energy --------------------------------------------------------------------------------------


def test_the_errors_of_a_softer_wall_are_what_is_missing() -> None:
    run = ticks(lambda elapsed: 0.012, shown=500.0)  # 2 mm deep, all the time
    summary = summary_of(run)
    assert summary["force_error_rms_n"] == pytest.approx(9500.0 * 0.002)
    assert summary["wall_error_rms_n"] == pytest.approx(9500.0 * 0.002)


def test_a_vibrating_force_is_named_with_its_frequency() -> None:
    document = config()
    document["device"]["mass"] = 0.075
    run = [
        replace(t, applied_force=(1.0 + 0.2 * math.sin(2.0 * math.pi * 100.0 * t.elapsed),))
        for t in ticks(lambda elapsed: 0.012)
    ]
    summary = summary_of(run, document)
    assert summary["vibration_frequency_hz"] == pytest.approx(100.0)
    assert summary["vibration_above_threshold_db"] > 10.0
    assert dict(summary_rows(summary))["vibration above threshold"].endswith("dB at 100 Hz")
    calm = summary_of(ticks(lambda elapsed: 0.012), document)
    assert dict(summary_rows(calm))["vibration above threshold"] == "under -20 dB"


# --- Bounces and rest -----------------------------------------------------------------------------


def test_a_steady_oscillation_about_the_surface_is_counted_in_full() -> None:
    run = ticks(lambda elapsed: WALL - 0.002 * math.cos(2.0 * math.pi * 5.0 * elapsed))
    # 5 Hz for 6 s, from the trough before the first contact: 30 peaks, 29 more troughs
    assert summary_of(run)["contact_bounces"] == 59


def test_a_hand_that_moves_at_the_end_is_not_at_rest() -> None:
    moving = summary_of(ticks(lambda elapsed: 0.012 + 0.002 * math.sin(60.0 * elapsed)))
    assert moving["at_rest"] is False
    assert moving["penetration_at_rest_m"] is None
    away = summary_of(ticks(lambda _: -0.01))
    assert away["at_rest"] is True
    assert away["penetration_at_rest_m"] is None, "it rests, but not in the wall"
    resting = summary_of(ticks(pressing()))
    assert resting["at_rest"] is True
    assert resting["final_speed_m_per_s"] == 0.0


# --- Rows of the table ---------------------------------------------------------------------------


def test_rows_speak_in_everyday_units() -> None:
    rows = dict(summary_rows(summary_of(ticks(pressing(), shown=540.0))))
    assert rows["law"] == "certified"
    assert rows["displayed stiffness"] == "0.54 N/mm"
    assert rows["peak penetration"] == "4.00 mm"
    assert rows["minimum energy (ground truth)"] == "3.00 mJ"
    assert rows["loop delay p50/p99/max"] == "0.40/0.40/0.40 ms"
    assert rows["bounder active"] == "100.0 %"


def test_rows_show_a_dash_for_nothing_and_no_minus_for_rounding() -> None:
    run = [replace(t, true_energy=-1e-12) for t in ticks(lambda elapsed: 0.0)]
    rows = dict(summary_rows(summary_of(run)))
    assert rows["minimum energy (ground truth)"] == "0.00 mJ"
    assert rows["displayed stiffness"] == "–"
