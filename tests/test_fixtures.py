"""Virtual fixtures: their forces, their potentials, and how a launch file names them."""

from pathlib import Path

import numpy as np
import pytest
from launch_texts import problems_of, written

from forcebound.errors import ConfigError
from forcebound.graph.loader import load
from forcebound.graph.model import always, restore
from forcebound.graph.resolved import to_document
from forcebound.haptics.environments import open_environment
from forcebound.haptics.environments.contract import check
from forcebound.haptics.environments.fixtures import (
    Fixtures,
    ForbiddenRegion,
    GuidancePath,
    GuidancePlane,
    HandFixtures,
    SpeedLimit,
    WithFixtures,
    WorkspaceLimit,
)
from forcebound.haptics.environments.walls import Wall
from forcebound.haptics.geometry.vectors import Vector3
from forcebound.run.virtual import run_virtual

STILL = (0.0, 0.0, 0.0)
PLANE = GuidancePlane(point=(0.0, 0.0, 0.01), normal=(0.0, 0.0, 2.0), stiffness=400.0, reach=0.02)
PATH = GuidancePath(points=((0.0,), (0.05,), (0.05, 0.05)), stiffness=300.0, reach=0.02)
BOX = ForbiddenRegion(centre=(0.03, 0.0, 0.0), size=(0.02, 0.03, 0.04), stiffness=1000.0)
BALL = ForbiddenRegion(centre=(-0.03, 0.0, 0.0), radius=0.02, stiffness=1000.0)
LIMIT = WorkspaceLimit(low=(-0.05, -0.04), high=(0.05, 0.04), stiffness=2000.0, damping=5.0)
ALL = Fixtures(plane=PLANE, path=PATH, workspace=LIMIT, forbidden=(BOX, BALL))


def test_plane_draws_along_its_normal_and_lets_go_at_its_reach() -> None:
    near = PLANE.force((0.3, 0.2, 0.011), STILL)
    assert near == pytest.approx((0.0, 0.0, 400.0 * 0.001), rel=0.01)  # resists the way off
    assert PLANE.force((0.0, 0.0, 0.031), STILL) == STILL


def test_path_draws_to_its_closest_point() -> None:
    assert PATH.closest((0.06, 0.02, 0.0)) == pytest.approx((0.05, 0.02, 0.0))
    assert PATH.closest((-0.01, 0.01, 0.0)) == pytest.approx((0.0, 0.0, 0.0))
    x, y, z = PATH.force((0.051, 0.02, 0.0), STILL)
    assert x == pytest.approx(300.0 * 0.001, rel=0.01)
    assert (y, z) == pytest.approx((0.0, 0.0), abs=1e-12)


def test_forbidden_regions_push_out_by_the_nearest_way() -> None:
    assert BOX.force((0.039, 0.0, 0.0), STILL) == pytest.approx((-1.0, 0.0, 0.0))
    assert BOX.force((0.03, -0.014, 0.0), STILL) == pytest.approx((0.0, 1.0, 0.0))
    assert BOX.force((0.05, 0.0, 0.0), STILL) == STILL
    assert BALL.force((-0.03, 0.0, 0.019), STILL) == pytest.approx((0.0, 0.0, -1.0))
    assert np.linalg.norm(BALL.force((-0.03, 0.0, 0.0), STILL)) == pytest.approx(20.0)


def test_workspace_is_a_soft_wall_that_only_resists() -> None:
    inside = LIMIT.force((0.05, -0.04, 9.0), (1.0, -1.0, 1.0))
    assert inside == STILL
    outwards = LIMIT.force((0.051, -0.041, 0.0), (0.1, 0.1, 0.0))
    assert outwards == pytest.approx((2.0 + 0.5, -2.0, 0.0))


def test_speed_limit_slows_a_hand_down_and_draws_nothing() -> None:
    limit = SpeedLimit(limit=0.1, damping=5.0)
    assert limit.force(STILL, (0.0, 0.1, 0.0)) == STILL
    assert limit.force(STILL, (0.0, -0.3, 0.4)) == pytest.approx((0.0, -1.2, 1.6))  # 5 x 0.4 m/s
    fixtures = Fixtures(hands={"left": HandFixtures(speed=limit)})
    assert fixtures.on("left", STILL, (0.3, 0.0, 0.0)) == pytest.approx((1.0, 0.0, 0.0))
    assert fixtures.on("right", STILL, (0.3, 0.0, 0.0)) == STILL
    assert fixtures.drawn() == ()


@pytest.mark.parametrize("fixture", [PLANE, PATH, BOX, BALL, Fixtures(plane=PLANE, path=PATH)])
def test_a_closed_way_costs_and_gives_no_energy(
    fixture: GuidancePlane | GuidancePath | ForbiddenRegion | Fixtures,
) -> None:
    random = np.random.default_rng(1)
    corners = random.uniform(-0.04, 0.04, (5, 3))
    steps = np.linspace(0.0, 1.0, 4000)[:, None]
    way = np.concatenate(
        [a + steps * (b - a) for a, b in zip(corners, np.roll(corners, -1, 0), strict=True)]
    )
    middles = 0.5 * (way[1:] + way[:-1])
    forces = np.array([fixture.force((x, y, z), STILL) for x, y, z in middles])
    work = np.einsum("ij,ij->i", forces, np.diff(way, axis=0))
    assert abs(work.sum()) < 1e-3 * np.abs(work).sum() + 1e-12


def test_fixtures_keep_the_contract_of_environments() -> None:
    report = check(WithFixtures(Wall(), ALL))
    assert not report.violations, report.violations


def test_fixtures_beside_a_wall_add_to_its_force() -> None:
    opened = open_environment(WithFixtures(Wall(stiffness=100.0, position=0.0), ALL), 2)
    here: Vector3 = (0.02, 0.005, 0.0)
    more = ALL.force(here, STILL)
    assert opened.force("", here[:2], (0.0, 0.0), 1.0) == pytest.approx((2.0 + more[0], more[1]))
    assert opened.contact("") is None  # a wall reports none


FILE = """
include: stiff_wall.yaml
environment:
  fixtures:
    workspace: { low: [-20 mm], high: [5 mm], stiffness: 2 N/mm, damping: 1 N s/m }
    forbidden: [{ centre: [1, 1, 1], radius: 3 cm }]
"""


def test_a_launch_file_names_fixtures_and_the_hand_rests_on_the_limit(tmp_path: Path) -> None:
    config = load(written(tmp_path, FILE), ["law:=none", "approach_speed:=35 mm/s"])
    assert restore(to_document(config), always) == config
    result = run_virtual(config)
    depth = result.columns.true_position[-1, 0] - 0.005
    assert depth == pytest.approx(
        950.0 * (0.014 - 0.005) / (2000.0 + 950.0), abs=1.5e-4
    )  # friction of 0.12 N


@pytest.mark.parametrize(
    ("fixture", "words"),
    [
        ("plane: { normal: [0, 0, 0] }", "normal: expected a direction"),
        ("path: { points: [[0]] }", "points: expected 2 to 64, got 1"),
        ("forbidden: [{ centre: [0] }]", "needs size (a box) or radius (a sphere)"),
        ("forbidden: [{ centre: [0], size: [1 cm] }]", "size: expected three edges in m, got 1"),
        ("workspace: { low: [1 mm], high: [0 mm] }", "low: expected less than high"),
    ],
)
def test_a_wrong_fixture_is_a_problem_at_its_place(
    tmp_path: Path, fixture: str, words: str
) -> None:
    file = written(tmp_path, f"include: stiff_wall.yaml\nenvironment:\n  fixtures: {{ {fixture} }}")
    assert words in problems_of(file)
    with pytest.raises(ConfigError):
        load(file)
