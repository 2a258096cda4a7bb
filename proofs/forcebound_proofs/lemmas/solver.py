"""Questions to solvers of real arithmetic, with a fixed limit of resources on every machine."""

import subprocess
import sys
from collections.abc import Iterable
from importlib import import_module
from typing import Any

import z3

LIMIT = 10_000_000  # of Z3's resource units; it answers "unknown" beyond
OTHER_SECONDS = 10  # of cvc5, whose answer is a second opinion: it decides nothing


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
    """The same of cvc5, from the text that Z3 writes; unknown if it takes longer than its limit."""
    solver = z3.Solver()
    solver.add(*formulas)
    try:
        done = subprocess.run(
            [sys.executable, "-m", __name__],
            input="(set-logic QF_NRA)\n" + solver.to_smt2(),
            capture_output=True, text=True, timeout=OTHER_SECONDS, check=True,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        return "unknown"
    return str(done.stdout).strip()


def _answer(text: str) -> None:
    """Print what cvc5 says; it does not keep a limit of its own in every case."""
    cvc5: Any = import_module("cvc5")  # in no extra
    solver = cvc5.Solver()
    parser = cvc5.InputParser(solver)
    parser.setStringInput(cvc5.InputLanguage.SMT_LIB_2_6, text, "lemma")
    symbols = parser.getSymbolManager()
    while not (command := parser.nextCommand()).isNull():
        print(command.invoke(solver, symbols), end="")


if __name__ == "__main__":
    _answer(sys.stdin.read())
