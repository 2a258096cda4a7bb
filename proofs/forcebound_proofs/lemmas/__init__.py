"""Lemmas of docs/theory.md, and three readings of the ledger, by solvers of real arithmetic.

Each obligation must be proved within a fixed limit of the solver's resources; each of its
hypotheses, left out, must give a counterexample, and so must each term that a model of the ledger
omits. What stays on paper is in docs/theory.md, 3.9. It needs the extra "proof"; with cvc5
installed, --second asks that solver, too.
"""

import sys
from importlib.util import find_spec

import click


@click.command(help=__doc__)
@click.option("--second", is_flag=True, help="Ask cvc5, too, for at most 10 s each.")
def main(second: bool) -> None:
    """Print a table; status 1 if one is not proved, or a control finds nothing."""
    try:
        from forcebound_proofs.lemmas.check import rows
    except ImportError as error:
        if error.name != "z3":
            raise
        raise click.ClickException("z3 is missing: pip install './proofs[proof]'") from None
    if second and not find_spec("cvc5"):
        raise click.ClickException("cvc5 is missing: pip install cvc5")
    line = "{:<28} {:<4} {:<20} {:>8} {:<8} {}"
    print(line.format("lemma", "in", "Z3", "units", "control", "claim"))
    failed = 0
    for row in rows(second):
        failed += not row.holds
        cells = (row.lemma, row.section, row.answer, row.units, row.control, row.claim)
        print(line.format(*cells), flush=True)
    sys.exit(1 if failed else 0)
