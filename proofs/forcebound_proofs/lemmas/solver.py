"""Questions to solvers of real arithmetic, with a fixed limit of resources on every machine."""

from collections.abc import Iterable
from typing import Any

import z3

LIMIT = 10_000_000  # of Z3's resource units; it answers "unknown" beyond
OTHER_SECONDS = 5  # of cvc5, whose answer is a second opinion: it decides nothing


def ask(formulas: Iterable[Any], limit: int = LIMIT) -> tuple[str, int]:
    """Whether Z3 can satisfy all formulas: sat, unsat or unknown; and its resource units.

    A context of its own makes the answer independent of the questions before.
    """
    context = z3.Context()
    solver = z3.Solver(ctx=context)
    solver.set("rlimit", limit)
    solver.add(*[one.translate(context) for one in formulas])
    answer = str(solver.check())
    statistics = solver.statistics()
    return answer, int(statistics.get_key_value("rlimit count"))


def ask_other(formulas: Iterable[Any]) -> str:
    """The same of cvc5, from the text that Z3 writes; "" if it is not installed."""
    try:
        import cvc5
    except ImportError:
        return ""
    text = z3.Solver()
    text.add(*formulas)
    solver = cvc5.Solver()
    solver.setOption("tlimit-per", str(OTHER_SECONDS * 1000))
    parser = cvc5.InputParser(solver)
    parser.setStringInput(
        cvc5.InputLanguage.SMT_LIB_2_6, "(set-logic QF_NRA)\n" + text.to_smt2(), "lemma"
    )
    symbols, answer = parser.getSymbolManager(), ""
    while not (command := parser.nextCommand()).isNull():
        answer = command.invoke(solver, symbols).strip() or answer
    return answer
