"""Summaries of runs that lack something: what counts, and why a figure has no value."""

import pytest
from msgspec.structs import replace
from pressed import config, pressing, summary_of, ticks

from forcebound.analysis.summary import OF_ONE_LAW
from forcebound.errors import ConfigError


def test_a_figure_that_is_missing_has_its_reason() -> None:
    hardware = [
        replace(t, true_energy=None, true_position=None, hand_force=None) for t in ticks(pressing())
    ]
    summary = summary_of(hardware)
    assert summary["displayed_stiffness_n_per_m"] == pytest.approx(540.0)
    assert summary["at_rest"] is None
    reasons = summary["undefined"]
    assert "ground truth" in reasons["largest_energy_fall_j"]
    assert "4 s" in reasons["displayed_impedance"]
    assert "settling_time_s" not in reasons
    assert "surface" in summary_of(ticks(abs), {})["undefined"]["settling_time_s"]


@pytest.mark.parametrize("engaged", [0.0, 1.0])
@pytest.mark.parametrize("duration", [0.0, 0.2, 6.0])
def test_every_figure_of_a_law_without_a_value_has_a_reason(
    duration: float, engaged: float
) -> None:
    for path in (pressing(), lambda elapsed: 0.0):
        run = [replace(t, engagement=engaged) for t in ticks(path, duration=duration)]
        summary = summary_of(run)
        assert {key for key in OF_ONE_LAW if summary[key] is None} == set(summary["undefined"])
        if not run or not engaged:
            assert set(summary["undefined"].values()) == {"the force never engaged"}
            assert summary["samples"] == 0


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


def test_a_hand_that_never_touches_has_no_stiffness_and_no_depth() -> None:
    summary = summary_of(ticks(lambda elapsed: 0.0))
    for key in ("displayed_stiffness_n_per_m", "rate_hardness_n_per_m", "bounder_active_share"):
        assert summary[key] is None
        assert summary["undefined"][key] == "no contact"
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


@pytest.mark.parametrize(("key", "value"), [("axis", 2), ("position", "10 mm")])
def test_a_surface_that_does_not_fit_the_run_is_refused(key: str, value: object) -> None:
    with pytest.raises(ConfigError, match=rf"environment\.{key} .*{value}"):
        summary_of(ticks(pressing(), duration=0.1), config(**{key: value}))
