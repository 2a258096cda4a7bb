"""A wall that is far away feels as stiff as a near one: physics in virtual time, fixed seeds."""

from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest
from live_graph import live_graph

from forcebound.errors import ConfigError
from forcebound.graph.loader import load
from forcebound.haptics.controllers.local_model import LocalModel
from forcebound.haptics.environments import EnvironmentModel
from forcebound.haptics.environments.walls import ActiveWall, Damper, TimeVaryingWall
from forcebound.haptics.laws.sample import ENERGY_TOLERANCE
from forcebound.network.impairment import Impairment
from forcebound.recordings.telemetry import TelemetryColumns
from forcebound.results.contact import count_bounces
from forcebound.results.summary import summarize
from forcebound.run.virtual import run_virtual
from forcebound_proofs.far_wall import LAWS, Figures, case, error_of, figures, scene, touching_hand

NEAR = 0  # ms


def slow(*values: Any) -> Any:
    """Return parameters of a test that is a campaign's."""
    return pytest.param(*values, marks=pytest.mark.slow)


@cache
def press(law: str, delay: int, controller: LocalModel | None, touches_before: bool) -> Figures:
    with TemporaryDirectory() as folder:
        hand = touching_hand(Path(folder)) if touches_before else None
        return figures(case(law, delay, controller, hand))[0]


@pytest.mark.parametrize("delay", [20, slow(50)])
@pytest.mark.parametrize("law", [LAWS[0], slow(LAWS[1])])
def test_after_the_first_contact_the_far_wall_feels_like_the_near_one(law: str, delay: int) -> None:
    near = press(law, NEAR, None, True)
    far = press(law, delay, LocalModel(), True)
    late = press(law, delay, None, True)
    assert far.stiffness >= 0.9 * near.stiffness
    assert far.energy >= -ENERGY_TOLERANCE
    assert far.bounces <= near.bounces + 1
    assert far.first <= late.first
    assert late.stiffness < 0.3 * near.stiffness  # what there is to gain


@pytest.mark.parametrize("law", [LAWS[0], slow(LAWS[1])])
def test_looking_ahead_makes_the_first_contact_stiff_when_an_answer_can_be_back(law: str) -> None:
    near = press(law, NEAR, None, False)
    far = press(law, 20, LocalModel(), False)
    assert far.stiffness >= 0.9 * near.stiffness
    assert far.bounces <= near.bounces + 1
    assert far.first <= 1.1 * near.first
    blind = press(law, 20, LocalModel(ahead=0.0), False)
    assert blind.stiffness < 0.5 * near.stiffness


def test_an_environment_beyond_the_age_limit_is_refused_only_for_a_controller_that_waits() -> None:
    arguments = ["delay:=100 ms", "age_limit:=100 ms"]
    load("far_wall", arguments)
    with pytest.raises(ConfigError, match="there would never be a force"):
        load("far_wall", [*arguments, "controller:=direct"])


@pytest.mark.parametrize(("delay", "most"), [(20, 0.03), slow(50, 0.1)])
def test_the_plane_turns_with_a_hand_that_strokes_over_a_sphere(delay: int, most: float) -> None:
    assert error_of(scene("touch_sphere", "local_model", delay))[0] < most


def test_without_it_the_force_on_the_sphere_is_another_one() -> None:
    assert error_of(scene("touch_sphere", "direct", 20))[0] > 1.0


@pytest.mark.slow
def test_ridges_finer_than_the_way_of_a_round_trip_are_felt_in_the_wrong_place() -> None:
    def correlation(pitch: int, delay: int) -> float:
        return error_of(scene(f"ridges {pitch}", "local_model", delay))[1]

    assert correlation(40, 20) > 0.9
    assert correlation(2, 20) < 0.5
    assert correlation(2, 0) > 0.9


def test_a_moving_body_far_away_is_pushed_by_a_past_hand() -> None:
    near, far = (error_of(scene("push_mass", "local_model", delay))[0] for delay in (0, 20))
    assert near < 0.2
    assert far > 1.0


def test_jitter_and_loss_on_the_links_leave_the_wall_stiff() -> None:
    link = Impairment(delay=0.02, jitter=0.005, loss=0.2)
    links = {"environment_query": link, "environment_reply": link}
    found = []
    for law in LAWS:
        near = press(law, NEAR, None, False)
        far, _ = figures(case(law, 20, LocalModel()).with_hand(links=links))
        assert far.energy >= -ENERGY_TOLERANCE
        found.append(far.stiffness / near.stiffness)
    assert min(found) >= 0.8


def test_a_wall_that_gets_stiffer_is_followed() -> None:
    config = load("far_wall", ["law:=none"])
    environment = TimeVaryingWall(stiffness=300.0, stiffness_rate=200.0)
    far = replace(config, environment=replace(config.environment, model=environment))
    columns = run_virtual(far, 3.0).columns
    depth = columns.position[-1, 0] - environment.position
    stiffness = environment.stiffness + environment.stiffness_rate * columns.elapsed[-1]
    assert columns.applied_force[-1, 0] == pytest.approx(stiffness * depth, rel=0.05)


MOVING = """
forcebound: 1
include: far_wall.yaml
phases:
  - { name: there, duration: 1 s }
  - { name: away, duration: 1 s, set: { environment.position: 11 mm } }
  - { name: back, duration: 1 s, set: { environment.position: 10.5 mm } }
"""


def test_a_wall_that_is_moved_is_followed_away_from_the_hand_and_towards_it(tmp_path: Path) -> None:
    file = tmp_path / "moving.yaml"
    file.write_text(MOVING)
    columns = run_virtual(load(file, ["law:=none", "stiffness:=2 N/mm"])).columns
    for end, surface in ((0.99, 0.010), (1.99, 0.011), (2.99, 0.0105)):
        at_end = int(np.searchsorted(columns.elapsed, end))
        depth = columns.position[at_end, 0] - surface
        assert columns.applied_force[at_end, 0] == pytest.approx(2000.0 * depth, rel=0.05)


CHANGING = """
forcebound: 1
include: far_wall.yaml
phases:
  - {{ name: as before, duration: 1 s }}
  - {{ name: changed, duration: 0.8 s, set: {{ environment.{0} }} }}
"""


def after_change(folder: Path, change: str, *arguments: str) -> tuple[TelemetryColumns, int]:
    """The columns of a press on a wall that changes after 1 s, and the sample of the change."""
    file = folder / "changing.yaml"
    file.write_text(CHANGING.format(change))
    columns = run_virtual(load(file, list(arguments))).columns
    return columns, int(np.searchsorted(columns.elapsed, 1.0))


@cache
def bounces_after(change: str, *arguments: str) -> int:
    with TemporaryDirectory() as folder:
        columns, changed = after_change(Path(folder), change, *arguments)
    return count_bounces(columns.true_position[changed:, 0])


@pytest.mark.parametrize("delay", [slow(10), 20, slow(30), slow(50)])
@pytest.mark.parametrize("change", ["stiffness: 1 N/mm", "position: 20 mm"])
def test_a_wall_that_softens_or_retreats_under_the_hand_does_not_ring(
    change: str, delay: int
) -> None:
    # The hand itself swings to its new place, as it does beside a wall without any delay.
    near = bounces_after(change, "controller:=direct", "delay:=0 ms")
    assert bounces_after(change, f"delay:={delay} ms") <= near + 1


@pytest.mark.parametrize("delay", [slow(10), 20, slow(50)])
@pytest.mark.parametrize("controller", ["local_model", "virtual_coupling"])
def test_the_force_of_a_wall_that_is_gone_ends_within_a_round_trip(
    tmp_path: Path, controller: str, delay: int
) -> None:
    arguments = (f"controller:={controller}", f"delay:={delay} ms")
    columns, changed = after_change(tmp_path, "position: 20 mm", *arguments)
    pressed = np.flatnonzero(columns.applied_force[changed:, 0] > 1e-3)
    assert 0 < pressed[-1] <= 1.1 * 2.0 * delay


@pytest.mark.parametrize("model", [ActiveWall(), Damper(damping=-5.0)])
def test_the_hand_gets_nothing_from_an_environment_that_lies(model: EnvironmentModel) -> None:
    config = load("far_wall")
    environment = replace(config.environment, model=model)
    result = run_virtual(replace(config, environment=environment), 1.0)
    found = summarize(result.columns, result.document)
    assert found["true_energy_min_j"] >= -ENERGY_TOLERANCE


@pytest.mark.live
def test_live_a_far_wall_answers_at_once_and_its_force_ends_with_the_environment() -> None:
    with live_graph("far_wall", "delay:=50 ms") as graph:
        graph.do("stop", "environment")
        graph.wait_until_released()
        ended = graph.end()
    pressed = (ended.columns.engagement > 0.0) & (ended.columns.applied_force[:, 0] > 0.0)
    assert ended.columns.loop_delay[pressed].min() < 0.05
    assert ended.summary["true_energy_min_j"] >= -ENERGY_TOLERANCE
