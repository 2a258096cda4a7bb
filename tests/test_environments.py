"""The contract of every environment, and the force law of each."""

import math
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from forcebound.config.loader import load
from forcebound.environments import (
    ENVIRONMENTS,
    EnvironmentModel,
    StatelessEnvironment,
    open_environment,
)
from forcebound.environments.active_wall import ActiveWall
from forcebound.environments.contract import check
from forcebound.environments.damped_wall import DampedWall
from forcebound.environments.damper import Damper
from forcebound.environments.power_law_wall import PowerLawWall
from forcebound.environments.recorded import RecordedEnvironment
from forcebound.environments.time_varying_wall import TimeVaryingWall
from forcebound.environments.wall import Wall
from forcebound.launch.virtual import run_virtual

WALLS = (Wall, TimeVaryingWall, PowerLawWall, ActiveWall)


FREE_AT_5_MM: dict[type, dict[float, float]] = {wall: {0.005: 0.0} for wall in (*WALLS, DampedWall)}


WITH_FILE = {"bodies", "recorded"}


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
    at_most = 120 if name == "bodies" else None  # it is slow
    report = check(model, at_rest=at_rest, at_most=at_most)
    assert report.violations == ()
    assert report.questions > 100


@pytest.mark.parametrize("name", sorted(set(ENVIRONMENTS) - WITH_FILE))
@given(data=st.data())
def test_the_force_is_finite_has_one_entry_per_axis_and_depends_on_nothing_else(
    name: str, data: st.DataObject
) -> None:
    axes = data.draw(st.integers(1, 6))
    positions = data.draw(st.tuples(*[st.floats(-0.5, 0.5)] * axes))
    velocities = data.draw(st.tuples(*[st.floats(-3, 3)] * axes))
    elapsed = data.draw(st.floats(0, 1e4))
    one, other = (open_environment(ENVIRONMENTS[name](), axes) for _ in range(2))
    force = one.force("", positions, velocities, elapsed)
    assert len(force) == axes
    assert all(math.isfinite(f) for f in force)
    assert force == other.force("", positions, velocities, elapsed)


@pytest.mark.parametrize("wall", [wall() for wall in WALLS], ids=lambda wall: type(wall).__name__)
def test_a_wall_is_free_before_its_surface_and_pushes_back_behind_it(
    wall: StatelessEnvironment,
) -> None:
    assert wall.force("", (0.0099,), (0.0,), 1.0) == (0.0,)
    assert wall.force("", (0.010,), (0.0,), 1.0) == (0.0,)
    assert wall.force("", (0.011,), (0.0,), 1.0)[0] > 0.0
    assert wall.force("", (0.011, 0.02, 0.03), (0.0, 0.0, 0.0), 1.0)[1:] == (0.0, 0.0)


def test_the_wall_answers_stiffness_times_penetration() -> None:
    assert Wall(stiffness=10_000.0, position=0.01).force("", (0.0102,), (0.0,), 0.0)[0] == (
        pytest.approx(2.0)
    )


def test_the_time_varying_wall_grows_stiffer_as_in_equation_32() -> None:
    wall = TimeVaryingWall()
    assert wall.force("", (0.011,), (0.0,), 0.0)[0] == pytest.approx(0.3)
    assert wall.force("", (0.011,), (0.0,), 5.0)[0] == pytest.approx(0.6)


def test_the_power_law_wall_is_the_linear_one_at_its_reference_and_softer_before() -> None:
    wall = PowerLawWall(stiffness=10_000.0, exponent=1.5, reference=0.001)
    assert wall.force("", (0.011,), (0.0,), 0.0)[0] == pytest.approx(10.0)
    assert wall.force("", (0.01025,), (0.0,), 0.0)[0] == pytest.approx(10.0 * 0.25**1.5)


def test_the_damper_resists_motion_and_an_active_wall_pushes_along_with_it() -> None:
    assert Damper(damping=5.0).force("", (0.0,), (0.2,), 0.0) == (1.0,)
    assert ActiveWall().force("", (0.011,), (-0.1,), 0.0) > ActiveWall().force(
        "", (0.011,), (0.1,), 0.0
    )


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Wall(stiffness=-1.0), "stiffness must be >= 0 N/m"),
        (lambda: PowerLawWall(exponent=0.0), "exponent must be > 0"),
        (lambda: PowerLawWall(reference=0.0), "reference must be > 0 m"),
    ],
)
def test_parameters_without_meaning_are_refused(make: object, message: str) -> None:
    assert callable(make)
    with pytest.raises(ValueError, match=message):
        make()
