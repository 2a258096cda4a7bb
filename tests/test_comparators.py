"""Methods of others for a comparison: the energy tank, and the successive stiffness increment."""

from itertools import pairwise
from random import Random

import pytest
from bounding_traces import EXACT, PHANTOM, forces, run, steady
from builders import reply, state

from forcebound.errors import ConfigError
from forcebound.graph.loader import load
from forcebound.haptics.controllers.successive_stiffness import SuccessiveStiffness
from forcebound.haptics.laws import LAWS
from forcebound.run.virtual import run_virtual

# The energy tank


def test_the_tank_is_filled_and_emptied_by_the_work_of_the_force_alone() -> None:
    random = Random(1)
    positions = [random.uniform(-1e-3, 1e-3) for _ in range(200)]
    asked = [random.uniform(-5.0, 5.0) for _ in range(200)]
    rows = run("energy_tank(initial_level=0.03)", PHANTOM, steady(positions, asked))
    work = [f * (b - a) for f, (a, b) in zip(forces(rows), pairwise(positions), strict=False)]
    assert rows[-1].energy == pytest.approx(0.03 + sum(work), abs=1e-12)
    assert max(abs(f) for f in forces(rows)) > 1.0


def test_a_tank_that_a_steady_force_empties_lets_it_fade_and_is_never_overdrawn() -> None:
    """10 mJ, pushed by 2 N at 0.1 m/s, last 50 ms; then nothing is left of the force."""
    law = "energy_tank(initial_level=0.01, refill=0)"
    rows = run(law, EXACT, steady([i * 1e-4 for i in range(100)], [-2.0] * 100))
    levels = [row.energy for row in rows]
    assert levels[:50] == pytest.approx([0.01 - 2e-4 * i for i in range(50)], abs=1e-9)
    assert forces(rows)[:49] == pytest.approx([-2.0] * 49)
    assert forces(rows)[52:] == [0.0] * 48
    assert min(levels) > -1e-15


def test_a_hand_that_speeds_up_overdraws_the_tank_which_then_allows_nothing() -> None:
    law = "energy_tank(initial_level=0.001, refill=0)"
    rows = run(law, EXACT, steady([0.0, 1e-4, 3e-3, 4e-3], [-5.0, -5.0, -5.0, -5.0]))
    assert rows[2].energy == pytest.approx(1e-3 - 5.0 * 3e-3)
    assert forces(rows) == [-5.0, -5.0, 0.0, 0.0]


def test_an_empty_tank_is_refilled_by_damping_up_to_its_target() -> None:
    law = "energy_tank(target_level=0.02, refill=100)"
    rows = run(law, EXACT, steady([i * 1e-4 for i in range(4000)], [0.0] * 4000))
    assert forces(rows)[1] == pytest.approx(100 * 0.02 * 0.1)  # 2 N s/m at 0.1 m/s
    assert rows[-1].energy == pytest.approx(0.02, rel=0.03)
    assert all(b.energy >= a.energy for a, b in pairwise(rows))
    filled = "energy_tank(initial_level=0.03, target_level=0.02, refill=100)"
    full = run(filled, EXACT, steady([0.0, 1e-2, 1.1e-2], [5.0, 5.0, 1.0]))
    assert full[1].energy == pytest.approx(0.08)  # above the target nothing is added
    assert forces(full)[2] == 1.0


def test_a_tank_renders_a_stiff_wall_without_delay_and_lets_go_of_one_that_gives_energy() -> None:
    near, far = (
        run_virtual(load("stiff_wall", ["law:=energy_tank", f"delay:={delay}"])).summary
        for delay in ("0 ms", "5 ms")
    )
    assert near["displayed_stiffness_n_per_m"] == pytest.approx(10e3, rel=0.01)
    assert far["displayed_stiffness_n_per_m"] < 100.0
    assert min(near["true_energy_min_j"], far["true_energy_min_j"]) > 0.0


@pytest.mark.parametrize("numbers", ["refill=-1", "refill=x", "speed=1", "", "refill"])
def test_a_number_that_a_law_does_not_have_is_refused_with_those_that_it_has(numbers: str) -> None:
    with pytest.raises(ConfigError, match=r"refill=50.*got"):
        load("stiff_wall", [f"law:=energy_tank({numbers})"])
    with pytest.raises(ConfigError, match="none"):
        load("stiff_wall", [f"law:=certified({numbers})"])


def test_only_by_name_is_a_comparator_among_all_laws() -> None:
    assert set(LAWS) - set(LAWS.usual) == {"energy_tank"}
    assert not LAWS["energy_tank"].is_certified
    assert LAWS.is_shipped("energy_tank(refill=1)")
    assert not LAWS.is_shipped("unknown(refill=1)")


# The successive stiffness increment: at a wall of 1 N/mm, down to 1 mm and up to a turn


def pressed(gain: float, turns: list[float], most: float = 10.0) -> tuple[list[float], list[float]]:
    """Return penetrations, in m, and forces; 100 states from one turn, in mm, to the next."""
    controller = SuccessiveStiffness(gain, most).open(1)
    depths: list[float] = [0.0]
    found: list[float] = []
    for begin, end in pairwise([0.0, *turns]):
        depths += [1e-3 * (begin + (end - begin) * i / 100) for i in range(1, 101)]
    for tick, depth in enumerate(depths):
        controller.query(state(tick, depth))
        answer = controller.on_reply(reply(tick, 1e3 * max(depth, 0.0)), 0)
        assert answer is not None
        found += answer
    return depths, found


def test_small_releases_make_a_wall_stiffer_with_each_press() -> None:
    _, found = pressed(0.5, [1.0, *[0.99, 1.0] * 5])
    presses = found[100::200]
    assert presses == pytest.approx([sum(0.5**k for k in range(n + 1)) for n in range(6)], rel=0.02)
    assert presses == sorted(presses)


def test_what_a_release_takes_is_not_given_to_the_next_press() -> None:
    """Half a release takes 3/4 of the triangle; a whole one all, and f_max counts up to its cap."""
    assert pressed(0.1, [1.0, 0.5, 1.0])[1][-1] == pytest.approx(1.0 + 0.1 * (1.0 - 0.75), rel=0.01)
    assert pressed(0.1, [1.0, 0.0, 1.0])[1][-1] == pytest.approx(1.0, rel=0.01)
    assert pressed(0.1, [1.0, 0.0, 1.0], most=0.4)[1][-1] == pytest.approx(0.94, rel=0.01)


def test_successive_stiffness_keeps_its_own_account_and_gives_the_hand_energy() -> None:
    random = Random(1)
    turns = [random.choice((1.0, 1.5, 2.0)) * (1 if n % 2 else 0.7) for n in range(101)]
    depths, found = pressed(1.0, turns)
    moves = [b - a for a, b in pairwise(depths)]
    work = [force * move for force, move in zip(found[1:], moves, strict=True)]
    account = 0.0
    for tick, done in enumerate(work):
        account += done if done < 0.0 else 0.0
        if done > 0.0 and (tick + 1 == len(work) or work[tick + 1] < 0.0):
            account += depths[tick + 1] * found[tick + 1] / 2.0
        assert account >= 0.0
    assert account > 0.0
    _, pumped = pressed(0.5, [1.0, *[0.9, 1.0] * 5, 0.0])
    once = pressed(0.5, [1.0, 0.0])[1]
    assert sum(pumped[-100:]) > 1.5 * sum(once[-100:])  # for the same depth


def test_it_acts_on_either_side_and_never_pulls() -> None:
    controller = SuccessiveStiffness(1.0, 0.1).open(1)
    forces_seen: list[float] = []
    for tick, depth in enumerate([-1.0, -2.0, -3.0, -2.0, -1.0, -1.5, -2.0, 0.0]):
        controller.query(state(tick, 1e-3 * depth))
        answer = controller.on_reply(reply(tick, depth), 0)
        assert answer is not None
        forces_seen += answer
    assert forces_seen[:5] == [-1.0, -2.0, -3.0, -2.0, -1.0]
    assert forces_seen[5:] == [0.0, 0.0, 0.0]
