"""A cup with a ball in it: what a hand feels, and where it receives energy."""

import cmath
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import forcebound as fb
from forcebound.errors import ConfigError
from forcebound.haptics.environments.cart_pendulum import GRAVITY, CartPendulum

SHAKING: Any = fb.operators["sinusoidal"]


def felt_mass(model: CartPendulum, frequency: float) -> complex:
    """The force for an acceleration of the hand, in kg, of small swings; imaginary: damping."""
    s = 2j * math.pi * frequency
    drag = model.ball_damping * model.length * s / model.ball
    angle = -(s**2) / (model.length * s**2 + GRAVITY + drag)  # rad for a motion of the cup of 1 m
    carried = (model.cup + model.ball + model.ball * model.length * angle) * s**2
    coupling = model.stiffness + model.damping * s
    return carried * coupling / (carried + coupling) / s**2


@pytest.mark.parametrize("law", ["none", "certified"])
@pytest.mark.parametrize("frequency", [0.4, 0.7])  # well below the ball's 0.91 Hz, and near it
def test_a_slow_hand_feels_cup_and_ball_under_any_law(law: str, frequency: float) -> None:
    hand = SHAKING(mass=0.1, stiffness=1e3, damping=10.0, centre=0.0, amplitude=0.04)
    moved: dict[str, Any] = {"operator": hand, "operator.frequency": frequency}
    run = fb.simulate("cart_pendulum", law=law, duration=9.0, **moved)
    whole = round(1e3 * 2 / frequency)  # the last two swings
    time = run.telemetry["time"][-whole:]
    wave = np.exp(-2j * math.pi * frequency * time)
    force, position = (
        complex((run.telemetry[name][-whole:, 0] * wave).sum())
        for name in ("applied_force", "position")
    )
    mass = -force / position / (2.0 * math.pi * frequency) ** 2
    assert mass == pytest.approx(felt_mass(CartPendulum(), frequency), rel=0.02)
    assert abs(cmath.phase(mass)) < 0.2
    assert run.figures.true_energy_min >= -1e-9


@pytest.mark.parametrize(
    "case",
    [
        {"rendering": "acceleration", "hand_damping": "10 N s/m"},  # F = M a, without any delay
        {"rendering": "coupled", "delay": "5 ms"},  # and a hand of 1 N s/m
    ],
    ids=["F = M a", "a late coupling"],
)
def test_without_a_law_the_cup_gives_energy_and_under_certified_none(case: Any) -> None:
    free = fb.simulate("cart_pendulum", law="none", **case).figures
    bounded = fb.simulate("cart_pendulum", law="certified", **case).figures
    assert free.true_energy_min < -0.01
    assert not free.at_rest
    assert bounded.true_energy_min >= -1e-9
    assert bounded.at_rest


def test_the_authors_coupling_is_stable_where_the_same_mass_as_a_force_is_not() -> None:
    runs = {
        rendering: fb.simulate("cart_pendulum", law="none", rendering=rendering).figures
        for rendering in ("coupled", "acceleration")
    }
    assert runs["coupled"].at_rest
    assert not runs["acceleration"].at_rest
    assert runs["acceleration"].peak_force == pytest.approx(8.5)  # all that the motor has


def test_a_mass_well_below_that_of_the_device_can_be_rendered_as_a_force() -> None:
    light: dict[str, Any] = {"cup": "20 g", "environment.ball": "10 g"}
    run = fb.simulate("cart_pendulum", law="none", rendering="acceleration", **light)
    assert run.figures.at_rest


def test_one_hand_holds_the_cup() -> None:
    with pytest.raises(ConfigError, match="left, right"):
        replace(fb.Graph.read("two_hands"), environment=fb.World(CartPendulum()))
