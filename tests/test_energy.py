"""Measures of energy against a pendulum of energy, a ballistic contact and a held spring."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from launch_texts import written
from slow_bus import run_slow

from forcebound.graph.loader import load
from forcebound.results.energy import (
    BESIDE,
    Holds,
    MotorAccount,
    Observed,
    largest_fall,
    observe,
    since_contact,
)
from forcebound.results.samples import Samples
from forcebound.results.surface import Floats
from forcebound.run.virtual import run_virtual

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


def held(
    time: Floats, force: Floats, reading: Floats, late: float = 0.0, **known: Any
) -> Observed | None:
    """What is observed of forces that act from their readings on, until the next one."""
    end, doubt = np.full(time.size, np.inf), np.full(time.size, late)
    holds = Holds(time, time, end, 0.0, force, reading, 0.0, doubt)
    return observe(holds._replace(**known))


@pytest.mark.parametrize("samples", [8, 50])
def test_the_observer_sees_what_a_held_spring_gives(samples: int) -> None:
    stiffness, amplitude, cycles = 1000.0, 0.004, 10
    angle = 2.0 * math.pi / samples
    steps = np.arange(cycles * samples + 1, dtype=np.float64)
    position = amplitude * np.sin(angle * steps)[:, np.newaxis]
    seen = held(steps * 1e-3, stiffness * position, position)
    assert seen is not None
    # sum of F(n-1) dq = -K/2 sum of dq^2: the work of half a period of delay
    given = -0.5 * stiffness * amplitude**2 * (1.0 - math.cos(angle)) * samples * cycles
    assert seen.energy_min == pytest.approx(given)
    assert 0.0 < seen.deficit_share < 1.0
    idle = held(steps * 1e-3, np.zeros_like(position), position)
    assert idle is not None
    assert idle.energy_min == idle.error == idle.power_min == idle.deficit_share == 0.0


def test_the_power_is_that_of_a_motor_that_drives_evenly() -> None:
    position = 0.1 * TIME[:, np.newaxis]
    seen = held(TIME, np.full((2001, 1), -3.0), position)
    assert seen is not None
    assert seen.power_min == pytest.approx(-0.3)
    assert seen.energy_min == pytest.approx(-0.6)


def test_an_observer_needs_two_samples() -> None:
    assert held(TIME[:1], np.zeros((1, 1)), np.zeros((1, 1))) is None
    short = held(TIME[:3], np.zeros((3, 1)), np.zeros((3, 1)))
    assert short is not None
    assert short.power_min is None


def test_a_force_is_paired_with_the_path_while_it_acted() -> None:
    position = 0.1 * TIME[:, np.newaxis]
    force = np.where(TIME < 1.0, 3.0, -3.0)[:, np.newaxis]
    seen = held(TIME, force, position, write=TIME + 0.4e-3)  # each acts 0.4 ms later
    assert seen is not None
    assert seen.energy_min == pytest.approx(0.0)
    later = held(TIME, -force, position, write=TIME + 0.4e-3)
    assert later is not None
    assert later.energy_min == pytest.approx(-0.3, abs=1e-6)  # 3 N over 0.1 m, as undelayed
    end = TIME + 0.25e-3
    cut = held(TIME, np.full((2001, 1), -3.0), position, end=end)
    assert cut is not None
    assert cut.energy_min == pytest.approx(-0.6 / 4)  # it was dropped a quarter into each period


def test_the_error_is_that_of_readings_where_the_force_changes() -> None:
    still, force = np.zeros((2001, 1)), np.ones((2001, 1))
    force[1000:] = 3.0
    seen = held(TIME, force, still, resolution=1e-4)
    assert seen is not None
    assert seen.error == pytest.approx(0.5e-4 * (1.0 + 2.0 + 3.0))  # begins, changes, is on
    moving = held(TIME, force, 0.1 * TIME[:, np.newaxis], late=1e-3)
    assert moving is not None
    assert moving.error == pytest.approx(0.1 * 1e-3 * 1.0)  # later the motor has taken more


def part(holds: Holds, start: int, end: int) -> Holds:
    names = ("read", "write", "end", "force", "reading", "late")
    return holds._replace(**{name: getattr(holds, name)[start:end] for name in names})


@pytest.mark.parametrize("law", ["none", "certified"])
def test_the_account_that_goes_on_is_that_of_the_whole_run(law: str) -> None:
    result = run_virtual(load("stiff_wall", [f"law:={law}", "delay:=5 ms"]), 2.0)
    holds = Samples(result.columns, result.document).holds
    account, start = MotorAccount(), 0
    for end in (300, 301, 950, holds.read.size):
        account.take(part(holds, start, end))
        start = max(end - 2 * BESIDE - 1, 0)
    whole = observe(part(holds, 0, holds.read.size - BESIDE))
    assert whole is not None
    assert account.energy_min == pytest.approx(whole.energy_min, rel=1e-6, abs=1e-9)
    assert account.error == pytest.approx(whole.error, rel=0.01, abs=1e-9)


@pytest.mark.parametrize(
    "numbers",
    [
        {"has_stamps": True, "jitter": 0.0},
        {"has_stamps": True, "jitter": 0.0, "latch": -1.0},
        {"latch": 0.0},
        {"latch": 0.5},
        {"latch": 1.0},
        {"latch": -1.0},
    ],
)
@pytest.mark.parametrize("stiffness", [600.0, 1000.0])
def test_the_energy_of_a_motor_behind_a_slow_bus_is_true_within_its_error(
    numbers: dict[str, Any], stiffness: float
) -> None:
    rail, result = run_slow("none", stiffness, 1.5, **numbers)
    summary = result.summary
    given, error = summary["observed_energy_min_j"], summary["observed_energy_error_j"]
    assert rail.least < -5e-4
    assert abs(given - rail.least) <= error
    if numbers.get("has_stamps"):
        assert error < 0.12 * abs(given)


@pytest.mark.parametrize(
    ("file", "device"),
    [
        ("stiff_wall", "{truth: {damping: 0, friction: 0}}"),
        (
            "stiff_wall",
            "{truth: {damping: 0, friction: 0}, lag: 1 ms, watchdog: reporting, hand_speed: null}",
        ),
        ("stiff_wall", "{truth: {damping: 0, friction: 0}, resolution: 0.3 mm}"),
        (
            "stiff_wall",
            "{truth: {damping: 0, friction: 0}, write_delay: 0.7 ms, watchdog: reporting}",
        ),
        ("five_bar_wall", "{damping: 1e-6, friction: 0, presliding: 0}"),
    ],
)
def test_without_losses_the_motor_has_what_the_hand_has(
    tmp_path: Path, file: str, device: str
) -> None:
    text = f"forcebound: 1\ninclude: {file}.yaml\ndevice: {device}"
    result = run_virtual(load(written(tmp_path, text), ["law:=none", "delay:=2 ms"]), 1.5)
    summary, columns = result.summary, result.columns
    mass = result.document["device"].get("mass", 0.1)  # kg; of the arm's tip about so much
    moves = np.diff(columns.true_position, axis=0) / np.diff(columns.time)[:, np.newaxis]
    kinetic = 0.5 * mass * float(np.max(np.sum(moves**2, axis=1)))
    assert summary["true_energy_min_j"] < -0.02
    difference = summary["observed_energy_min_j"] - summary["true_energy_min_j"]
    assert abs(difference) <= summary["observed_energy_error_j"] + kinetic
