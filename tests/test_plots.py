"""Plots: the given data, in scales that keep every run readable."""

from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from builders import telemetry_packet
from msgspec.structs import replace
from plotted import WALL, drawn, panel, run_of, slopes, telemetry

from forcebound.errors import ConfigError
from forcebound.messages.events import LAW_CHANGED, PHASE_BEGINS, EventLog
from forcebound.messages.packets import Event
from forcebound.recordings.telemetry import TelemetryColumns
from forcebound.results.panels import MOST_POINTS, PANELS, PIECES, extremes
from forcebound.results.plots import DEFAULT_PANELS, figure, save


def test_the_lines_are_the_columns_in_everyday_units() -> None:
    run = run_of(telemetry())
    columns = run[1]
    drawing = figure([run])
    labels = [axes.get_ylabel() for axes in drawing.axes]
    assert labels == ["position (mm)", "force (N)", "energy (mJ)", "loop delay (ms)"]
    position, force, energy, delay = (drawn(panel(drawing, row)) for row in range(4))
    np.testing.assert_array_equal(position["reading"], columns.position[:, 0] * 1e3)
    np.testing.assert_array_equal(position["true"], columns.true_position[:, 0] * 1e3)
    assert set(position["surface"]) == {10.0}
    np.testing.assert_array_equal(force["commanded"], columns.commanded_force[:, 0])
    np.testing.assert_array_equal(force["applied"], columns.applied_force[:, 0])
    np.testing.assert_array_equal(energy["true"], columns.true_energy * 1e3)
    np.testing.assert_array_equal(energy["estimated"], columns.estimated_energy * 1e3)
    np.testing.assert_array_equal(delay["state\nto force"], columns.loop_delay * 1e3)
    (band,) = panel(drawing, 1).collections
    heights = np.array(band.get_paths()[0].vertices, dtype=float)[:, 1]
    assert (heights.min(), heights.max()) == (-2.0, 2.0)
    hardware = [replace(p, true_energy=None, true_position=None) for p in telemetry()]
    assert "true" not in drawn(panel(figure([run_of(hardware)]), 0))


def test_time_is_since_the_force_engaged_also_of_a_later_recording() -> None:
    packets = [replace(p, engagement=float(p.seq >= 50)) for p in telemetry()]
    assert drawn(panel(figure([run_of(packets)]), 0))["reading"].size == 150
    mark = EventLog("device").emit(150_000_000, LAW_CHANGED, "", {"law": "none"})
    axes = panel(figure([run_of(telemetry()[100:])], events=[[mark]]), 0)
    reading, change = (
        np.asarray(next(line for line in axes.lines if line.get_label() == name).get_xdata())
        for name in ("reading", "law changed")
    )
    assert reading[[0, -1]] == pytest.approx([0.1, 0.199])
    assert change[0] == pytest.approx(0.15)


def test_force_over_penetration_shows_the_wall_and_what_was_applied() -> None:
    run = run_of(telemetry())
    wall, applied = figure([run], ["force_over_penetration"]).axes[0].lines
    assert slopes([wall]) == [10.0]  # N/mm
    depth = np.asarray(applied.get_xdata(), dtype=float)
    np.testing.assert_allclose(depth, (run[1].position[:, 0] - WALL) * 1e3)
    np.testing.assert_array_equal(applied.get_ydata(), run[1].applied_force[:, 0])


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


def test_runs_side_by_side_share_their_scales_unless_one_is_thrown_far() -> None:
    drawing = figure([run_of(telemetry()), run_of(telemetry(swing=0.005))])
    for row in range(len(DEFAULT_PANELS)):
        left, right = (panel(drawing, row, column, 2) for column in range(2))
        assert left.get_ylim() == right.get_ylim()
        assert not left.texts
    drawing = figure([run_of(telemetry(swing=1.0)), run_of(telemetry())])
    wild, calm = (panel(drawing, 0, column, 2) for column in range(2))
    assert np.ptp(wild.get_ylim()) > 10.0 * np.ptp(calm.get_ylim())
    assert all(axes.texts for axes in (wild, calm))


def test_energies_of_different_size_share_a_logarithmic_scale_shaded_below_zero() -> None:
    drawing = figure([run_of(telemetry(energy=-20.0)), run_of(telemetry(energy=0.05))])
    wild, calm = (panel(drawing, 2, column, 2) for column in range(2))
    assert wild.get_yscale() == calm.get_yscale() == "symlog"
    low, high = calm.get_ylim()
    assert (low, high) == wild.get_ylim()
    assert low < -20.0 * 0.199e3
    assert high > 0.05 * 0.199e3
    (shade,) = calm.patches
    box = shade.get_path().get_extents(shade.get_patch_transform())
    assert (box.y0, box.y1) == (low, 0.0)


def test_a_late_answer_or_none_is_noted() -> None:
    packets = telemetry(2000)
    packets[700] = replace(packets[700], loop_delay=0.052)
    axes = panel(figure([run_of(packets)]), 3)
    assert axes.get_ylim()[1] < 2.0  # ms
    assert "52 ms" in axes.texts[0].get_text()
    silent = [replace(p, loop_delay=None, device_seq=None) for p in telemetry()]
    assert panel(figure([run_of(silent)]), 3).texts


def test_names_of_users_are_drawn_as_they_are(tmp_path: Path) -> None:
    name = r"$\frac{$ [/bold] \$"
    log = EventLog("device")
    events = [
        log.publish(1_000_000, "$a_$", "", is_fault=True),
        log.emit(2_000_000, PHASE_BEGINS, "", {"name": "$\\sum\x1b"}),
    ]
    drawing = figure([run_of(telemetry(), label=name)], events=[events])
    save(drawing, tmp_path / "names.svg")
    assert name in drawing.axes[0].get_title().replace(r"\$", "$").replace("\\\\", "\\")


@pytest.mark.parametrize("suffix", [".png", ".svg"])
def test_the_same_runs_give_the_same_file(tmp_path: Path, suffix: str) -> None:
    contents = []
    for name in ("one", "two"):
        path = tmp_path / (name + suffix)
        save(figure([run_of(telemetry())], ["position", "contact"]), path)
        contents.append(path.read_bytes())
    assert contents[0] == contents[1]
    assert contents[0].startswith(b"\x89PNG" if suffix == ".png" else b"<?xml")


@pytest.mark.parametrize("name", ["run.pdf", "run", "no/folder.png"])
def test_a_file_that_is_no_picture_or_cannot_be_written_is_refused(
    tmp_path: Path, name: str
) -> None:
    with pytest.raises(ConfigError, match=name.partition("/")[0]):
        save(figure([run_of(telemetry())]), tmp_path / name)


@pytest.mark.parametrize("axes", [1, 2, 6])
def test_every_panel_can_be_drawn_with_any_number_of_axes_or_samples(axes: int) -> None:
    vector = (1e-3,) * axes
    packets = [
        telemetry_packet(tick, position=vector, commanded_force=vector, applied_force=vector)
        for tick in range(50)
    ]
    columns = TelemetryColumns.from_packets(packets)
    runs = [run_of(packets), ("damper", columns, {"environment": {"kind": "damper"}})]
    runs += [run_of([]), run_of([replace(p, engagement=0.0) for p in packets])]
    drawing = figure(runs, list(PANELS))
    assert "surface" not in drawn(panel(drawing, 0, 1, 4))
    figure(runs[-1:], ["contact", "energy", "loop_delay"]).draw_without_rendering()


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
    many = [log.publish(n * 10_000, f"kind_{n % 12}", "", is_fault=True) for n in range(500)]
    found = marks(panel(figure([run], events=[many]), 0))
    assert sum(count for name, count in found.items() if name.startswith(("kind", "other"))) == 200


# --- What the environment was at that time -------------------------------------------------------


def moved(values: dict[str, str], tick: int = 100) -> list[Event]:
    return [EventLog("environment").emit(1_000_000 * tick, "parameter_set", "", values)]


def test_a_surface_that_is_moved_is_drawn_where_it_was() -> None:
    events = [moved({"environment.position": "0.011", "links.force_command.delay": "0.02"})]
    drawing = figure([run_of(telemetry())], ["position", "force_over_penetration"], events)
    surface = drawn(drawing.axes[0])["surface"]
    assert surface.tolist() == [10.0] * 100 + [11.0] * 100
    _, applied = drawing.axes[1].lines
    depth = np.asarray(applied.get_xdata(), dtype=float)
    expected = run_of(telemetry())[1].position[:, 0] * 1e3 - surface
    np.testing.assert_allclose(depth, expected, atol=1e-12)


def test_a_phase_begins_with_the_launch_file_and_sets_its_own() -> None:
    label, columns, document = run_of(telemetry())
    phases = [{"name": "far", "set": {"environment.position": 0.02}}, {"name": "near", "set": {}}]
    log = EventLog("launcher")
    events = [
        log.emit(0, PHASE_BEGINS, "", {"name": "far"}),
        *moved({"environment.position": "0.03"}, 20),
        log.emit(50_000_000, PHASE_BEGINS, "", {"name": "near"}),
    ]
    run = (label, columns, {**document, "phases": phases})
    surface = drawn(figure([run], ["position"], [events]).axes[0])["surface"]
    assert surface[[0, 19, 20, 49, 50, 199]].tolist() == [20.0, 20.0, 30.0, 30.0, 10.0, 10.0]


@pytest.mark.parametrize(
    ("environment", "event", "expected"),
    [
        ({}, {"environment.stiffness": "4000.0"}, [4.0, 10.0]),
        ({"exponent": 1.5}, {}, []),  # force is no multiple of the depth
        ({"stiffness_rate": 10_000.0}, {}, [10.5, 12.0]),  # at its softest and stiffest
    ],
)
def test_each_stiffness_of_the_wall_has_a_line(
    environment: dict[str, Any], event: dict[str, str], expected: list[float]
) -> None:
    label, columns, document = run_of(telemetry())
    run = (label, columns, {"environment": document["environment"] | environment})
    axes = figure([run], ["force_over_penetration"], [moved(event)]).axes[0]
    np.testing.assert_allclose(sorted(slopes(axes.lines)), expected, rtol=0.01)


def test_a_run_of_several_axes_shows_the_size_of_the_force() -> None:
    vectors = {"commanded_force": (3.0, 4.0), "applied_force": (0.6, 0.8)}
    packets = [
        replace(p, position=(*p.position, 0.5), true_position=None, hand_force=None, **vectors)
        for p in telemetry()
    ]
    drawing = figure([run_of(packets)], list(PANELS))
    noted = [bool(axes.texts) for axes in drawing.axes]
    assert noted == [False, True, True, False, False, True, False, False]
    assert {"x", "y", "surface, x"} <= set(drawn(panel(drawing, 0)))
    forces = drawn(panel(drawing, 1))
    assert set(forces["commanded"]) == {5.0}  # against the limit, which is one of the magnitude
    np.testing.assert_allclose(forces["applied"], 1.0)
    assert drawn(panel(drawing, 5))["applied"][0] == 0.6
