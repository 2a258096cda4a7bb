"""Figures and pictures of runs in two and three axes, from what the environment said."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from builders import telemetry_packet
from numpy.typing import NDArray

from forcebound.errors import ConfigError
from forcebound.messages.events import PARAMETERS_SET, EventLog
from forcebound.recordings.telemetry import TelemetryColumns
from forcebound.results.plots import figure
from forcebound.results.summary import summarize
from forcebound.results.surface import touch_of_run
from forcebound.results.tables import summary_rows

Floats = NDArray[np.float64]
RADIUS, STIFFNESS, FRICTION = 0.03, 1000.0, 0.3
SPHERE: dict[str, Any] = {
    "device": {"law": "none", "mass": 0.1, "rate": 1000.0},
    "environment": {"kind": "solid", "stiffness": STIFFNESS, "position": [0.0, 0.0, 0.0]},
}


def run_of(path: Callable[[float], Sequence[float]], seconds: float = 6.0) -> TelemetryColumns:
    """Return a hand that moves along ``path`` (m, of s) over a sphere with friction about 0."""
    packets, proxies, normals = [], [], []
    for tick in range(round(seconds * 1e3)):
        position = np.array(path(tick * 1e-3))
        distance = float(np.linalg.norm(position))
        normal = position / distance
        depth = max(RADIUS - distance, 0.0)
        across = np.cross(normal, (0.0, 0.0, 1.0))
        force = -STIFFNESS * depth * (normal + FRICTION * across / np.linalg.norm(across))
        packets.append(
            telemetry_packet(
                tick,
                position=tuple(position.tolist()),
                true_position=tuple(position.tolist()),
                hand_force=(0.0, 0.0, 0.0),
                commanded_force=tuple(force.tolist()),
                applied_force=tuple(force.tolist()),
                true_energy=0.001,
            )
        )
        # Friction holds the proxy back: force is stiffness times (position - proxy).
        proxies.append(position - force / STIFFNESS if depth > 0.0 else np.full(3, math.nan))
        normals.append(normal if depth > 0.0 else np.full(3, math.nan))
    columns = TelemetryColumns.from_packets(packets)
    answered = np.ones(len(packets), dtype=np.bool_)
    return replace(columns, is_answered=answered, proxy=np.array(proxies), normal=np.array(normals))


def around(elapsed: float) -> Sequence[float]:
    """Come along the diagonal of x and y to 2 mm behind the surface, then circle about z."""
    angle = math.pi / 4 + 0.3 * max(elapsed - 1.0, 0.0)
    distance = max(0.05 - 0.1 * elapsed, RADIUS - 0.002)
    return (distance * math.cos(angle), distance * math.sin(angle), 0.0)


def summary_of(columns: TelemetryColumns) -> dict[str, Any]:
    return summarize(columns, SPHERE)


def test_stiffness_and_penetration_are_along_the_normal_of_what_was_touched() -> None:
    figures = summary_of(run_of(around))
    assert figures["displayed_stiffness_n_per_m"] == pytest.approx(STIFFNESS)
    assert figures["peak_penetration_m"] == pytest.approx(0.002)
    assert figures["rate_hardness_n_per_m"] == pytest.approx(STIFFNESS)
    assert figures["wall_error_rms_n"] == pytest.approx(0.0, abs=1e-9)
    assert figures["contact_bounces"] == 0


def test_friction_shows_across_the_normal() -> None:
    figures = summary_of(run_of(around))
    assert figures["peak_tangential_force_n"] == pytest.approx(FRICTION * STIFFNESS * 0.002)
    assert figures["tangential_share"] == pytest.approx(FRICTION)
    expected = 0.002 * math.hypot(1.0, FRICTION)
    assert figures["peak_proxy_distance_m"] == pytest.approx(expected)
    rows = dict(summary_rows(figures))
    assert rows["peak tangential force"] == "0.60 N"
    assert rows["tangential over normal force"] == "30 %"
    assert rows["peak proxy distance"] == "2.09 mm"


def test_a_hand_that_leaves_and_returns_has_bounced() -> None:
    def taps(elapsed: float) -> Sequence[float]:
        return (RADIUS + 0.003 * math.cos(2.0 * math.pi * elapsed), 0.001, 0.0)

    assert summary_of(run_of(taps, 4.0))["contact_bounces"] == 7


def test_a_hand_beside_a_sphere_is_in_free_motion_although_behind_the_plane_it_touched() -> None:
    def passes(elapsed: float) -> Sequence[float]:
        distance = RADIUS - 0.001 if elapsed < 1.0 else RADIUS + 0.001
        angle = max(elapsed - 1.0, 0.0)  # around the sphere, outside
        return (distance * math.cos(angle), distance * math.sin(angle), 0.0)

    touch = touch_of_run(run_of(passes, 3.0), (), SPHERE)
    assert touch is not None
    assert touch.depth.max() == pytest.approx(0.001)
    assert touch.depth[-1] <= 0.0


def test_a_tick_without_an_answer_has_the_surface_of_the_newest_one_before() -> None:
    columns = run_of(around)
    answered = columns.is_answered.copy()
    answered[1::3] = False
    sparse = replace(
        columns,
        is_answered=answered,
        proxy=np.where(answered[:, np.newaxis], columns.proxy, math.nan),
        normal=np.where(answered[:, np.newaxis], columns.normal, math.nan),
    )
    figures = summary_of(sparse)
    assert figures["displayed_stiffness_n_per_m"] == pytest.approx(STIFFNESS, rel=1e-2)
    assert figures["contact_bounces"] == 0


def test_the_stiffness_of_the_surface_is_that_of_the_time() -> None:
    event = EventLog("environment").emit(3_000_000_000, PARAMETERS_SET, "", {
        "environment.stiffness": "500.0"
    })  # fmt: skip
    touch = touch_of_run(run_of(around), [event], SPHERE)
    assert touch is not None
    stiffness = np.asarray(touch.stiffness)
    assert (stiffness[2999], stiffness[3000]) == (1000.0, 500.0)
    assert touch.constant_stiffness is None


def test_a_run_that_touched_nothing_says_why_it_has_no_figures() -> None:
    figures = summary_of(run_of(lambda elapsed: (0.1, 0.0, 0.0), 1.0))
    assert figures["displayed_stiffness_n_per_m"] is None
    assert figures["undefined"]["peak_penetration_m"].startswith(
        "the environment describes no surface"
    )
    assert figures["undefined"]["peak_proxy_distance_m"].startswith(
        "the environment describes no surface"
    )


def run_on_one_axis() -> TelemetryColumns:
    packets = [telemetry_packet(tick, position=(0.001 * tick,)) for tick in range(100)]
    return TelemetryColumns.from_packets(packets)


def test_a_run_on_one_axis_has_nothing_across_it() -> None:
    wall = {"position": 0.01, "stiffness": 1e3}
    figures = summarize(run_on_one_axis(), {"environment": wall})
    assert figures["peak_tangential_force_n"] is None
    assert figures["undefined"]["peak_tangential_force_n"] == "the run has one axis"
    assert "peak tangential force" not in dict(summary_rows(figures))


SCALED = {"kind": "scaled", "motion_scale": 4.0, "force_scale": 0.5, "origin": 0.01}


def test_behind_a_scale_the_surface_is_where_the_hand_feels_it() -> None:
    felt = run_of(around)
    columns = replace(felt, proxy=4.0 * felt.proxy + 0.01)  # as the environment says it
    stiffness = STIFFNESS / (4.0 * 0.5)
    environment = SPHERE["environment"] | {"stiffness": stiffness}
    config = SPHERE | {"environment": environment, "controller": SCALED}
    figures, expected = summarize(columns, config), summary_of(felt)
    names = ("displayed_stiffness_n_per_m", "peak_penetration_m", "peak_proxy_distance_m")
    assert [figures[name] for name in names] == pytest.approx([expected[name] for name in names])
    assert figures["wall_error_rms_n"] == pytest.approx(0.0, abs=1e-9)
    _, proxy = figure([("a sphere", columns, config)], ["position"]).axes[0].lines[:2]
    np.testing.assert_allclose(np.asarray(proxy.get_ydata()), felt.proxy[:, 0] * 1e3)


def test_behind_a_scale_a_flat_wall_is_where_the_hand_feels_it() -> None:
    wall = {"kind": "wall", "position": 0.09, "stiffness": STIFFNESS}
    touch = touch_of_run(run_on_one_axis(), (), {"environment": wall, "controller": SCALED})
    assert touch is not None
    assert touch.depth[50] == pytest.approx(0.05 - 0.02)
    assert touch.constant_stiffness == pytest.approx(4.0 * 0.5 * STIFFNESS)


@pytest.mark.parametrize("setting", [{"clutch_button": 0}, {"border": 0.05}])
def test_with_a_clutch_or_a_border_no_place_of_the_environment_stays_at_the_hand(
    setting: dict[str, Any],
) -> None:
    config = SPHERE | {"controller": {"kind": "scaled", **setting}}
    figures = summarize(run_of(around, 1.0), config)
    assert figures["peak_penetration_m"] is None
    assert figures["undefined"]["peak_penetration_m"].startswith("a clutch or a border")
    axes = figure([("a sphere", run_of(around, 1.0), config)], ["position"]).axes[0]
    assert [line.get_label() for line in axes.lines] == ["x", "y", "z"]


def test_a_scale_that_is_none_is_refused() -> None:
    for value in (0.0, "large"):
        config = SPHERE | {"controller": {"kind": "scaled", "motion_scale": value}}
        with pytest.raises(ConfigError, match="scales must be numbers"):
            summarize(run_on_one_axis(), config)


# --- Pictures ------------------------------------------------------------------------------------


def test_a_picture_of_three_axes_names_each_and_shows_the_paths() -> None:
    columns = run_of(around, 2.0)
    position, force, energy, delay, xy, xz = figure([("a sphere", columns, SPHERE)]).axes
    names = [str(line.get_label()) for line in position.lines]
    assert names == ["x", "x, proxy", "y", "y, proxy", "z", "z, proxy"]
    assert [(xy.get_xlabel(), xy.get_ylabel()), (xz.get_xlabel(), xz.get_ylabel())] == [
        ("x (mm)", "y (mm)"),
        ("x (mm)", "z (mm)"),
    ]
    proxy, tip, start = xy.lines
    assert [proxy.get_label(), tip.get_label(), start.get_label()] == ["proxy", "tip", "start"]
    np.testing.assert_array_equal(tip.get_ydata(), columns.position[:, 1] * 1e3)
    np.testing.assert_array_equal(proxy.get_ydata(), columns.proxy[:, 1] * 1e3)
    assert xy.get_aspect() == 1.0
    assert (force.get_ylabel(), energy.get_ylabel()) == ("force (N)", "energy (mJ)")
    assert delay.get_xlabel() == "time since the force engaged (s)"


def test_force_over_penetration_is_along_the_normal() -> None:
    axes = figure([("a sphere", run_of(around), SPHERE)], ["force_over_penetration"]).axes[0]
    depth, force = (np.asarray(data, float) for data in axes.lines[-1].get_data())
    inside = depth > 0.0
    np.testing.assert_allclose(force[inside], depth[inside] * STIFFNESS * 1e-3)
