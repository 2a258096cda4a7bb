"""The audit in two and three axes: certified laws through every world and controller."""

import dataclasses
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pytest
from click.testing import CliRunner

from forcebound.cli import main
from forcebound.errors import ConfigError
from forcebound.haptics.controllers import CONTROLLERS
from forcebound.haptics.environments import (
    ENVIRONMENTS,
    StatelessEnvironment,
    open_environment,
)
from forcebound.haptics.laws import ENERGY_TOLERANCE, LAWS
from forcebound.messages.packets import Vector
from forcebound.quantities import NOT_NEGATIVE, Damping, Length, Stiffness
from forcebound_proofs.adversaries import RandomForce, VelocityPusher, uniform
from forcebound_proofs.attack import MARGIN, SEARCH, Series, attack_named
from forcebound_proofs.audit import Options, replay, run
from forcebound_proofs.cases import encode
from forcebound_proofs.world_cases import case_of, numbers_of, worlds
from forcebound_proofs.world_run import device_of
from forcebound_proofs.worlds import UNBOUNDED

HERE = Options(runs=1, searched=0, workers=0)
GONE_WRONG = ("exploding_body", "holed_wall", "jumping_proxy")


@pytest.mark.no_cover  # runs too short to be measured only at their begin, as all others are
@pytest.mark.parametrize(
    ("law", "controllers"),
    [
        ("certified", ["direct"]),
        pytest.param("certified", sorted(CONTROLLERS), marks=pytest.mark.slow),
        pytest.param("certified_fading", sorted(CONTROLLERS), marks=pytest.mark.slow),
    ],
)
def test_no_world_and_no_controller_makes_a_certified_law_leak(
    law: str, controllers: list[str]
) -> None:
    targets = [f"{world}/{one}" for world in worlds() for one in controllers]
    rows = run({"worlds": targets}, [law], HERE)["worlds"]
    assert {row["target"] for row in rows} == set(worlds())
    assert all(sorted(row["controller"]) == controllers for row in rows)
    assert min(row[MARGIN] for row in rows) >= -ENERGY_TOLERANCE
    assert all(row["is_certified"] and row["holds"] for row in rows)


def code_at(end: float, world: str, controller: str) -> str:
    """Return the case with all numbers at this place in their ranges, 0 to 1."""
    numbers = numbers_of(world, controller)
    return f"{world}/{controller}:{encode((0,), [end] * len(numbers))}"


@pytest.mark.parametrize("world", worlds())
@pytest.mark.parametrize("end", [0.0, 1.0])
def test_every_world_and_controller_opens_at_the_ends_of_its_numbers(
    world: str, end: float
) -> None:
    opened = open_environment(case_of(code_at(end, world, "direct")).environment(), 3)
    opened.force("", (0.02, 0.0, 0.0), (0.0, 0.0, 0.0), 0.0)
    opened.close()
    for controller in CONTROLLERS:
        case_of(code_at(end, world, controller)).open_controller().close()


@pytest.mark.parametrize("world", GONE_WRONG)
def test_without_a_law_the_same_attack_takes_energy(world: str) -> None:
    found = [replay(UNBOUNDED, f"worlds:{world}/direct:{seed}")[MARGIN] for seed in range(1, 9)]
    assert min(found) < -1e-3


@dataclasses.dataclass(frozen=True)
class Drum(StatelessEnvironment):
    """A world of a user's own, which no line of the proofs names: a skin that bounces."""

    tension: Annotated[Stiffness, NOT_NEGATIVE] = 500.0
    skin: Length = 0.010
    spring_back: Annotated[Damping, NOT_NEGATIVE] = 5.0
    words: str = ""

    def force(self, user: str, position: Vector, velocity: Vector, elapsed: float) -> Vector:
        depth = position[0] - self.skin
        push = self.tension * depth - self.spring_back * velocity[0] if depth > 0.0 else 0.0
        return (push, *(0.0 for _ in position[1:]))


def test_a_new_world_is_attacked_and_leaks_through_a_broken_law(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(ENVIRONMENTS, "drum", Drum)
    drawn = {name for name in numbers_of("drum", "direct") if name.startswith("environment")}
    assert drawn == {f"environment.{one}" for one in ("tension", "skin", "spring_back")}
    tensions = {case_of(f"drum/direct:{seed}").environment() for seed in range(9)}
    assert len(tensions) == 9
    broken = dataclasses.replace(LAWS["none"], is_certified=True)
    monkeypatch.setitem(LAWS, "broken", broken)
    options = HERE._replace(runs=8)
    rows: list[Any] = run({"worlds": ["drum/"]}, ["certified", "broken"], options)["worlds"]
    found = {row["law"]: row for row in rows}
    assert set(found["certified"]["controller"]) == set(CONTROLLERS)
    assert found["certified"]["holds"]
    assert not found["broken"]["holds"]
    assert replay("broken", found["broken"]["case"])[MARGIN] == found["broken"][MARGIN] < -1e-3


def test_a_search_finds_less_than_it_began_with_and_names_its_cases() -> None:
    found = Series("worlds", "certified", "jumping_proxy/direct", SEARCH, 3, 36).rows()
    assert len(found) == 36
    assert min(one["share_left"] for one in found) < found[0]["share_left"]
    assert replay("certified", found[-1]["case"])[MARGIN] == found[-1][MARGIN]


def test_adversaries_push_along_and_a_random_force_depends_on_time_and_seed_alone() -> None:
    still = (0.0, 0.0)
    assert VelocityPusher(2.0).force("", still, (0.1, -0.1), 0.0) == (-2.0, 2.0)
    assert VelocityPusher(2.0).force("", still, still, 0.0) == still
    forces = [RandomForce(2.0, 0.01, 1).force("", still, still, 0.01 * n) for n in range(500)]
    assert forces[3] == RandomForce(2.0, 0.01, 1).force("", (1.0, 1.0), still, 0.0301)
    assert all(abs(f) <= 2.0 for one in forces for f in one)
    assert max(one[0] for one in forces) > 1.9
    assert min(one[0] for one in forces) < -1.9
    assert uniform(1, 5, 0) != uniform(2, 5, 0) != uniform(2, 5, 1)


def test_a_case_has_two_or_three_axes_with_numbers_of_their_own() -> None:
    cases = [case_of(f"damped_wall/direct:{seed}") for seed in range(20)]
    assert {case.axes for case in cases} == {2, 3}
    assert all(np.size(device_of(case).damping) == case.axes for case in cases)


def test_a_name_that_is_none_is_refused() -> None:
    for name in ("moon/direct:1", "holed_wall/hope:1", "holed_wall/direct:c0", "coupling/direct:1"):
        with pytest.raises(ConfigError):
            attack_named("worlds").make(name)


def test_the_command_writes_a_page(tmp_path: Path) -> None:
    page = tmp_path / "worlds.md"
    options = "--runs 3 --search 0 --world holed_wall --controller direct --law certified"
    chosen = ["audit", "worlds", *options.split(), "--workers", "0", "--output", str(page)]
    done = CliRunner().invoke(main, chosen, catch_exceptions=False)
    assert done.exit_code == 0
    assert "holed_wall" in done.output
    text = page.read_text()
    assert "| `holed_wall` | `certified` | 3 | 0 |" in text
    selected = "--law certified --world holed_wall --controller direct"
    assert f"forcebound audit worlds {selected} --runs 3 --search 0 --seed 1" in text
