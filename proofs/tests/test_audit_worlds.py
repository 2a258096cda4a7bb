"""The audit in two and three axes: certified laws through every world and controller."""

from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from forcebound.cli import main
from forcebound.errors import ConfigError
from forcebound.haptics.controllers import CONTROLLERS
from forcebound.haptics.environments import open_environment
from forcebound.haptics.laws import ENERGY_TOLERANCE
from forcebound_proofs.adversaries import RandomForce, VelocityPusher, uniform
from forcebound_proofs.world_cases import NUMBERS, WORLDS, case_of
from forcebound_proofs.world_run import attack, device_of
from forcebound_proofs.worlds import MARGIN, UNBOUNDED, WorldCase, run

GONE_WRONG = ("exploding_body", "holed_wall", "jumping_proxy")


@pytest.mark.no_cover  # runs too short to be measured only at their begin, as all others are
@pytest.mark.parametrize(
    ("law", "controllers"),
    [("certified", sorted(CONTROLLERS)), ("certified_fading", ["direct"])],
)
def test_no_world_and_no_controller_makes_a_certified_law_leak(
    law: str, controllers: list[str]
) -> None:
    found = run([law], controllers=controllers, runs=1, searched=0, workers=0)
    rows = found["worlds"]
    assert {row["world"] for row in rows} == set(WORLDS)
    assert all(sorted(row["controllers"]) == controllers for row in rows)
    assert min(row["margin_min_j"] for row in rows) >= -ENERGY_TOLERANCE
    assert all(row["is_certified"] and row["holds"] for row in rows)


@pytest.mark.parametrize("world", sorted(WORLDS))
@pytest.mark.parametrize("end", [0.0, 1.0])
def test_every_world_opens_at_the_ends_of_its_numbers(world: str, end: float) -> None:
    numbers = {name: one.at(end) for name, one in NUMBERS.items()}
    opened = open_environment(WORLDS[world](numbers), 3)
    opened.force("", (0.01, 0.0, 0.0), (0.0, 0.0, 0.0), 0.0)
    opened.close()


@pytest.mark.parametrize("world", GONE_WRONG)
def test_without_a_law_the_same_attack_takes_energy(world: str) -> None:
    found = [attack(UNBOUNDED, case_of(f"{world}/direct:{seed}")) for seed in range(1, 9)]
    assert min(one.lost_min for one in found) < -1e-3


def test_a_search_finds_less_than_it_began_with_and_names_its_cases() -> None:
    found = WorldCase("certified", "jumping_proxy", "direct", True, seed=3, runs=18).rows()
    assert len(found) == 18
    assert min(one["share_left"] for one in found) < found[0]["share_left"]
    again = attack("certified", case_of(found[-1]["case"]))
    assert min(again.energy_min, again.lost_min) == found[-1][MARGIN]


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
    for name in ("moon/direct:1", "holed_wall/hope:1", "holed_wall/direct:c0"):
        with pytest.raises(ConfigError):
            case_of(name)


def test_the_command_writes_a_page_and_repeats_a_run(tmp_path: Path) -> None:
    page = tmp_path / "worlds.md"
    options = "--runs 3 --search 0 --world holed_wall --controller direct --law certified"
    chosen = ["audit", "worlds", *options.split(), "--workers", "0", "--output", str(page)]
    done = CliRunner().invoke(main, chosen, catch_exceptions=False)
    assert done.exit_code == 0
    assert "holed_wall" in done.output
    text = page.read_text()
    assert "| `holed_wall` | `certified` | 3 | 0 |" in text
    assert "forcebound audit worlds --runs 3 --search 0 --seed 1 --law certified" in text
    again = ["audit", "replay", "none", "holed_wall/direct:2"]
    done = CliRunner().invoke(main, again, catch_exceptions=False)
    assert done.exit_code == 0
    assert "loss_and_work_min_j" in done.output
    drawn = CliRunner().invoke(main, [*again, "--output", str(tmp_path / "run.png")])
    assert (drawn.exit_code, "not drawn" in drawn.output) == (2, True)
