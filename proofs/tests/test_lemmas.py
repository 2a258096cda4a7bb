"""Lemmas and models of the ledger, by a solver; and each term of theirs beside the code."""

import math
from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

pytest.importorskip("z3", reason="the extra `proof` has the solver")

from forcebound.haptics.laws import Dissipation, ForceBounder, hold_cost, sample, waveform
from forcebound_proofs.lemmas import terms
from forcebound_proofs.lemmas.check import models, questions
from forcebound_proofs.lemmas.obligations import OBLIGATIONS, Obligation
from forcebound_proofs.lemmas.readings import LEAKS, MODELS, Ledger, Stated, leak
from forcebound_proofs.lemmas.solver import ask
from forcebound_proofs.lemmas.speed import SPEED

PERIOD_NS = 1_000_000  # two ticks of a model, whose time and damping have the unit of this
TICK_NS = PERIOD_NS // 2


@pytest.mark.parametrize(
    "function", [pytest.param(row[2], id=row[0]) for row in (*OBLIGATIONS, *SPEED)]
)
def test_a_lemma_is_proved_and_needs_each_of_its_hypotheses(
    function: Callable[[], Obligation],
) -> None:
    whole, controls = questions(function())
    assert ask(whole)[0] == "unsat"
    assert {name: ask(one)[0] for name, one in controls.items()} == dict.fromkeys(controls, "sat")


@pytest.mark.parametrize("name", MODELS)
def test_no_hand_gets_energy_from_the_ledger_as_it_is(name: str) -> None:
    assert ask(leak(MODELS[name][0]))[0] == "unsat"


@pytest.mark.parametrize("name", [*MODELS, *LEAKS])
def test_the_solver_finds_the_leak_of_a_ledger_without_a_term(name: str) -> None:
    for term, formulas in models(*{**MODELS, **LEAKS}[name]).items():
        assert ask(formulas)[0] == "sat", term


def test_a_question_that_needs_more_than_the_limit_is_not_proved() -> None:
    assert ask(leak(MODELS["lag"][0]), limit=1000)[0] == "unknown"


def test_terms_of_the_lemmas_are_those_of_the_code() -> None:
    random = np.random.default_rng(1)
    for _ in range(500):
        force, friction, play, b, s, lag = random.exponential(size=6).tolist()
        q, y, move, step = random.normal(size=4).tolist()
        assert terms.rigid_cost(force, friction, b, s) == pytest.approx(
            hold_cost.rigid_cost(force, friction, b, s)
        )
        assert terms.hold_cost(force, friction, play, b, s) == pytest.approx(
            hold_cost.hold_cost(force, friction, play, b, s)
        )
        assert terms.lagging_cost(force, friction, b, s, lag, math.exp(-s / lag)) == pytest.approx(
            hold_cost.lagging_cost(force, friction, b, s, lag)
        )
        assert terms.play(q, y, play) == sample.play(q, y, play)
        assert terms.clear_square(q, y, play) == sample.clear_square(q, y, play)
        one = sample.AxisConstants(b, friction, play, play, 0.0, 0.0, 0.0)
        assert terms.step_penalty(step, s, move, one) == pytest.approx(
            waveform.step_penalty(step, step * step * s, 1.0, move, one)
        )


def test_terms_of_gain_and_of_a_cut_are_those_of_the_code() -> None:
    from forcebound.haptics.laws import all_axes, error_prices

    random = np.random.default_rng(2)
    for _ in range(500):
        capability, share = random.exponential(), random.uniform(0.0, 1.0)
        work, mean, force, other = random.normal(size=4).tolist()
        ledger: Any = SimpleNamespace(held_limit=share, tolerance=0.0, watchdog=1)
        assert terms.unsure_cost(capability, work, share, 1.0) == pytest.approx(
            all_axes.unsure_cost(ledger, capability, work, 1.0)
        )
        assert terms.unsure_change(mean, force) == all_axes.unsure_change(mean, force)
        axes = [
            SimpleNamespace(
                work=one,
                constants=SimpleNamespace(half_resolution=0.0),
                memory=SimpleNamespace(mean_force=0.0),
            )
            for one in (work, other)
        ]
        ledger = SimpleNamespace(gain=share, axes=2, axis=axes)
        assert terms.spread_price(share, [work, other]) == pytest.approx(
            error_prices.spread_price(ledger)
        )


def bounder_of(stated: Stated) -> ForceBounder:
    """The bounder of a device of a model; its energy has the unit of the model's."""
    lag = 0.0 if not stated.lag else 0.5e-3 / math.log(1.0 / float(stated.left))
    dissipation = Dissipation(
        damping=1e-3, friction=float(stated.friction), lag=lag, saturation=1e3,
        resolution=2.0 * float(stated.half_resolution), presliding=float(stated.presliding),
        gain_error=float(stated.gain), period=TICK_NS * 1e-9,
        hold_limit=stated.hold_limit * TICK_NS * 1e-9,
        write_delay=stated.delay * TICK_NS * 1e-9, energy_cap=1e6,
    )  # fmt: skip
    return ForceBounder("certified", dissipation)


CASES = {
    **{name: stated for name, (stated, _) in (MODELS | LEAKS).items()},
    "presliding": Stated(friction=0.4, presliding=0.3, half_resolution=0.2),
    "friction and write delay": Stated(friction=0.4, delay=1, half_resolution=0.1),
    "encoder and lag": replace(MODELS["lag"][0], half_resolution=0.1),
}


@pytest.mark.parametrize("name", CASES)
def test_a_model_is_the_ledger_of_the_code(name: str) -> None:
    """On random moves and forces both have the same energy, and allow the same forces."""
    random = np.random.default_rng(3)
    width = CASES[name].intervals[0]
    for _ in range(20):
        lag = 0.5 / math.log(2.0) if CASES[name].lag else 0.0  # to all digits
        stated = replace(CASES[name], intervals=(width,) * 7, lag=lag)
        bounder = bounder_of(stated)
        bounder.start(0, (0.0,))
        bounder.settle((0.0,), stated.delay * TICK_NS)
        ends = (1 - stated.gain, 1 + stated.gain) if stated.gain else (1,)
        ledgers = [Ledger(stated, 0.0, end) for end in ends]
        forces, position = [0.0], 0.0
        for k in range(1, 8):
            position += random.normal()
            for one in ledgers:
                one.observe(position, width, forces)
            now = k * width * TICK_NS
            (force,) = bounder.bound(now, (position,), (random.normal() * 5.0,))
            for shorter, is_allowed in ((0.999, True), (1.001, False)):
                asked = bounder.limit * shorter
                if asked > 1e-6:
                    allowed = [one.may_be_held(asked, forces) for one in ledgers]
                    allowed += [one.lasts(asked) for one in ledgers]
                    assert all(allowed) == is_allowed
            bounder.settle((force,), now + stated.delay * TICK_NS)
            forces.append(force)
            least = min(one.energy for one in ledgers)
            assert bounder.estimated_energy == pytest.approx(float(least), abs=1e-9)
