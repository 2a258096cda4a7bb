"""The paper's laws and the laws it compares with, computed by hand."""

import math
from dataclasses import replace
from itertools import pairwise

import pytest
from bounding_traces import EXACT, PHANTOM, B, forces, run, steady
from hypothesis import given
from hypothesis import strategies as st

from forcebound.haptics.laws import LAWS, Sample

# Less conservative and AOL: Eq. 11 to 14 by hand


def test_less_conservative_by_hand() -> None:
    # 1 mm in the first sample: E1 = B d² + f_c d; F_max = sqrt(4 B (E1 + f_c d)).
    energy = B * 1e-6 + 0.12e-3
    largest = math.sqrt(4 * B * (energy + 0.12e-3))
    first, second = run("less_conservative", PHANTOM, steady([1e-3, 2e-3], [9.0, 0.1]))
    assert first[1][0] == pytest.approx(largest)
    assert first[2] == pytest.approx(largest)
    assert first[3] == pytest.approx(energy)
    assert second[1][0] == 0.1
    assert second[3] == pytest.approx(2 * energy + largest * 1e-3)


def test_less_conservative_viscous_counts_no_friction() -> None:
    rows = run("less_conservative_viscous", PHANTOM, steady([1e-3], [9.0]))
    assert forces(rows) == [pytest.approx(2 * B * 1e-3)]  # sqrt(4 B B d²)


@pytest.mark.parametrize("law", ["less_conservative", "aol"])
def test_an_energy_in_deficit_allows_no_force(law: str) -> None:
    # The law never lets it come to this: claim a stronger force than it gave.
    rows = run(law, PHANTOM, steady([1e-3, 0.9e-3], [0.1, 8.0]), applied=lambda _: (8.0,))
    assert rows[1][3] < 0.0
    assert rows[1][2] == 0.0
    assert forces(rows)[1] == 0.0


def test_aol_gives_the_force_for_which_the_worst_next_move_just_empties_the_ledger() -> None:
    (row,) = run("aol", PHANTOM, steady([1e-3], [9.0]))
    energy = row[3]
    assert row[2] == pytest.approx(0.12 + 2 * math.sqrt(B * energy))
    worst = min(B * d * d + 0.12 * d - row[2] * d + energy for d in (i * 1e-6 for i in range(5000)))
    assert worst == pytest.approx(0.0, abs=1e-9)


# More conservative: Eq. 26 to 31, 41, 42


def test_a_saturated_viscous_more_conservative_wall_shows_exactly_twice_b() -> None:
    depths = [i * i * 1e-6 for i in range(1, 60)]
    rows = run("more_conservative_viscous", PHANTOM, steady(depths, [8.5] * len(depths)))
    for depth, force in zip(depths, forces(rows), strict=True):
        assert force == pytest.approx(2 * B * depth, rel=1e-12)


def test_a_saturated_more_conservative_wall_follows_equation_41() -> None:
    depths = [i * 5e-5 for i in range(1, 60)]
    expected: list[float] = []
    force = 0.0
    for _ in depths:
        force = math.sqrt((force + 2 * B * 5e-5) ** 2 + 4 * B * 0.12 * 5e-5)
        expected.append(force)
    rows = run("more_conservative", PHANTOM, steady(depths, [8.5] * len(depths)))
    assert forces(rows) == pytest.approx(expected, rel=1e-12)


def test_the_saturated_stiffness_tends_to_twice_b_from_above_as_equation_42_says() -> None:
    device = replace(PHANTOM, saturation=1e6)
    depths = [i * 1e-4 for i in range(1, 3000)]
    rows = run("more_conservative", device, steady(depths, [1e6] * len(depths)))
    stiffness = [f / x for f, x in zip(forces(rows), depths, strict=True)]
    assert all(later < earlier for earlier, later in pairwise(stiffness))
    assert 2 * B < stiffness[-1] < 2 * B * 1.02
    assert stiffness[0] > 3 * B


@given(st.lists(st.tuples(st.floats(-1e-3, 1e-3), st.floats(-8.5, 8.5)), max_size=40))
def test_more_conservative_satisfies_its_condition_21_at_every_sample(
    trace: list[tuple[float, float]],
) -> None:
    x, held, beta = 0.0, 0.0, B
    device = LAWS["more_conservative"].device(PHANTOM)
    for move, asked in trace:
        x += move
        before = beta
        sample = Sample(
            commanded=abs(asked),
            dt=1e-3,
            distance=abs(move),
            work=held * move,
            held=abs(held),
            viscous_loss=0.0,
            friction_loss=0.0,
            penalty=0.0,
            change_price=0.0,
            held_price=0.0,
        )
        beta, largest, _ = LAWS["more_conservative"].limit(beta, sample, device)
        force = math.copysign(min(abs(asked), largest), asked)
        left = (2 * before * move + held) ** 2 / (4 * before)
        assert 0.0 < beta <= B
        assert force**2 / (4 * beta) <= left + 0.12 * abs(move) + 1e-12
        held = force


def test_more_conservative_passes_a_soft_wall_untouched() -> None:
    depths = [i * 1e-5 for i in range(1, 200)]
    asked = [300.0 * x for x in depths]
    assert forces(run("more_conservative", PHANTOM, steady(depths, asked))) == pytest.approx(asked)


def test_more_conservative_forgets_what_no_force_needed() -> None:
    free = run("more_conservative", PHANTOM, steady([1e-3, 2e-3, 2e-3], [0.0, 0.0, 8.0]))
    assert forces(free) == [0.0, 0.0, 0.0]
    device = LAWS["more_conservative"].device(PHANTOM)
    sample = Sample(0.0, 1e-3, 1e-3, *[0.0] * 7)
    state = LAWS["more_conservative"].limit(17.0, sample, device)
    assert state == (B, 0.0, 0.0)


def test_more_conservative_energy_is_what_its_last_force_needs() -> None:
    (row,) = run("more_conservative_viscous", PHANTOM, steady([1e-3], [8.5]))
    assert row[3] == pytest.approx(B * 1e-6)  # all of the one move


def test_more_conservative_survives_a_force_too_small_to_square() -> None:
    rows = run("more_conservative", PHANTOM, steady([1e-3, 2e-3, 3e-3], [1e-200, 1e-300, 8.0]))
    assert forces(rows)[:2] == [1e-200, 1e-300]
    assert math.isfinite(forces(rows)[2])


# None and TDPA


def test_none_observes_the_energy_and_passes_everything_up_to_the_saturation() -> None:
    rows = run("none", PHANTOM, steady([1e-3, 0.0], [-9.0, 2.0]))
    assert forces(rows) == [-8.5, 2.0]
    assert rows[1][3] == pytest.approx(2 * (B * 1e-6 + 0.12e-3) + 8.5e-3)


def test_tdpa_adds_the_damping_that_pays_its_debt_in_one_sample() -> None:
    # Pushed on by 0.1 N over 1 mm: W = -0.1 mJ at v = 1 m/s; alpha = 1e-4 / (1 * 1e-3) = 0.1.
    rows = run("tdpa", EXACT, steady([0.0, 1e-3], [-0.1, -0.1]))
    assert rows[1][3] == pytest.approx(-1e-4)
    assert forces(rows)[1] == pytest.approx(-0.1 + 0.1 * 1.0)


def test_tdpa_caps_its_damping_and_leaves_a_surplus_alone() -> None:
    rows = run("tdpa", EXACT, steady([0.0, 1e-5], [-8.0, 0.0]))
    assert forces(rows)[1] == pytest.approx(30.0 * 1e-2)
    rows = run("tdpa", EXACT, steady([0.0, 1e-3], [1.0, 1.0]))
    assert forces(rows)[1] == 1.0


def test_tdpa_stays_within_the_saturation() -> None:
    rows = run("tdpa", EXACT, steady([0.0, 1.0], [-8.0, 8.0]))
    assert forces(rows)[1] == 8.5
