"""A largest speed of the hand: what it allows, and what a faster hand can have got."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from forcebound.errors import ConfigError
from forcebound.graph.loader import load
from forcebound.haptics.laws import Dissipation, ForceBounder
from forcebound.haptics.laws.hold_cost import hold_cost, lagging_cost, rigid_cost, rigid_force
from forcebound.results.verdict import verdict
from forcebound.run.virtual import run_virtual

T = 1e-3
NS = 1_000_000
EXACT = Dissipation(
    damping=0.27, friction=0.0, resolution=0.0, saturation=50.0, period=T, hold_limit=T,
    energy_cap=10.0,
)  # fmt: skip


@given(
    force=st.floats(0, 8),
    friction=st.floats(0, 1),
    play=st.floats(0, 2e-3),
    damping=st.floats(0.05, 3),
    duration=st.floats(1e-4, 5e-3),
    reach=st.floats(1e-5, 0.1),
)
def test_the_cost_is_that_of_the_worst_displacement_within_reach(
    force: float, friction: float, play: float, damping: float, duration: float, reach: float
) -> None:
    ways = np.linspace(0.0, reach, 2001)
    gains = force * ways - friction * np.maximum(ways - play, 0.0) - damping * ways**2 / duration
    worst, steps = float(gains.max()), reach / 2000 * (force + friction)
    cost = hold_cost(force, friction, play, damping, duration, reach)
    assert worst - 1e-15 <= cost <= worst + steps
    assert rigid_cost(force, friction, damping, duration, reach) == pytest.approx(
        hold_cost(force, friction, 0.0, damping, duration, reach), abs=1e-15
    )
    assert cost <= hold_cost(force, friction, play, damping, duration)


@given(energy=st.floats(0, 0.1), reach=st.floats(1e-4, 0.05), duration=st.floats(1e-4, 0.02))
def test_the_largest_force_costs_what_there_is(
    energy: float, reach: float, duration: float
) -> None:
    force = rigid_force(energy, 0.12, 0.27, duration, reach)
    assert rigid_cost(force, 0.12, 0.27, duration, reach) == pytest.approx(energy, abs=1e-12)


@given(
    before=st.floats(-8, 8),
    after=st.floats(-8, 8),
    lag=st.floats(1e-5, 3e-3),
    turns=st.lists(st.floats(-1, 1), min_size=8, max_size=8),
    holds=st.floats(1, 8),
)
def test_a_lagging_hold_costs_no_more_for_a_hand_that_keeps_its_speed(
    before: float, after: float, lag: float, turns: list[float], holds: float
) -> None:
    """The amplifier approaches the new force, then decays; the hand is as fast as it may be."""
    speed, damping, friction, duration = 1.0, 0.27, 0.12, holds * T
    reach = speed * (duration + T)
    times = (np.arange(8000) + 0.5) * duration / 8000
    force = after + (before - after) * np.exp(-times / lag)
    at_end = after + (before - after) * math.exp(-duration / lag)
    # Turned against the force: the best direction, at any share of the speed.
    velocity = np.sign(force) * speed * np.abs(np.repeat(turns, 1000))
    best = np.sign(force) * np.minimum(np.maximum(np.abs(force) - friction, 0) / 0.54, speed)
    for v in (velocity, best):
        gained = float(np.sum(force * v - friction * np.abs(v) - damping * v * v))
        gained *= duration / 8000
        gained += max(abs(at_end) - friction, 0.0) ** 2 * lag / (8.0 * damping)
        old, new = (max(abs(one) - friction, 0.0) for one in (before, after))
        cost = lagging_cost(old, new, damping, duration, lag, reach)
        assert gained <= cost * 1.001 + 1e-9


class Hand:
    """A hand that moves an exact device of one axis, with damping alone, and its energy."""

    def __init__(self, stated: Dissipation) -> None:
        self.bounder = ForceBounder("certified", stated)
        self.bounder.start(0, (0.0,))
        self.time, self.position, self.energy, self.lowest = 0, 0.0, 0.0, 0.0
        self.force = 0.0

    def move(self, way: float, asked: float, periods: int = 1) -> None:
        """Move in so many periods, then ask for a force."""
        duration = periods * T
        self.energy += EXACT.least_damping * way**2 / duration + self.force * way
        self.lowest = min(self.lowest, self.energy)
        self.position += way
        self.time += periods * NS
        (self.force,) = self.bounder.bound(self.time, (self.position,), (asked,))
        self.bounder.settle((self.force,))


def free(stated: Dissipation, ways: int = 40) -> Hand:
    hand = Hand(stated)
    for _ in range(ways):
        hand.move(5e-4, 0.0)
    return hand


def test_a_stated_speed_allows_more_force_and_no_energy() -> None:
    forces = []
    for speed in (math.inf, 2.0, 0.5):
        hand = free(replace(EXACT, hand_speed=speed))
        for _ in range(10):
            hand.move(0.0, 50.0)
        forces.append(hand.force)
        for _ in range(20):
            hand.move(-min(speed, 2.0) * T, 50.0)
        assert hand.lowest >= -1e-12
        assert (hand.bounder.fast_holds, hand.bounder.speed_leak) == (0, 0.0)
    assert forces[0] < forces[1] < 0.8 * forces[2]


def test_what_a_faster_hand_gets_is_what_the_bounder_says_and_is_owed() -> None:
    hand = free(replace(EXACT, hand_speed=0.5))
    hand.move(0.0, 50.0)
    worst = hand.force * T / (2.0 * EXACT.least_damping)
    hand.move(-worst, 50.0)
    leaked = -hand.energy
    assert hand.bounder.fast_holds == 1
    assert leaked > 0.01
    assert hand.bounder.speed_leak == pytest.approx(leaked)
    assert not hand.bounder.allowance_repaid
    for _ in range(20):  # leaks do not add up: there is no force until it is paid back
        hand.move(-worst, 50.0)
        if hand.bounder.estimated_energy < 0.0:
            assert hand.force == 0.0
        else:
            break
    assert hand.lowest == pytest.approx(-leaked)
    while not hand.bounder.allowance_repaid:
        hand.move(1e-3, 0.0)
    assert hand.energy >= 0.0


def test_a_faster_hand_that_meets_no_force_is_not_counted() -> None:
    hand = free(replace(EXACT, hand_speed=0.1))
    assert hand.bounder.fast_holds == 0


def test_a_late_hold_costs_much_less_with_a_speed() -> None:
    late: dict[str, Any] = {"watchdog": "none", "watchdog_limit": 20e-3, "allowance": 1e-3}
    forces = []
    for speed in (math.inf, 1.0):
        stated = replace(EXACT, hand_speed=speed, **late)
        hand = free(stated, 400)
        hand.move(0.0, 50.0)
        forces.append(hand.force)
        hand.move(-0.019 * min(speed, 1.0), 0.0, periods=19)
        assert hand.lowest >= -1e-3
        assert -hand.lowest <= hand.bounder.largest_allowance <= 1e-3 * (1 + 1e-9)
        assert hand.bounder.fast_holds == 0
    assert forces[1] > 1.2 * forces[0]


@pytest.mark.parametrize(
    "wrong",
    [
        {"hand_speed": 0.0},
        {"hand_speed": 1.0, "lag": 1e-4, "presliding": 1e-5},
        {"hand_speed": 1.0, "lag": 1e-4, "watchdog": "reporting"},
        {"hand_speed": 1.0, "lag": 1e-4, "watchdog_tolerance": 0.1},
    ],
)
def test_what_is_not_proved_is_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(ConfigError, match="hand_speed"):
        replace(EXACT, **wrong)


def test_a_run_with_a_faster_hand_is_passive_but_for_what_it_can_have_got(tmp_path: Path) -> None:
    file = tmp_path / "fast.yaml"
    file.write_text(
        "forcebound: 1\ninclude: stiff_wall\n"
        "arguments: {stiffness: 30 N/mm, approach_speed: 500 mm/s}\n"
        "device: {hand_speed: 0.1 m/s, watchdog: silent, watchdog_tolerance: 0}\n"
    )
    result = run_virtual(load(str(file)), 1.0)
    summary = result.summary
    assert summary["fast_holds"] > 0
    assert summary["speed_leak_j"] > 0.0
    assert summary["true_energy_min_j"] >= -summary["speed_leak_j"]
    leaked = summary | {"true_energy_min_j": -0.9 * summary["speed_leak_j"]}
    line = verdict(leaked, result.document)[0]
    assert line.startswith("Passive but for at most")
    assert "device.hand_speed" in line
    beyond = summary | {"true_energy_min_j": -1.1 * summary["speed_leak_j"]}
    assert verdict(beyond, result.document)[0].startswith("Not passive")
