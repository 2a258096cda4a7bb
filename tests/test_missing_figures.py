"""Summaries of runs that lack something: what counts, and why a figure has no value."""

import pytest
from builders import SUMMARY_KEYS
from msgspec.structs import replace
from pressed import config, pressing, summary_of, ticks

from forcebound.errors import ConfigError


def test_a_figure_that_is_none_has_a_reason() -> None:
    hardware = [
        replace(t, true_energy=None, true_position=None, hand_force=None) for t in ticks(pressing())
    ]
    reasons = summary_of(hardware)["undefined"]
    assert reasons["largest_energy_fall_j"].startswith("needs ground truth")
    assert reasons["displayed_impedance"].startswith("needs 4 s of contact")
    assert "settling_time_s" not in reasons
    assert summary_of(ticks(abs), {})["undefined"]["settling_time_s"].endswith("no surface")
    outside = summary_of(ticks(lambda elapsed: 0.0))["undefined"]
    assert outside["rate_hardness_n_per_m"] == "no contact"


def test_every_figure_without_a_value_has_a_reason() -> None:
    packets = ("loop_delay_ms", "answered_share", "same_tick_share", "deadline_misses")
    for run in (ticks(pressing()), ticks(lambda elapsed: 0.0), ticks(pressing(), duration=0.2)):
        summary = summary_of(run)
        missing = {key for key, value in summary.items() if value is None} - set(packets)
        assert missing == set(summary["undefined"])


def test_samples_without_an_engaged_force_do_not_count() -> None:
    waiting = [
        replace(t, engagement=0.0, position=(0.5,), applied_force=(99.0,), true_energy=-9.0)
        for t in ticks(pressing(), duration=0.5)
    ]
    run = [
        replace(t, time_ns=t.time_ns + 500_000_000, seq=t.seq + 500, device_seq=t.seq + 500)
        for t in ticks(pressing())
    ]
    assert summary_of(waiting + run) == summary_of(run)


def test_a_run_that_never_engaged_has_no_results() -> None:
    summary = summary_of([replace(t, engagement=0.0) for t in ticks(pressing(), duration=0.5)])
    assert summary["samples"] == 0
    defined = {
        "law",
        "samples",
        "loop_delay_ms",
        "reply_age_ms",
        "deadline_misses",
        "rejected_packets",
    }
    for key in SUMMARY_KEYS - defined - {"undefined"}:
        assert summary[key] is None
    assert set(summary["undefined"].values()) == {"the force never engaged"}


def test_no_samples_at_all_still_make_a_summary() -> None:
    assert summary_of([])["samples"] == 0


def test_a_launch_document_without_the_keys_leaves_their_results_open() -> None:
    summary = summary_of(ticks(pressing()), {})
    assert summary["law"] is None
    assert summary["displayed_stiffness_n_per_m"] is None
    assert summary["samples"] == 6000


def test_a_hand_that_never_touches_has_no_stiffness_and_no_depth() -> None:
    summary = summary_of(ticks(lambda elapsed: 0.0))
    assert summary["displayed_stiffness_n_per_m"] is None
    assert summary["rate_hardness_n_per_m"] is None
    assert summary["bounder_active_share"] is None
    assert summary["peak_penetration_m"] == 0.0
    assert summary["contact_bounces"] == 0


def test_the_surface_may_lie_across_another_axis() -> None:
    run = [
        replace(
            t,
            position=(0.0, *t.position),
            true_position=(0.0, *t.position),
            commanded_force=(0.0, *t.commanded_force),
            applied_force=(0.0, *t.applied_force),
            hand_force=(0.0, 0.0),
        )
        for t in ticks(pressing(), shown=540.0)
    ]
    summary = summary_of(run, config(axis=1))
    assert summary["displayed_stiffness_n_per_m"] == pytest.approx(540.0)
    assert summary_of(run, config(axis=0))["displayed_stiffness_n_per_m"] is None


def test_an_axis_that_the_run_does_not_have_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"environment\.axis is 2, but the run has 1 axes"):
        summary_of(ticks(pressing(), duration=0.1), config(axis=2))


def test_a_quantity_that_was_not_resolved_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"environment\.position must be a number \(m\)"):
        summary_of(ticks(pressing(), duration=0.1), config(position="10 mm"))
