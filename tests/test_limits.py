"""Theoretical limits on maps."""

import pytest

from forcebound.sweep.limits import abbott_okamura, colgate_schenkel, diolaiti, passive_damping

B, FRICTION, T, STEP = 0.27, 0.12, 1e-3, 3e-5  # the device of the paper


def test_the_papers_device_may_show_twice_its_damping_over_its_period() -> None:
    assert colgate_schenkel(B, T, 0.0) == pytest.approx(540.0)
    assert abbott_okamura(B, FRICTION, T, STEP) == pytest.approx(540.0)


def test_a_coarse_encoder_leaves_the_limit_to_friction() -> None:
    assert abbott_okamura(B, FRICTION, T, 1e-3) == pytest.approx(240.0)
    assert abbott_okamura(B, FRICTION, T, 0.0) == pytest.approx(540.0)


@pytest.mark.parametrize("wall_damping", [0.1, -0.1])
def test_damping_of_the_wall_of_either_sign_costs_stiffness(wall_damping: float) -> None:
    assert colgate_schenkel(B, T, wall_damping) == pytest.approx(340.0)
    assert colgate_schenkel(B, T, 10 * wall_damping) == 0.0


@pytest.mark.parametrize("samples", [0, 1, 2, 5, 20])
def test_the_delay_limit_follows_from_the_theorem_of_colgate_and_schenkel(samples: int) -> None:
    stiffness = diolaiti(B, FRICTION, T, STEP, samples * T)
    assert passive_damping(stiffness, T, samples) == pytest.approx(B, rel=1e-4)


def test_without_delay_the_limits_are_one() -> None:
    assert diolaiti(B, FRICTION, T, STEP, 0.0) == abbott_okamura(B, FRICTION, T, STEP)
