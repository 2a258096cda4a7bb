"""Terms of lemmas 10 to 12 beside the code, and a model of the ledger with a speed of the hand.

The model is one axis with an exact encoder and no friction, in units of b = 1, T = 1 and a speed of
1. Time goes in half periods; the force that is decided at reading n acts from half period 2n + 1
on, until the next one acts: a write delay of half a period. The solver chooses moves and forces.
"""

from collections.abc import Callable, Iterable, Sequence
from itertools import product
from typing import Any

import numpy as np
import pytest

pytest.importorskip("z3", reason="the extra `proof` has the solver")

import z3

from forcebound.haptics.laws import Dissipation, ForceBounder, hold_cost
from forcebound_proofs.lemmas import terms
from forcebound_proofs.lemmas.terms import larger, size, smaller

HALF = 0.5
LIMIT = 8_000_000  # of the solver's resource units, for each case


def test_the_terms_of_the_lemmas_are_those_of_the_code() -> None:
    random = np.random.default_rng(1)
    for _ in range(500):
        force, friction, play, b, s, reach = random.exponential(size=6).tolist()
        assert terms.bounded_cost(force, friction, play, b, s, reach) == pytest.approx(
            hold_cost.hold_cost(force, friction, play, b, s, reach)
        )
        assert terms.rigid_bounded_cost(force, friction, b, s, reach) == pytest.approx(
            hold_cost.rigid_cost(force, friction, b, s, reach)
        )


def reach(duration: float) -> float:
    """How far the hand gets, at a speed of 1: within a period as far as in all of it."""
    return max(duration, 1.0)


def nearer(duration: float) -> float:
    """What no reading shows: as far as the part of a period is long."""
    return duration


def cost(force: Any, duration: float, reach: Callable[[float], float]) -> Any:
    """The cost of a hold of a hand with a speed."""
    way = smaller(size(force) * duration / 2, reach(duration))
    return size(force) * way - way * way / duration


def full(force: Any, duration: float) -> Any:
    """The cost of a hold of any hand."""
    return force * force * duration / 4


def acting(forces: Sequence[Any], half: int) -> Any:
    """The force that acts in a half period: the last one that has taken effect, or none."""
    decided = (half - 1) // 2
    return forces[decided] if decided >= 0 else 0


def account(energy: Any, forces: Sequence[Any], moves: Sequence[Any], reading: int) -> Any:
    """The ledger at a reading, from that at the one before."""
    halves = (2 * reading - 2, 2 * reading - 1)
    force = [acting(forces, half) for half in halves]
    move = sum(moves[half] for half in halves)
    mean = (force[0] + force[1]) / 2
    deviation = (force[0] * force[0] + force[1] * force[1]) / 2 - mean * mean
    return energy + move * move + mean * move - deviation / 4


def at_least(solver: Any, name: str, force: Any, moves: Sequence[Any]) -> Any:
    """Any number that is at least what lemma 10 says of these moves under a force, half by half."""
    price = z3.Real(name)
    solver.add(price >= 0)
    for halves in range(1, len(moves) + 1):
        way = sum(moves[:halves])
        solver.add(price >= -force * way - way * way / (halves * HALF))
    return price


def leak(
    readings: int,
    *,
    keeps: bool = True,
    first_is_seen: bool = False,
    owes: bool = True,
    reach: Callable[[float], float] | None = reach,
    shown: Sequence[float] = (),
) -> str:
    """Return what the solver says to: can loss plus work be lower than the ledger reports?

    The ledger begins with any energy, which a hand has put in before without a force.

    Args:
        readings: How many.
        keeps: The hand keeps its speed.
        first_is_seen: But for the first interval, in which it is seen to be faster.
        owes: The ledger reports what it can have got then.
        reach: How far a decision lets the hand get; None: what lemma 10 says of the cost is all
            that is known of it.
        shown: Energy, first force and first moves of an attack, if it is shown to the solver.
    """
    solver = z3.Solver()
    forces = [z3.Real(f"force_{k}") for k in range(readings)]
    moves = [z3.Real(f"move_{k}") for k in range(2 * readings + 1)]
    energies: list[Any] = [z3.Real("energy")]
    solver.add(energies[0] >= 0)
    cases: list[Any] = []
    for reading in range(readings):
        if reading > 0:
            energies.append(account(energies[-1], forces, moves, reading))
        half, force = 2 * reading, forces[reading]
        if reach is not None:
            before, hold = cost(acting(forces, half), HALF, reach), cost(force, 1.0, reach)
        elif first_is_seen and reading == 0:  # it had no force before, and the hand is faster now
            before, hold = 0, at_least(solver, "first hold", force, ())
        else:
            before = at_least(solver, f"before_{reading}", acting(forces, half), moves[half:][:1])
            hold = at_least(solver, f"hold_{reading}", force, moves[half + 1 :][:2])
        cases.append((before + hold <= energies[-1], force == 0))
    if keeps:
        for first in range(2 if first_is_seen else 0, len(moves)):
            for last in range(first + 1, len(moves) + 1):
                most = max((last - first) * HALF, 1.0)
                solver.add(size(sum(moves[first:last])) <= most)
    known = (energies[0], forces[0], *moves)
    solver.add(*[one == value for one, value in zip(known, shown, strict=False)])
    reported = 0
    if first_is_seen and owes:
        spent = sum(full(acting(forces, half), HALF) for half in range(3))
        reported = larger(spent - energies[0], 0)
    total, negative = energies[0], []
    for half, move in enumerate(moves):
        total = total + 2 * move * move + acting(forces, half) * move
        negative.append(total < -reported)
    return worst(answer(*solver.assertions(), *one) for one in product(*cases, negative))


def answer(*formulas: Any) -> str:
    """Return what a solver says that has heard nothing else."""
    solver = z3.SolverFor("QF_NRA")
    solver.set("rlimit", LIMIT)
    solver.add(*formulas)
    return str(solver.check())


def worst(answers: Iterable[str]) -> str:
    """Return ``sat`` if any is, else ``unknown`` if any is."""
    found = "unsat"
    for answer in answers:
        if answer == "sat":
            return answer
        found = answer if answer != "unsat" else found
    return found


ATTACK = (4.4, 5.4, 0.95, 0.0, -0.95)  # a hand that is fast in the half of a period that counts


def test_a_hand_that_keeps_its_speed_gets_nothing() -> None:
    assert leak(1) == "unsat"
    assert leak(2, reach=None) == "unsat"
    assert leak(2, shown=ATTACK) == "unsat"


def test_a_hand_that_is_seen_to_be_faster_gets_what_the_ledger_reports_at_most() -> None:
    assert leak(2, first_is_seen=True, reach=None) == "unsat"
    assert leak(2, first_is_seen=True, reach=None, owes=False) == "sat"


def test_a_hand_that_is_faster_gets_energy() -> None:
    assert leak(1, keeps=False) == "sat"


def test_a_part_of_a_period_must_not_be_bounded_by_its_own_length() -> None:
    assert leak(2, reach=nearer, shown=ATTACK) == "sat"


def test_the_model_is_the_ledger_of_the_code() -> None:
    """With the model's numbers the bounder allows a force if the model does, and counts alike."""
    random = np.random.default_rng(1)
    half_ns, allowed = 500_000, 0
    for _ in range(50):
        stated = Dissipation(
            damping=1e-3, friction=0.0, resolution=0.0, saturation=1e3, period=1e-3,
            hold_limit=1e-3, write_delay=half_ns * 1e-9, energy_cap=1e6, hand_speed=1e3,
        )  # fmt: skip
        bounder, energy, position = ForceBounder("certified", stated), 0.0, 0.0
        bounder.start(0, (0.0,))
        bounder.settle((0.0,), half_ns)
        moves, forces = random.normal(size=24).tolist(), [0.0]
        for reading in range(1, 12):
            position += moves[2 * reading - 2] + moves[2 * reading - 1]
            energy = account(energy, forces, moves, reading)
            asked = random.normal() * 5.0
            (force,) = bounder.bound(2 * reading * half_ns, (position,), (asked,))
            before = cost(acting(forces, 2 * reading), HALF, reach)
            left = energy - before - cost(force, 1.0, reach)
            assert left >= -1e-9 or force == 0.0
            allowed += abs(force) > 2.0 and left < 1e-6
            bounder.settle((force,), (2 * reading + 1) * half_ns)
            forces.append(force)
            assert bounder.estimated_energy == pytest.approx(energy, abs=1e-9)
    assert allowed > 10  # forces that only the speed of the hand allows, and no larger ones
