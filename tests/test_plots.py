"""Plots: the given data, in scales that keep every run readable."""

import math
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace
from plotted import WALL, drawn, panel, run_of, slopes, telemetry

from forcebound.analysis.panels import MOST_POINTS, PANELS, PIECES, extremes
from forcebound.analysis.plots import DEFAULT_PANELS, figure, save
from forcebound.errors import ConfigError
from forcebound.nodes.events import LAW_CHANGED, PHASE_BEGINS, EventLog

# --- The data ------------------------------------------------------------------------------------


def test_the_lines_are_the_columns_in_everyday_units() -> None:
    run = run_of(telemetry())
    columns = run[1]
    drawing = figure([run])
    position, force, energy, delay = (drawn(panel(drawing, row)) for row in range(4))
    np.testing.assert_array_equal(position["reading"], columns.position[:, 0] * 1e3)
    np.testing.assert_array_equal(position["true"], columns.true_position[:, 0] * 1e3)
    np.testing.assert_array_equal(position["surface"], [10.0, 10.0])
    np.testing.assert_array_equal(force["commanded"], columns.commanded_force[:, 0])
    np.testing.assert_array_equal(force["applied"], columns.applied_force[:, 0])
    np.testing.assert_array_equal(energy["true"], columns.true_energy * 1e3)
    np.testing.assert_array_equal(energy["estimated"], columns.estimated_energy * 1e3)
    np.testing.assert_array_equal(delay["state\nto force"], columns.loop_delay * 1e3)
    for line in panel(drawing, 0).lines[1:]:
        np.testing.assert_array_equal(line.get_xdata(), columns.time)


def test_the_bound_is_a_band_about_zero() -> None:
    (band,) = panel(figure([run_of(telemetry())]), 1).collections
    heights = np.array(band.get_paths()[0].vertices, dtype=float)[:, 1]
    assert (heights.min(), heights.max()) == (-2.0, 2.0)


def test_samples_before_the_engagement_are_left_out() -> None:
    packets = [replace(p, engagement=float(p.seq >= 50)) for p in telemetry()]
    read = drawn(panel(figure([run_of(packets)]), 0))["reading"]
    assert read.size == 150


def test_a_recording_that_begins_later_keeps_the_time_since_the_force_engaged() -> None:
    mark = EventLog("device").emit(150_000_000, LAW_CHANGED, "", {"law": "none"})
    axes = panel(figure([run_of(telemetry()[100:])], events=[[mark]]), 0)
    reading, change = (
        next(line for line in axes.lines if line.get_label() == name).get_xdata()
        for name in ("reading", "law changed")
    )
    assert np.asarray(reading)[[0, -1]] == pytest.approx([0.1, 0.199])
    assert np.asarray(change)[0] == pytest.approx(0.15)


def test_force_over_penetration_shows_the_wall_and_what_was_applied() -> None:
    run = run_of(telemetry())
    axes = figure([run], ["force_over_penetration"]).axes[0]
    wall, applied = axes.lines
    assert slopes([wall]) == [10.0]  # N/mm
    depth = np.asarray(applied.get_xdata(), dtype=float)
    np.testing.assert_allclose(depth, (run[1].position[:, 0] - WALL) * 1e3)
    np.testing.assert_array_equal(applied.get_ydata(), run[1].applied_force[:, 0])
    assert axes.get_xlabel() == "penetration (mm)"


def test_a_long_curve_keeps_its_extremes_and_gaps_with_few_points() -> None:
    values = np.random.default_rng(1).normal(size=1_000_001)
    values[[123_456, 654_321]] = 50.0, -50.0
    values[300_000:400_000] = np.nan
    chosen = extremes(values)
    assert chosen.size <= 2 * PIECES
    assert (np.diff(chosen) > 0).all()
    assert {123_456, 654_321} <= set(chosen.tolist())
    kept = np.isnan(values[chosen])
    assert kept[(chosen >= 300_000) & (chosen < 400_000)].all()
    assert not kept[(chosen < 299_000) | (chosen > 401_000)].any()
    assert extremes(values[:MOST_POINTS]).size == MOST_POINTS


def test_hardware_has_no_true_lines() -> None:
    packets = [
        replace(p, true_energy=None, true_position=None, hand_force=None) for p in telemetry()
    ]
    drawing = figure([run_of(packets)])
    assert "true" not in drawn(panel(drawing, 0))
    assert "true" not in drawn(panel(drawing, 2))


def test_an_environment_without_a_surface_draws_none() -> None:
    label, columns, _ = run_of(telemetry())
    drawing = figure([(label, columns, {"environment": {"kind": "damper"}})], list(PANELS))
    assert "surface" not in drawn(panel(drawing, 0))
    assert not panel(drawing, list(PANELS).index("force_over_penetration")).lines


# --- Words ---------------------------------------------------------------------------------------


def test_every_panel_says_its_quantity_and_unit() -> None:
    drawing = figure([run_of(telemetry())])
    labels = [axes.get_ylabel() for axes in drawing.axes]
    assert labels == ["position (mm)", "force (N)", "energy (mJ)", "loop delay (ms)"]
    assert drawing.axes[-1].get_xlabel() == "time since the force engaged (s)"


def test_a_time_axis_with_numbers_says_its_unit() -> None:
    drawing = figure([run_of(telemetry())], ("position", "force", "contact", "energy"))
    drawing.draw_without_rendering()
    words = [axes.get_xlabel() for axes in drawing.axes]
    assert words == [
        "",  # those of the panel below
        "time since the force engaged (s)",
        "time since first contact (ms)",
        "time since the force engaged (s)",
    ]
    assert [any(t.get_text() for t in a.get_xticklabels()) for a in drawing.axes] == [
        False,
        True,
        True,
        True,
    ]


@pytest.mark.parametrize(
    ("label", "title"),
    [
        ("live", "live (law: certified)"),
        ("the certified law", "the certified law"),
        ("certified", "law: certified"),
    ],
)
def test_the_title_names_the_law_once(label: str, title: str) -> None:
    assert figure([run_of(telemetry(), label)]).axes[0].get_title() == title


def test_a_run_without_answers_says_so() -> None:
    packets = [replace(p, loop_delay=None, device_seq=None) for p in telemetry()]
    axes = panel(figure([run_of(packets)]), 3)
    assert [text.get_text() for text in axes.texts] == ["no replies"]


# --- Scales --------------------------------------------------------------------------------------


def test_runs_side_by_side_share_their_scales() -> None:
    drawing = figure([run_of(telemetry()), run_of(telemetry(swing=0.005))])
    for row in range(len(DEFAULT_PANELS)):
        left, right = (panel(drawing, row, column, 2) for column in range(2))
        assert left.get_ylim() == right.get_ylim()
        assert not left.texts


def test_a_run_thrown_far_does_not_flatten_the_calm_one() -> None:
    drawing = figure([run_of(telemetry(swing=1.0)), run_of(telemetry())])
    wild, calm = (panel(drawing, 0, column, 2) for column in range(2))
    assert np.ptp(wild.get_ylim()) > 10.0 * np.ptp(calm.get_ylim())
    assert [axes.texts[0].get_text() for axes in (wild, calm)] == ["own scale", "own scale"]


def test_energies_of_different_size_share_a_logarithmic_scale() -> None:
    drawing = figure([run_of(telemetry(energy=-20.0)), run_of(telemetry(energy=0.05))])
    wild, calm = (panel(drawing, 2, column, 2) for column in range(2))
    assert wild.get_yscale() == calm.get_yscale() == "symlog"
    low, high = calm.get_ylim()
    assert (low, high) == wild.get_ylim()
    assert low < -20.0 * 0.199e3
    assert high > 0.05 * 0.199e3
    legend = calm.get_legend()
    assert legend is not None
    assert "log beyond\n±10 mJ" in [text.get_text() for text in legend.get_texts()]


def test_the_energy_panel_names_the_minimum_and_the_largest_fall() -> None:
    packets = [replace(p, true_energy=0.005 - 0.003 * (t > 100)) for t, p in enumerate(telemetry())]
    axes = panel(figure([run_of(packets)]), 2)
    assert axes.get_title(loc="right") == "minimum 2.00 mJ, largest fall 3.00 mJ"


def test_the_region_below_zero_energy_is_shaded_up_to_zero() -> None:
    axes = panel(figure([run_of(telemetry(energy=-0.02))]), 2)
    (shade,) = axes.patches
    box = shade.get_path().get_extents(shade.get_patch_transform())
    assert box.y1 == 0.0
    assert box.y0 == axes.get_ylim()[0]


def test_one_late_answer_is_told_in_words() -> None:
    packets = telemetry(2000)
    packets[700] = replace(packets[700], loop_delay=0.052)
    axes = panel(figure([run_of(packets)]), 3)
    assert axes.get_ylim()[1] < 2.0  # ms
    assert [text.get_text() for text in axes.texts] == ["longest: 52 ms"]


def test_a_wall_that_only_pushes_hides_the_empty_half_of_the_bound() -> None:
    low, high = panel(figure([run_of(telemetry())]), 1).get_ylim()
    assert -0.1 * high < low < 0.0
    pulling = [replace(p, commanded_force=(-3.0,), applied_force=(-2.0,)) for p in telemetry()]
    low, high = panel(figure([run_of(pulling)]), 1).get_ylim()
    assert 0.0 < high < -0.1 * low
    both = [replace(p, applied_force=(-1.0,)) for p in telemetry()]
    assert panel(figure([run_of(both)]), 1).get_ylim()[0] < -1.9


# --- Names and numbers from outside --------------------------------------------------------------


def test_names_from_outside_are_drawn_as_they_are(tmp_path: Path) -> None:
    name = r"$\frac{$ [/bold] \$"
    label, columns, document = run_of(telemetry(), label=name)
    log = EventLog("device")
    events = [
        log.emit(1_000_000, "$a_$", "", is_fault=True),
        log.emit(2_000_000, PHASE_BEGINS, "", {"name": "$\\sum\x1b"}),
    ]
    drawing = figure([(label, columns, document)], events=[events])
    save(drawing, tmp_path / "names.svg")
    assert name in drawing.axes[0].get_title().replace(r"\$", "$").replace("\\\\", "\\")


def test_more_events_than_a_figure_can_show_are_counted() -> None:
    log = EventLog("device")
    events = [log.emit(n * 10_000, f"kind_{n % 12}", "", is_fault=True) for n in range(500)]
    axes = panel(figure([run_of(telemetry())], events=[events]), 0)
    labels = Counter(str(line.get_label()) for line in axes.lines)
    assert labels["kind 0"] == 17
    assert labels["other events"] == 16 * 5 + 1  # kinds 7 to 11
    assert [text.get_text() for text in axes.texts] == ["200 of 500 events"]


@pytest.mark.parametrize("value", [1e308, 5e-324, math.nan])
def test_numbers_that_are_no_motion_can_be_drawn(tmp_path: Path, value: float) -> None:
    packets = telemetry()
    packets[50] = replace(
        packets[50],
        position=(value,),
        true_position=(value,),
        commanded_force=(value,),
        applied_force=(value,),
        force_limit=value,
        estimated_energy=value,
        true_energy=value,
        loop_delay=value,
    )
    save(figure([run_of(packets)], list(PANELS)), tmp_path / "wild.png")


# --- Files ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("suffix", [".png", ".svg"])
def test_the_same_runs_give_the_same_file(tmp_path: Path, suffix: str) -> None:
    contents = []
    for name in ("one", "two"):
        path = tmp_path / (name + suffix)
        save(figure([run_of(telemetry())], ["position", "contact"]), path)
        contents.append(path.read_bytes())
    assert contents[0] == contents[1]
    assert contents[0].startswith(b"\x89PNG" if suffix == ".png" else b"<?xml")
    assert b"forcebound" not in contents[0]  # no path, no name of a machine


def test_the_empty_and_the_unengaged_run_can_be_drawn(tmp_path: Path) -> None:
    unengaged = [replace(p, engagement=0.0) for p in telemetry(5)]
    drawing = figure([run_of([]), run_of(unengaged)], list(PANELS))
    save(drawing, tmp_path / "empty.png")


@pytest.mark.parametrize("name", ["run.pdf", "run"])
def test_another_kind_of_picture_is_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(ConfigError, match=r"must end in \.png or \.svg"):
        save(figure([run_of(telemetry())]), tmp_path / name)


def test_a_place_that_cannot_be_written_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="cannot write the picture"):
        save(figure([run_of(telemetry())]), tmp_path / "no" / "folder.png")


def test_an_unknown_panel_lists_the_known_ones() -> None:
    with pytest.raises(ConfigError, match="no panel 'forces'; there are position"):
        figure([run_of(telemetry())], ["forces"])


def test_a_figure_needs_a_run_and_a_panel() -> None:
    run: Any = run_of(telemetry())
    for runs, panels in [([], DEFAULT_PANELS), ([run], [])]:
        with pytest.raises(ValueError, match="at least one run and one panel"):
            figure(runs, panels)


def test_faults_and_changes_are_lines_by_kind_and_phases_bands_with_their_names() -> None:
    run = run_of(telemetry())
    log = EventLog("device")
    start_ns = int(run[1].time_ns[0])
    marked = [
        log.emit(start_ns - 1, "environment_lost", "before the force engaged", is_fault=True),
        log.emit(start_ns + 3_000_000, "force_released", "", is_fault=True),
        log.emit(start_ns + 4_000_000, "force_released", "", is_fault=True),
        log.emit(start_ns + 3_000_000, "parameter_set", ""),
        log.emit(start_ns + 3_000_000, "force_engages", ""),
    ]
    phases = [
        log.emit(start_ns, PHASE_BEGINS, "", {"name": "quiet"}),
        log.emit(start_ns + 2_000_000, PHASE_BEGINS, "", {"name": "lossy"}),
    ]

    def marks(axes: Any) -> Counter[str]:
        return Counter(line.get_label() for line in axes.lines)

    axes = panel(figure([run], events=[marked]), 0)
    assert marks(axes)["force released"] == 2
    assert marks(axes)["parameter set"] == 1
    assert not {"environment lost", "force engages"} & set(marks(axes))
    assert not axes.child_axes
    axes = panel(figure([run], events=[marked + phases]), 0)
    assert marks(axes)["force released"] == 2
    assert marks(axes)["parameter set"] == 0
    (above,) = axes.child_axes
    assert [label.get_text() for label in above.get_xticklabels()] == ["quiet", "lossy"]
    assert len(axes.patches) == 1
