"""The paper's experiments: ``forcebound reproduce``.

The paper is "An enhanced force bounding approach for stable haptic interaction by
including friction", International Journal of Precision Engineering and Manufacturing 18(6), 2017.

To add an experiment, write ``my_experiment.py`` with a function ``run(runs) -> Outcome`` and add
one line to ``EXPERIMENTS``.
"""

from collections.abc import Callable
from typing import TypeAlias

from forcebound_proofs.paper import palpation, saturated, table1, traces
from forcebound_proofs.paper.contacts import PAPER_SHOWS, StiffWall, TimeVaryingWall, no_law
from forcebound_proofs.paper.outcome import Outcome
from forcebound_proofs.paper.setup import Runs

Experiment: TypeAlias = Callable[[Runs], Outcome]

EXPERIMENTS: dict[str, Experiment] = {  # in the paper's order
    "table1": table1.run,
    "fig4": TimeVaryingWall("less_conservative").run,
    "fig5": TimeVaryingWall("more_conservative").run,
    "fig6": TimeVaryingWall("aol").run,
    "fig7": no_law,
    **{
        f"fig{8 + 2 * number + at}": StiffWall(law, speed).run
        for number, law in enumerate(PAPER_SHOWS)
        for at, speed in enumerate(("high", "low"))
    },
    "fig18": traces.run_fig18,
    "fig19": palpation.run,
    "fig20": traces.LESS_CONSERVATIVE.run,
    "fig21": traces.MORE_CONSERVATIVE.run,
    "eq41_42": saturated.run,
}

ALIASES = {"eq41": "eq41_42", "eq42": "eq41_42"}
