"""Three readings of the certified ledger with late writes, by a solver; and its code beside them.

A model of one axis with an exact encoder and no friction, in units of b = 1 and T = 1. Time goes
in half periods; the force that is decided at reading n acts from half period 2n + DELAY on, until
the next one acts. The solver chooses the moves and the forces that the ledger allows: every hand
and environment. It finds the leak of a ledger that forgets a force on its way, and none in the
ledger as it is. The law allows no more than the model: it also asks that a force could be decided
again at the next reading, which holds in the model, too.

The model is transcribed from ``timeline.py`` (``cost_before``), ``waveform.py`` (``penalty``) and
``certified.py`` (``limit``), by their names; a test holds both against each other.
"""

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest

from forcebound.haptics.laws import Dissipation, ForceBounder

z3 = pytest.importorskip("z3")

DELAY = 3  # half periods, from a reading to the effect of its force: 1.5 T
LIMIT = 30_000_000  # of the solver's resource units; it answers "unknown" beyond


def cost(force: Any, duration: float) -> Any:
    """The cost of a hold without friction, F² s / (4b)."""
    return force * force * duration / 4


def acting(forces: Sequence[Any], half: int) -> Any:
    """The force that acts in a half period: the last one that has taken effect, or none."""
    decided = (half - DELAY) // 2
    return forces[decided] if decided >= 0 else 0


def cost_before(forces: Sequence[Any], reading: int) -> Any:
    """What the forces can give from a reading until the force that is decided there acts."""
    halves = range(2 * reading, 2 * reading + DELAY)
    return sum(cost(acting(forces, half), 0.5) for half in halves)


def account(energy: Any, forces: Sequence[Any], moves: Sequence[Any], reading: int) -> Any:
    """The ledger at a reading, from that at the one before."""
    halves = (2 * reading - 2, 2 * reading - 1)
    force = [acting(forces, half) for half in halves]
    move = sum(moves[half] for half in halves)
    mean = (force[0] + force[1]) / 2
    deviation = (force[0] * force[0] + force[1] * force[1]) / 2 - mean * mean
    return energy + move * move + mean * move - deviation / 4


def forgetful(energy: Any, forces: Sequence[Any], moves: Sequence[Any], reading: int) -> Any:
    """The same in a ledger that forgets a force which a later one follows before it acts.

    With writes later than a period none ever acts in it.
    """
    move = moves[2 * reading - 2] + moves[2 * reading - 1]
    return energy + move * move


def held(energy: Any, forces: Sequence[Any], reading: int, force: Any) -> Any:
    """Whether the ledger pays for a force that is decided at a reading (lemma 8)."""
    return cost_before(forces, reading) + cost(force, 1) <= energy


def lasting(energy: Any, force: Any) -> Any:
    """Whether it would, if this were the force before, too: what the law asks besides."""
    return cost(force, DELAY / 2 + 1) <= energy


def leak(
    readings: int,
    account: Callable[..., Any],
    before: Callable[..., Any],
) -> Any:
    """Return what the solver says to: can loss plus work become negative?"""
    solver = z3.Solver()
    solver.set("rlimit", LIMIT)
    forces = [z3.Real(f"force_{k}") for k in range(readings)]
    moves = [z3.Real(f"move_{k}") for k in range(2 * readings + DELAY)]
    energy: Any = 0
    for reading in range(readings):
        if reading > 0:
            energy = account(energy, forces, moves, reading)
        paid = before(forces, reading) + cost(forces[reading], 1) <= energy
        solver.add(z3.Or(paid, forces[reading] == 0))
    total, negative = 0, []
    for half, move in enumerate(moves):
        total = total + 2 * move * move + acting(forces, half) * move
        negative.append(total < 0)
    solver.add(z3.Or(negative))
    return solver.check()


@pytest.mark.parametrize("readings", [2, 3])
def test_no_hand_gets_energy_from_the_ledger_as_it_is(readings: int) -> None:
    assert leak(readings, account, cost_before) == z3.unsat


@pytest.mark.parametrize(
    ("account", "before"),
    [
        pytest.param(forgetful, lambda forces, reading: 0, id="a force on its way is forgotten"),
        pytest.param(account, lambda forces, reading: 0, id="it is not paid before"),
    ],
)
def test_the_solver_finds_the_leak_of_a_ledger_without(
    account: Callable[..., Any], before: Callable[..., Any]
) -> None:
    assert leak(3, account, before) == z3.sat


@pytest.mark.parametrize(("lasts", "answer"), [(True, z3.unsat), (False, z3.sat)])
def test_a_force_that_lasts_is_allowed_again_and_without_the_rule_it_need_not_be(
    lasts: bool, answer: Any
) -> None:
    """No force before exceeds this one, nothing moves, and the energy is what it was (lemma 9)."""
    solver = z3.Solver()
    solver.set("rlimit", LIMIT)
    energy, force = z3.Real("energy"), z3.Real("force")
    forces = [z3.Real(f"before_{k}") for k in range(3)]
    for one in forces:
        solver.add(-force <= one, one <= force)
    solver.add(held(energy, forces, 3, force))
    if lasts:
        solver.add(lasting(energy, force))
    again = [held(energy, [*forces, *[force] * k], 3 + k, force) for k in range(1, 5)]
    solver.add(z3.Not(z3.And(again)))
    assert solver.check() == answer


def test_the_model_is_the_ledger_of_the_code() -> None:
    """With the model's numbers, the bounder's ledger and limits are the model's, to rounding."""
    random = np.random.default_rng(1)
    half_ns = 500_000
    for _ in range(50):
        stated = Dissipation(
            damping=1e-3, friction=0.0, resolution=0.0, saturation=1e3, period=1e-3,
            hold_limit=1e-3, write_delay=DELAY * half_ns * 1e-9, energy_cap=1e6,
        )  # fmt: skip
        bounder = ForceBounder("certified", stated)
        bounder.start(0, (0.0,))
        moves, forces, energy, position = random.normal(size=24).tolist(), [0.0], 0.0, 0.0
        bounder.settle((0.0,), DELAY * half_ns)
        for reading in range(1, 12):
            position += moves[2 * reading - 2] + moves[2 * reading - 1]
            energy = account(energy, forces, moves, reading)
            asked = random.normal() * 3.0
            (force,) = bounder.bound(2 * reading * half_ns, (position,), (asked,))
            left = max(min(energy - cost_before(forces, reading), energy / (DELAY / 2 + 1)), 0.0)
            limit = 2.0 * math.sqrt(left)
            assert bounder.limit == pytest.approx(limit, abs=1e-6)
            assert held(energy, forces, reading, (1.0 - 1e-6) * limit) or limit == 0.0
            assert lasting(energy, (1.0 - 1e-6) * limit) or limit == 0.0
            bounder.settle((force,), (2 * reading + DELAY) * half_ns)
            forces.append(force)
            assert bounder.estimated_energy == pytest.approx(energy, abs=1e-9)
