"""Measures of energy against a pendulum of energy, a ballistic contact and a held spring."""

import math

import numpy as np
import pytest

from forcebound.results.energy import largest_fall, observe, since_contact

TIME = np.arange(2001, dtype=np.float64) * 1e-3  # s


def test_the_largest_fall_is_found_behind_a_high_minimum() -> None:
    energy = 1.0 + 0.5 * (1.0 - np.cos(2.0 * math.pi * TIME))  # J; never below 1 J
    fall = largest_fall(TIME, energy)
    assert fall is not None
    assert fall.energy == pytest.approx(1.0)
    assert fall.time_to_regain == pytest.approx(0.5)  # half a period


def test_a_fall_at_the_end_is_not_regained() -> None:
    fall = largest_fall(TIME, 1.0 - TIME)
    assert fall is not None
    assert fall.energy == pytest.approx(2.0)
    assert fall.time_to_regain is None


def test_energy_that_only_rises_does_not_fall() -> None:
    fall = largest_fall(TIME, TIME)
    assert fall is not None
    assert fall.energy == 0.0
    assert fall.time_to_regain == 0.0


def test_without_ground_truth_there_is_no_fall() -> None:
    assert largest_fall(TIME, np.full(2001, np.nan)) is None
    assert largest_fall(TIME[:0], TIME[:0]) is None


def test_a_wall_that_returns_the_kinetic_energy_gives_nothing() -> None:
    mass, speed = 0.1, 0.2
    brought = 0.5 * mass * speed**2
    position = np.abs(TIME - 1.0)[:, np.newaxis] * -speed  # in at 1 s, and out again as fast
    energy = np.full(2001, 5.0 + brought)  # J: 5 J of friction on the way, and the kinetic energy
    energy[1200:] -= brought  # the hand has braked the device
    found = since_contact(TIME, energy, position, 1000, mass)
    assert found == pytest.approx(0.0, abs=1e-12)
    energy[1500:] -= 0.001  # and one millijoule more
    assert since_contact(TIME, energy, position, 1000, mass) == pytest.approx(-0.001)


def test_a_run_that_begins_in_contact_brings_nothing() -> None:
    position = np.zeros((2001, 1))
    assert since_contact(TIME, 0.002 - 0.001 * TIME, position, 0, 0.1) == pytest.approx(0.0)


@pytest.mark.parametrize("samples", [8, 50])
def test_the_observer_sees_what_a_held_spring_gives(samples: int) -> None:
    stiffness, amplitude, cycles = 1000.0, 0.004, 10
    angle = 2.0 * math.pi / samples
    steps = np.arange(cycles * samples + 1, dtype=np.float64)
    position = amplitude * np.sin(angle * steps)[:, np.newaxis]
    seen = observe(steps * 1e-3, stiffness * position, position)
    assert seen is not None
    # sum of F(n-1) dq = -K/2 sum of dq^2: the work of half a period of delay
    given = -0.5 * stiffness * amplitude**2 * (1.0 - math.cos(angle)) * samples * cycles
    assert seen.energy_min == pytest.approx(given)
    assert 0.0 < seen.deficit_share < 1.0
    held = observe(steps * 1e-3, np.zeros_like(position), position)
    assert held is not None
    assert held.energy_min == held.power_min == held.deficit_share == 0.0


def test_the_power_is_that_of_a_motor_that_drives_evenly() -> None:
    position = 0.1 * TIME[:, np.newaxis]
    seen = observe(TIME, np.full((2001, 1), -3.0), position)
    assert seen is not None
    assert seen.power_min == pytest.approx(-0.3)
    assert seen.energy_min == pytest.approx(-0.6)


def test_an_observer_needs_two_samples() -> None:
    assert observe(TIME[:1], np.zeros((1, 1)), np.zeros((1, 1))) is None
    short = observe(TIME[:3], np.zeros((3, 1)), np.zeros((3, 1)))
    assert short is not None
    assert short.power_min is None
