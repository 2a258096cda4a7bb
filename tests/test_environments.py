"""The contract of every environment, and the force law of each."""

import math
from pathlib import Path

import pytest

from forcebound.errors import ConfigError
from forcebound.graph.loader import load
from forcebound.haptics.environments import (
    ENVIRONMENTS,
    EnvironmentModel,
    StatelessEnvironment,
)
from forcebound.haptics.environments.contract import check
from forcebound.haptics.environments.recorded import RecordedEnvironment
from forcebound.haptics.environments.walls import (
    ActiveWall,
    DampedWall,
    Damper,
    PowerLawWall,
    TimeVaryingWall,
    Wall,
)
from forcebound.run.virtual import run_virtual

WALLS = (Wall, TimeVaryingWall, PowerLawWall, ActiveWall)


FREE_AT_5_MM: dict[type, dict[float, float]] = {wall: {0.005: 0.0} for wall in (*WALLS, DampedWall)}


def model_of(name: str, folder: Path) -> EnvironmentModel:
    if name == "bodies":
        return load("push_boxes").environment.model
    if name == "recorded":
        run_virtual(load("three_axes"), 0.05, folder / "run.mcap")
        return RecordedEnvironment(folder / "run.mcap")
    return ENVIRONMENTS[name]()


@pytest.mark.parametrize("name", sorted(ENVIRONMENTS))
def test_every_environment_keeps_the_contract(name: str, tmp_path: Path) -> None:
    model, at_rest = model_of(name, tmp_path), FREE_AT_5_MM.get(ENVIRONMENTS[name])
    at_most = 60 if name == "bodies" else None  # it is slow
    axes = (1, 2, 3, 6) if at_rest else (1, 3)
    report = check(model, axes, at_rest, at_most)
    assert report.violations == ()
    assert report.questions > 40


@pytest.mark.parametrize("wall", [wall() for wall in WALLS], ids=lambda wall: type(wall).__name__)
def test_a_wall_is_free_before_its_surface_and_pushes_back_behind_it(
    wall: StatelessEnvironment,
) -> None:
    assert wall.force("", (0.0099,), (0.0,), 1.0) == (0.0,)
    assert wall.force("", (0.010,), (0.0,), 1.0) == (0.0,)
    assert wall.force("", (0.011,), (0.0,), 1.0)[0] > 0.0
    assert wall.force("", (0.011, 0.02, 0.03), (0.0, 0.0, 0.0), 1.0)[1:] == (0.0, 0.0)


@pytest.mark.parametrize(
    ("wall", "position", "elapsed", "force"),
    [
        (Wall(stiffness=10_000.0, position=0.01), 0.0102, 0.0, 2.0),
        (TimeVaryingWall(), 0.011, 0.0, 0.3),  # paper, equation 32
        (TimeVaryingWall(), 0.011, 5.0, 0.6),
        (PowerLawWall(stiffness=10_000.0, exponent=1.5, reference=0.001), 0.011, 0.0, 10.0),
        (PowerLawWall(exponent=1.5, reference=0.001), 0.01025, 0.0, 10.0 * 0.25**1.5),
    ],
)
def test_the_force_of_a_wall(
    wall: StatelessEnvironment, position: float, elapsed: float, force: float
) -> None:
    assert wall.force("", (position,), (0.0,), elapsed)[0] == pytest.approx(force)


@pytest.mark.parametrize("depth", [1e9, 1e300])
def test_a_power_law_wall_stays_finite_at_an_absurd_depth(depth: float) -> None:
    wall = PowerLawWall(exponent=10.0, reference=1e-6)
    (force,) = wall.force("", (depth,), (0.0,), 0.0)
    assert math.isfinite(force)
    assert force == pytest.approx(wall.force("", (10.010,), (0.0,), 0.0)[0])


@pytest.mark.parametrize(
    ("kind", "values", "field"),
    [
        (ActiveWall, {"stiffness": -1.0}, "stiffness"),
        (ActiveWall, {"damping": math.nan}, "damping"),
        (Damper, {"damping": math.inf}, "damping"),
        (PowerLawWall, {"exponent": 11.0}, "exponent"),
    ],
)
def test_a_value_outside_its_range_is_refused(
    kind: type[EnvironmentModel], values: dict[str, float], field: str
) -> None:
    with pytest.raises(ConfigError) as error:
        kind(**values)
    assert error.value.field == field


def test_the_damper_resists_motion_and_an_active_wall_pushes_along_with_it() -> None:
    assert Damper(damping=5.0).force("", (0.0,), (0.2,), 0.0) == (1.0,)
    assert ActiveWall().force("", (0.011,), (-0.1,), 0.0) > ActiveWall().force(
        "", (0.011,), (0.1,), 0.0
    )
