"""A force that is allowed can be decided again; it is never more than the ledger pays for."""

import math
from typing import Any

import numpy as np
import pytest
from builders import MS

from forcebound.haptics.laws import Dissipation, ForceBounder
from forcebound.haptics.laws.hold_cost import lagging_cost, rigid_cost

CERTIFIED = ["certified", "certified_fading"]
DAMPING, FRICTION, LIMIT = 0.27, 0.12, 1.02e-3  # N s/m, N, s
EXACT = {"damping": DAMPING, "friction": FRICTION, "resolution": 0.0, "saturation": 8.5}
BOARD = {"write_delay": 6e-4, "lag": 1e-3}  # near T both


def described(**fields: Any) -> Dissipation:
    return Dissipation(**{**EXACT, "period": 1e-3, "hold_limit": LIMIT, **fields})


def resting(law: str, axes: int = 1, readings: int = 300, **fields: Any) -> list[float]:
    """Return the forces of the first axis on a hand that moves in for 20 ms and then rests."""
    stated = described(**fields)
    bounder, delay_ns = ForceBounder(law, stated, axes), round(stated.write_delay * 1e9)
    bounder.start(0, (0.0,) * axes)
    bounder.settle((0.0,) * axes, delay_ns)
    forces = []
    for k in range(1, readings):
        position, asked = (4e-3 * min(k, 20),) * axes, (8.5 if k > 20 else 0.0,) * axes
        force = bounder.bound(k * MS, position, asked)
        bounder.settle(force, k * MS + delay_ns)
        forces.append(force[0])
    return forces[20:]


@pytest.mark.parametrize("law", CERTIFIED)
@pytest.mark.parametrize(
    ("axes", "fields"),
    [
        (1, BOARD),
        (2, BOARD | {"friction": (0.12, 0.13), "saturation": 12.0}),
        (3, BOARD | {"saturation": 18.0}),
        (1, {"lag": 2e-3}),
        (1, {"write_delay": 1.5e-3}),
        (1, {"write_delay": 2.5e-3, "lag": 1e-3}),
        (1, {"write_delay": 9e-4, "presliding": 1e-4}),
        (1, BOARD | {"gain_error": 0.1}),
        (2, BOARD | {"gain_error": 0.1}),
        (1, BOARD | {"watchdog": "none", "watchdog_limit": 2e-3, "allowance": 5e-3}),
    ],
)
def test_a_hand_at_rest_feels_a_steady_force(law: str, axes: int, fields: dict[str, Any]) -> None:
    forces = resting(law, axes, **fields)
    settled = forces[20:]
    assert min(settled) > 0.97 * max(settled)
    assert settled[-1] > 0.9 * forces[0] > 1.0


class Motor:
    """One motor with a lag, and the forces on their way to it; it has what the device states."""

    def __init__(self, stated: Dissipation) -> None:
        self.stated, self.actual, self.target = stated, 0.0, 0.0
        self.waiting: list[tuple[float, float]] = []  # s until it acts, N

    def pass_by(self, duration: float) -> None:
        while self.waiting and self.waiting[0][0] <= duration + 1e-12:
            until, force = self.waiting[0]
            self.waiting = [(time - until, one) for time, one in self.waiting[1:]]
            duration -= until
            self._decay(until)
            self.target = force
        self._decay(duration)
        self.waiting = [(time - duration, one) for time, one in self.waiting]

    def _decay(self, duration: float) -> None:
        lag = self.stated.lag
        left = math.exp(-duration / lag) if lag > 0.0 else 0.0
        self.actual = self.target + (self.actual - self.target) * left

    def cost(self, new: float) -> float:
        """What the forces before cost, and a hold of ``new`` after them (``docs/theory.md``)."""
        strongest, total, at = max(abs(self.actual), abs(self.target)), 0.0, 0.0
        for time, force in [*self.waiting, (self.stated.write_delay, new)]:
            total += rigid_cost(strongest, FRICTION, DAMPING, time - at)
            before, at = strongest, time
            strongest = max(strongest, abs(force)) if self.stated.lag > 0.0 else abs(force)
        if self.stated.lag == 0.0:
            return total + rigid_cost(abs(new), FRICTION, DAMPING, LIMIT)
        if self.stated.write_delay == 0.0:
            before = abs(self.actual)
        first, then = max(before - FRICTION, 0.0), max(abs(new) - FRICTION, 0.0)
        return total + lagging_cost(first, then, DAMPING, LIMIT, self.stated.lag)


@pytest.mark.parametrize("delay", [0.0, 0.6e-3, 0.999e-3, 1.5e-3, 2.5e-3])
@pytest.mark.parametrize("lag", [0.0, 1e-4, 1e-3, 3e-3])
def test_no_force_is_more_than_the_ledger_pays_for(delay: float, lag: float) -> None:
    random = np.random.default_rng(7)
    stated = described(write_delay=delay, lag=lag)
    bounder, motor, position = ForceBounder("certified", stated), Motor(stated), 0.0
    bounder.start(0, (0.0,))
    bounder.settle((0.0,), round(delay * 1e9))
    motor.waiting.append((delay, 0.0))
    paid: list[bool] = []
    for k in range(1, 2000):
        motor.pass_by(1e-3)
        position += 2e-3 * random.normal() * (k % 100 < 50)
        (force,) = bounder.bound(k * MS, (position,), (8.5 * random.choice([-1.0, 0.3, 1.0]),))
        allowed, none = motor.cost(force), motor.cost(0.0)
        bounder.settle((force,), k * MS + round(delay * 1e9))
        # Without fading the estimate is what there was; in deficit the old force is paid before.
        assert allowed <= max(bounder.estimated_energy, none) + 1e-12
        motor.waiting.append((delay, force))
        paid.append(abs(force) > FRICTION)
    assert np.mean(paid) > 0.1
