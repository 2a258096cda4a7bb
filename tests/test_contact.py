"""Measures of a contact against step responses, springs and dampers that have a solution."""

import math

import numpy as np
import pytest

from forcebound.results.contact import (
    BOUNCE_EXCURSION,
    count_bounces,
    extended_rate_hardness,
    final_speed,
    limit_cycle_amplitude,
    rate_hardness,
    settling,
)

TIME = np.arange(5000, dtype=np.float64) * 1e-3  # s
SPEED = 0.1  # m/s
DEPTH = SPEED * (TIME - 1.0)  # m, even motion, in contact from 1 s on


def test_the_extended_rate_hardness_of_a_spring_is_its_stiffness() -> None:
    assert extended_rate_hardness(TIME, 540.0 * np.maximum(DEPTH, 0.0), DEPTH) == pytest.approx(540)


def test_the_extended_rate_hardness_shows_a_wall_that_answers_late() -> None:
    late = 540.0 * np.maximum(DEPTH - 0.02 * SPEED, 0.0)
    assert rate_hardness(TIME, late, DEPTH) == pytest.approx(0.0)
    assert extended_rate_hardness(TIME, late, DEPTH) == pytest.approx(540.0)


def test_the_extended_rate_hardness_shows_the_jump_of_a_damper() -> None:
    # The slope of the least-squares line through n samples of which the last n - 1 have jumped.
    jump = np.where(DEPTH > 0.0, 2.0 * SPEED, 0.0)
    assert rate_hardness(TIME, jump, DEPTH) == pytest.approx(0.0, abs=1e-9)
    hardness = extended_rate_hardness(TIME, jump, DEPTH)
    centred = np.arange(11) - 5.0  # 10 ms
    assert hardness == pytest.approx(2.0 * -centred[0] / (centred @ centred) / 1e-3)


def test_an_exponential_approach_settles_after_three_time_constants() -> None:
    found = settling(TIME, 0.01 * (1.0 - np.exp(-TIME / 0.1)))
    assert found is not None
    assert found.time == pytest.approx(0.1 * math.log(20.0), abs=2e-3)
    assert found.overshoot == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("ratio", [0.2, 0.5])
def test_the_overshoot_is_that_of_a_damped_oscillator(ratio: float) -> None:
    damped = 40.0 * math.sqrt(1.0 - ratio**2)
    decay = np.exp(-ratio * 40.0 * TIME)
    swing = np.cos(damped * TIME) + ratio * 40.0 / damped * np.sin(damped * TIME)
    found = settling(TIME, 0.01 * (1.0 - decay * swing))
    assert found is not None
    expected = math.exp(-math.pi * ratio / math.sqrt(1.0 - ratio**2))
    assert found.overshoot == pytest.approx(expected, rel=2e-3)


def test_a_hand_that_swings_to_the_end_has_not_settled() -> None:
    assert settling(TIME, 0.01 + 0.001 * np.sin(30.0 * TIME)) is None
    assert settling(TIME, -0.01 + 0.0 * TIME) is None


def test_the_limit_cycle_has_the_amplitude_of_the_sine() -> None:
    swinging = 0.01 + 0.002 * np.sin(2.0 * math.pi * 25.0 * TIME)
    assert limit_cycle_amplitude(TIME, swinging) == pytest.approx(0.002)
    assert limit_cycle_amplitude(TIME, np.full(5000, 0.01)) == 0.0
    assert limit_cycle_amplitude(TIME[:1], TIME[:1]) is None


def test_repeated_readings_do_not_change_the_bounces() -> None:
    path = np.array([0.0, 1.0, 1.0, 0.5, 0.5, 0.5, 1.2, 1.2]) * 10 * BOUNCE_EXCURSION
    assert count_bounces(path) == 2
    assert count_bounces(path[:0]) == 0


@pytest.mark.parametrize("periods", [1, 7])
def test_an_oscillation_turns_twice_a_period(periods: int) -> None:
    phase = np.linspace(0.0, 2.0 * math.pi * periods, 1000)
    assert count_bounces(0.001 * np.sin(phase)) == 2 * periods


def test_a_turn_counts_from_its_excursion_on() -> None:
    for factor, bounces in [(0.99, 0), (1.01, 1)]:
        there_and_back = np.array([0.0, 0.001, 0.001 - factor * BOUNCE_EXCURSION])
        assert count_bounces(there_and_back) == bounces


def test_an_encoder_that_chatters_does_not_turn() -> None:
    chatter = 3e-5 * (np.arange(1000) % 2)
    assert count_bounces(np.linspace(0.0, 0.004, 1000) + chatter) == 0


def test_the_final_speed_is_the_rms_speed_of_the_last_half_second() -> None:
    time = np.linspace(0.0, 2.0, 2001)
    position = 0.001 * np.sin(2.0 * math.pi * 10.0 * time)[:, np.newaxis]
    expected = 0.001 * 2.0 * math.pi * 10.0 / math.sqrt(2.0)
    assert final_speed(time, position) == pytest.approx(expected, rel=1e-3)
