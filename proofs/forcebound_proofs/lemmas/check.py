"""Ask the solver for all obligations and models, with their controls."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import z3

from forcebound_proofs.lemmas.obligations import OBLIGATIONS, Obligation
from forcebound_proofs.lemmas.readings import LEAKS, MODELS, Stated, leak
from forcebound_proofs.lemmas.solver import ask, ask_other
from forcebound_proofs.lemmas.speed import SPEED

WORDS = {"unsat": "proved", "sat": "WRONG", "unknown": "UNKNOWN"}


@dataclass(frozen=True)
class Row:
    """What was found for one lemma."""

    lemma: str
    section: str
    claim: str
    answer: str
    units: int
    control: str
    holds: bool


def questions(one: Obligation) -> tuple[list[Any], dict[str, list[Any]]]:
    """Formulas that the claim contradicts; the same without the claim or one hypothesis."""
    stays = [*one.domain, z3.Not(one.claim)]
    controls = {"claim": [*one.domain, *one.hypotheses.values()]}  # or it proves anything
    for name in one.hypotheses:
        others = {**one.hypotheses, name: one.instead.get(name, z3.BoolVal(True))}
        controls[name] = [*stays, *others.values()]
    return [*stays, *one.hypotheses.values()], controls


def models(stated: Stated, omitted: Sequence[str]) -> dict[str, list[Any]]:
    """The leak of a ledger without each of these terms."""
    return {term: leak(replace(stated, omitted=term)) for term in omitted}


def judge(
    lemma: str, section: str, claim: str, whole: list[Any], controls: dict[str, list[Any]],
    second: bool = False,
) -> Row:  # fmt: skip
    """Ask for a claim and its controls; all of them must be found wrong."""
    answer, units = ask(whole) if whole else ("not asked", 0)
    missed = [name for name, formulas in controls.items() if ask(formulas)[0] != "sat"]
    other = ask_other(whole) if second and whole else ""
    control = f"NOT {', '.join(missed)}" if missed else f"{len(controls)} of {len(controls)}"
    word = WORDS.get(answer, answer)
    if other:
        word += f", cvc5 {WORDS.get(other, 'unknown').lower()}"
    holds = answer in ("unsat", "not asked") and not missed and other != "sat"
    return Row(lemma, section, claim, word, units, control, holds)


def rows(second: bool = False) -> Iterator[Row]:
    """Judge everything, one after the other."""
    for lemma, section, function in (*OBLIGATIONS, *SPEED):
        claim = (function.__doc__ or "").strip()
        yield judge(lemma, section, claim, *questions(function()), second)
    for name, (stated, omitted) in MODELS.items():
        few = " of few forces" if stated.choice else ""
        claim = (
            f"no leak in {len(stated.intervals) + 1} readings{few}; without: {', '.join(omitted)}"
        )
        yield judge(f"model: {name}", "3", claim, leak(stated), models(stated, omitted), second)
    for name, (stated, omitted) in LEAKS.items():
        claim = f"leaks without: {', '.join(omitted)}"
        yield judge(f"model: {name}", "3", claim, [], models(stated, omitted))
