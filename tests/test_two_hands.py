"""Two hands in one graph: the shipped launch files against physics, and the figures of both."""

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from invoking import invoke
from launch_texts import written

from forcebound.graph.loader import load
from forcebound.haptics.devices.plant import Axis, Moving, advance_extended
from forcebound.haptics.hands.hands import WallInPlace
from forcebound.haptics.laws import ENERGY_TOLERANCE
from forcebound.results.coupling import coupling, coupling_lines
from forcebound.run.results import RunResult
from forcebound.run.virtual import run_virtual_hands
from forcebound.units import energy_in_words

FRICTION = 0.12  # N, of a device


def run(file: str, *arguments: str, seconds: float = 2.0) -> dict[str, RunResult]:
    return run_virtual_hands(load(file, arguments), seconds)


def figures_of(results: dict[str, RunResult]) -> dict[str, Any]:
    columns = {hand: one.columns for hand, one in results.items()}
    return coupling(columns, {hand: one.document for hand, one in results.items()})


def last(values: Any) -> float:
    return float(values[-1][0])


def test_a_box_at_rest_is_pressed_from_both_sides_with_the_same_force() -> None:
    results = run("two_hands", "law:=none", "stiffness:=2 N/mm", seconds=3.0)
    left, right = (results[hand].columns for hand in ("left", "right"))
    assert last(left.applied_force) > 1.0
    assert last(left.applied_force) == pytest.approx(-last(right.applied_force), rel=0.01)
    gap = last(right.true_position) - last(left.true_position)
    depths = 2.0 * last(left.applied_force) / 2000.0
    assert gap == pytest.approx(0.020 - depths, abs=6e-5)  # two steps of the encoders


def test_the_verdicts_of_a_late_box_are_those_of_the_page() -> None:
    page = (Path(__file__).parent.parent / "docs/two-hands.md").read_text(encoding="utf-8")
    shown = page.partition('two_hands delay:="10 ms"` prints:\n\n```\n')[2].partition("```")[0]
    printed = invoke("simulate", "two_hands", "delay:=10 ms").output.splitlines()
    lines = [line for line in shown.splitlines() if line.strip() != "..."]
    assert len(lines) > 4
    assert [line for line in lines if line not in printed] == []
    right = printed[printed.index("right:") :]
    (share,) = re.findall(r"\((\d+) %\) because the left one", page.replace("\n", " "))
    assert any(f"({share}%)" in line for line in right)


def test_a_box_between_certified_hands_takes_more_than_it_gives() -> None:
    together = figures_of(run("two_hands", "delay:=10 ms"))
    assert together["energy_min_j"] >= -ENERGY_TOLERANCE
    assert "position_error_rms_m" not in together
    assert "passive" in next(coupling_lines(together))


def test_a_late_follower_is_behind_by_the_way_of_the_delay() -> None:
    # 1 N/mm: what the follower's friction and damping take of the coupling is the same in both.
    speed, errors = 0.02, []
    for delay in (0, 10):
        arguments = ("law:=none", f"approach_speed:={speed} m/s", f"delay:={delay} ms")
        results = run("leader_follower", *arguments, "wall:=0 N/m", seconds=0.9)
        leader, follower = (results[hand].columns for hand in ("leader", "follower"))
        moves = (leader.time > 0.5) & (leader.time < 0.85)
        behind = leader.true_position[moves, 0] - follower.true_position[moves, 0]
        errors.append(float(np.mean(behind)))
    # The force holds until the next tick; then there is the computation of the next, 0.4 ms.
    drag, lag = FRICTION + 0.27 * speed, 1.5e-3
    assert errors[0] == pytest.approx(drag / 1000.0 + speed * lag, abs=3e-5)  # an encoder's step
    assert errors[1] - errors[0] == pytest.approx(speed * 0.010, rel=0.05)


@pytest.mark.parametrize(("wall", "stiffness"), [(1.0, 1.0), (0.5, 2.0)])
def test_coupling_and_wall_are_felt_as_springs_in_series(wall: float, stiffness: float) -> None:
    arguments = (f"wall:={wall} N/mm", f"coupling_stiffness:={stiffness} N/mm")
    together = figures_of(run("leader_follower", "law:=none", *arguments))
    series = 1000.0 * wall * stiffness / (wall + stiffness)
    assert together["series_stiffness_n_per_m"] == pytest.approx(series)
    assert together["follower_stiffness_n_per_m"] == 1000.0 * wall
    # Friction of the follower bears some of the coupling's force, which is 2 N or more.
    felt = together["transmitted_stiffness_n_per_m"]
    assert felt == pytest.approx(series, rel=FRICTION / 2.0)


def test_a_leader_that_moves_to_and_fro_has_no_stiffness_felt() -> None:
    together = figures_of(run("leader_follower", "law:=none", "delay:=10 ms"))
    assert together["leader_at_rest"] is False
    assert together["transmitted_stiffness_n_per_m"] is None
    assert together["series_stiffness_n_per_m"] > 0.0
    assert any("not known" in line for line in coupling_lines(together))


def test_a_follower_that_has_not_come_to_its_wall_shows_none() -> None:
    results = run("leader_follower")  # its law lets it do next to no work
    reach = np.max(results["follower"].columns.true_position)
    wall = results["follower"].document["operator"]
    assert reach < wall["start"] + wall["gap"] < np.max(results["leader"].columns.true_position)
    together = figures_of(results)
    assert together["transmitted_stiffness_n_per_m"] is None
    assert not any("the leader feels" in line for line in coupling_lines(together))


def test_four_channels_show_the_wall_itself() -> None:
    together = figures_of(run("leader_follower", "law:=none", "architecture:=four_channel"))
    assert together["series_stiffness_n_per_m"] is None
    assert together["transmitted_stiffness_n_per_m"] == pytest.approx(1000.0, rel=0.03)


def test_a_mirrored_and_scaled_follower_shows_the_scaled_wall() -> None:
    # The hand moves to positive x, the follower twice as far to negative x, away from its wall.
    free = figures_of(run("leader_follower", "law:=none", "scale:=-0.5"))
    assert free["transmitted_stiffness_n_per_m"] is None
    results = run("leader_follower", "law:=none", "scale:=2", "gap:=20 mm")
    felt = figures_of(results)
    assert felt["follower_stiffness_n_per_m"] == 4000.0
    assert felt["transmitted_stiffness_n_per_m"] == pytest.approx(4.0 * 500.0, rel=0.06)
    at = {hand: last(one.columns.true_position) for hand, one in results.items()}
    wall = 1000.0 * (at["follower"] - 0.020)
    assert 1000.0 * (2.0 * at["leader"] - at["follower"]) == pytest.approx(wall, abs=FRICTION)


def test_without_transfer_a_certified_follower_does_no_work_and_with_it_both_are_passive() -> None:
    alone, paired = (run(f"leader_follower{name}") for name in ("", "_transfer"))
    gap = 0.010
    assert last(alone["follower"].columns.true_position) == pytest.approx(0.0, abs=1e-4)
    assert last(paired["follower"].columns.true_position) > gap + 0.002
    without, together = figures_of(alone), figures_of(paired)
    assert without["given_energy_j"] == {"leader": None, "follower": None}
    assert together["energy_end_j"]["follower"] < -1e-3  # it has done work on its wall
    assert together["given_energy_j"]["leader"] > -together["energy_end_j"]["follower"]
    lowest = [together["energy_min_j"], *together["energy_with_partner_min_j"].values()]
    assert min(lowest) >= -ENERGY_TOLERANCE
    assert together["position_error_rms_m"] < 0.5 * without["position_error_rms_m"]
    line = paired["follower"].summary["verdict"][0]
    assert line.startswith("What it meets received")  # nobody holds it
    assert "leader" in line
    given, net = together["given_energy_j"], together["net_given_energy_j"]
    on_its_way = 1e-3  # J, at most
    assert net["leader"] == pytest.approx(given["leader"] - given["follower"], abs=on_its_way)
    assert 0.0 < net["leader"] < given["leader"]
    (shown,) = [one for one in coupling_lines(together) if "transfer" in one]
    assert energy_in_words(net["leader"]) in shown
    assert "follower" not in shown


def test_the_same_run_has_the_same_bits() -> None:
    first, second = (run("leader_follower_transfer", "delay:=3 ms", seconds=0.5) for _ in range(2))
    for hand, one in first.items():
        other = second[hand].columns
        for name in ("time_ns", "true_position", "applied_force", "true_energy", "given_energy"):
            np.testing.assert_array_equal(getattr(one.columns, name), getattr(other, name))


def test_a_wall_in_place_of_the_hand_only_pushes_and_gives_back_what_it_got() -> None:
    mass, stiffness, gap, step = 0.2, 1000.0, 0.010, 5e-5
    axis = Axis(mass, 0.0, 0.0, 0.0, 0.0, 0.0, stiffness, 0.0, gap)
    moving, forces = Moving(0.0, 0.1, 0.0, 0.0, 0.0), []
    for _ in range(round(0.5 / step)):
        moving, force = advance_extended(moving, axis, 0.0, 0.0, step, step, 0.0)
        forces.append(force)
    deepest = 0.1 * (mass / stiffness) ** 0.5
    assert -min(forces) == pytest.approx(stiffness * deepest, rel=0.01)
    assert max(forces) < 0.01
    assert moving.v == pytest.approx(-0.1, rel=0.01)
    assert forces[-1] == 0.0


def test_a_wall_in_place_of_the_hand_acts_across_the_first_axis_alone() -> None:
    config = load("three_axes", ["law:=none", "stiffness:=0 N/m"])
    wall = WallInPlace(gap=0.0, stiffness=500.0)
    model = config.only.device
    device = model.open(wall, 0.01)
    device.engage(0)
    device.read(1_000_000)
    device.write(1_000_000, (-1.0, 0.5, 0.0))  # a force that is positive resists
    for tick in range(2, 400):
        device.read(tick * 1_000_000)
        device.write(tick * 1_000_000, (-1.0, 0.5, 0.0))
    truth = device.truth()
    assert truth is not None
    assert truth.position[0] == pytest.approx(1.0 / 500.0, abs=FRICTION / 500.0)
    assert truth.hand_force[1:] == (0.0, 0.0)
    assert truth.position[1] < -0.005


@pytest.mark.parametrize("kind", ["serial_arm", "knob", "five_bar", "desktop_arm"])
def test_an_arm_follows_into_its_wall(kind: str, tmp_path: Path) -> None:
    hands = "".join(
        f"  {hand}: {{ device: {{ kind: {kind}, law: none, saturation: 1 N m }} }}\n"
        for hand in ("leader", "follower")
    )
    path = written(tmp_path, f"forcebound: 1\ninclude: leader_follower.yaml\nhands:\n{hands}")
    together = figures_of(run(str(path)))
    # Friction of the follower bears some of the coupling's force, which is 2 N or more.
    friction = 2.0 * FRICTION
    felt = together["transmitted_stiffness_n_per_m"]
    assert felt == pytest.approx(together["series_stiffness_n_per_m"], rel=friction / 2.0)
    assert together["follower_stiffness_n_per_m"] == 1000.0


def test_the_figures_follow_the_verdicts_of_the_hands(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("forcebound.cli.outcome.cache_folder", lambda name: tmp_path)
    arguments = ("simulate", "leader_follower", "law:=none", "--duration", "1.5s")
    text = invoke(*arguments).output
    assert text.index("follower:") < text.index("Together: passive") < text.index("All figures")
    together = json.loads(invoke(*arguments, "--json").stdout)["coupling"]
    assert together["follower_stiffness_n_per_m"] == 1000.0
    assert together["energy_with_partner_min_j"] == {"leader": None, "follower": None}


def test_hands_that_began_apart_are_said_with_their_figures(tmp_path: Path) -> None:
    change = "hands: { follower: { operator: { start: 30 mm, gap: 50 mm } } }\n"
    apart = written(tmp_path, f"forcebound: 1\ninclude: leader_follower.yaml\n{change}")
    figures = figures_of(run(str(apart), seconds=0.3))
    assert figures["position_error_start_m"] == pytest.approx(0.030, abs=1e-3)
    assert any("began 30.00 mm apart" in line for line in coupling_lines(figures))
    together = figures_of(run("leader_follower", seconds=0.3))
    assert not any("apart" in line for line in coupling_lines(together))


def test_hands_that_share_no_time_have_no_figures() -> None:
    results = run("leader_follower", seconds=0.3)
    columns = {hand: one.columns for hand, one in results.items()}
    columns["follower"] = columns["follower"].slice(columns["follower"].time < -1.0)
    figures = coupling(columns, {hand: one.document for hand, one in results.items()})
    assert figures["energy_min_j"] is None
    assert figures["position_error_rms_m"] is None
