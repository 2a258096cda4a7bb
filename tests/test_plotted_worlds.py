"""Plots of what the environment was at that time, and of several axes."""

import numpy as np
from msgspec.structs import replace
from plotted import drawn, panel, run_of, slopes, telemetry

from forcebound.analysis.panels import PANELS
from forcebound.analysis.plots import figure
from forcebound.messages.packets import Event
from forcebound.nodes.events import PHASE_BEGINS, EventLog


def moved(values: dict[str, str], tick: int = 100) -> list[Event]:
    return [EventLog("environment").emit(1_000_000 * tick, "parameter_set", "", values)]


def test_a_surface_that_is_moved_is_drawn_where_it_was() -> None:
    events = [moved({"environment.position": "0.011", "links.force_command.delay": "0.02"})]
    drawing = figure([run_of(telemetry())], ["position", "force_over_penetration"], events)
    surface = drawn(drawing.axes[0])["surface"]
    assert surface[:100].tolist() == [10.0] * 100
    assert surface[100:].tolist() == [11.0] * 100
    _, applied = drawing.axes[1].lines
    depth = np.asarray(applied.get_xdata(), dtype=float)
    expected = run_of(telemetry())[1].position[:, 0] * 1e3 - surface
    np.testing.assert_allclose(depth, expected, atol=1e-12)


def test_a_wall_that_changes_has_a_line_for_each_of_its_stiffnesses() -> None:
    events = [moved({"environment.stiffness": "4000.0"})]
    wall, soft, _ = sorted(
        figure([run_of(telemetry())], ["force_over_penetration"], events).axes[0].lines,
        key=lambda line: str(line.get_label()),
        reverse=True,
    )
    assert [wall.get_label(), soft.get_label()] == ["wall, 4 N/mm", "wall, 10 N/mm"]
    assert slopes([wall, soft]) == [4.0, 10.0]


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


def test_a_wall_whose_force_is_no_multiple_of_the_depth_has_no_line() -> None:
    label, columns, document = run_of(telemetry())
    wall = {**document["environment"], "exponent": 1.5}
    axes = figure([(label, columns, {"environment": wall})], ["force_over_penetration"]).axes[0]
    assert [line.get_label() for line in axes.lines] == ["applied"]


def test_a_wall_that_stiffens_is_drawn_at_its_softest_and_stiffest() -> None:
    label, columns, document = run_of(telemetry())
    wall = {**document["environment"], "stiffness_rate": 10_000.0}
    axes = figure([(label, columns, {"environment": wall})], ["force_over_penetration"]).axes[0]
    np.testing.assert_allclose(slopes(axes.lines[:2]), [10.5, 12.0], rtol=0.01)


def test_a_run_of_several_axes_says_what_it_shows() -> None:
    packets = [
        replace(
            p,
            position=(*p.position, 0.5),
            commanded_force=(3.0, 4.0),
            applied_force=(0.6, 0.8),
            true_position=None,
            hand_force=None,
        )
        for p in telemetry()
    ]
    drawing = figure([run_of(packets)], list(PANELS))
    notes = [[text.get_text() for text in axes.texts] for axes in drawing.axes]
    normal, magnitude = "along the normal", "magnitude over 2 axes"
    assert notes == [[], [magnitude], [normal], [], [], [normal], [], []]
    assert {"x", "y", "surface, x"} <= set(drawn(panel(drawing, 0)))
    (band,) = panel(drawing, 1).collections
    assert band.get_label() == "limit of the\nwhole vector"
    forces = drawn(panel(drawing, 1))
    assert set(forces["commanded"]) == {5.0}  # against the limit, which is one of the magnitude
    np.testing.assert_allclose(forces["applied"], 1.0)
    assert drawn(panel(drawing, 5))["applied"][0] == 0.6
