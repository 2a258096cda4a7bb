"""Audit of laws against hands, walls and bad clocks: random cases, and a search of each pair."""

from collections.abc import Iterator, Sequence
from typing import ClassVar

import numpy as np

from forcebound.haptics.laws import ENERGY_TOLERANCE, LAWS, check_law
from forcebound.lab.engine import Row
from forcebound.lab.views import table
from forcebound.units import energy_in_words as energy
from forcebound_proofs.attack import (
    COLUMNS,
    MARGIN,
    SEARCH,
    Budget,
    CodedAttack,
    Names,
    Outcome,
    Series,
    spans,
)
from forcebound_proofs.law_cases import (
    ADVERSARIES,
    CLOCKS,
    RANGES,
    SENSORS,
    Scenario,
    case_of,
    clock_of,
)
from forcebound_proofs.law_run import SECONDS, run_law

PAIRS = [f"{adversary}/{sensor}" for adversary in ADVERSARIES for sensor in SENSORS]


def _of_kind(kind: str, row: Row) -> str:
    return energy(row["kind"][kind][MARGIN] if kind in row["kind"] else None)


def _left(row: Row) -> str:
    return "–" if row[MARGIN] < -ENERGY_TOLERANCE else f"{row['share_left']:.2%}"


class LawAttack(CodedAttack):
    """Every law against hands, adversaries, networks and clocks, on one axis.

    A search is of one pair of adversary and kind of reading.
    """

    name = "laws"
    columns: ClassVar = {
        "law": None,
        "lowest loss plus work": COLUMNS["lowest energy"],
        "random": lambda row: _of_kind("random", row),
        "search": lambda row: _of_kind("search", row),
        "share left": _left,
        "verdict": None,
        "case": None,
    }
    groups = ("kind", "clock")
    introduction = f"""\
## The laws against hands and walls

Each run simulates a device with a hand for {SECONDS:g} s, with an adversary as environment, a bad
network and a bad clock. It records the *loss plus work*: the energy that the device has dissipated
plus the work done against its motor. This equals the energy put in by the hand less the kinetic
energy of the device. A passive device keeps it at or above zero; the tolerance is
{ENERGY_TOLERANCE:.0e} J. The device dissipates exactly the minimum that the law assumes, so no law
has a hidden reserve.

A *random* case is named by its seed. The *search* is CMA-ES (N. Hansen) over the {len(RANGES)}
continuous parameters of a case, in each of the {len(PAIRS)} pairs of adversary and kind of reading,
with the same budget for each law; its cases are named by a code of their parameters. Without a leak
the search minimises the *share left*: the lowest ratio of the loss plus work to its earlier
maximum.

The device is stated to the law as it is. An *overrun* is a period up to six times as long; every
other one lasts 0.3 to 2 T. The numbers of the cases are drawn from these ranges, evenly or by their
logarithm; many of them are 0 in some of the cases.
"""

    def series(self, laws: Names, targets: Names, budget: Budget) -> list[Series]:
        """Return what is to be run; the pairs share the searches. There are no targets."""
        found, (runs, searched, seed) = [], budget
        for law in laws or LAWS.usual:
            check_law(law)
            found += self.at_random(law, "", runs, seed)
            for number, pair in enumerate(PAIRS):
                share = searched * (number + 1) // len(PAIRS) - searched * number // len(PAIRS)
                if share:
                    found.append(Series(self.name, law, pair, SEARCH, seed, share))
        return found

    def prefix(self, target: str) -> str:
        """Return what the names of a series begin with."""
        return ""

    def space(self, series: Series) -> tuple[Sequence[int], int, np.random.Generator]:
        """Return the pair of a search, its dimensions, its chance."""
        number = PAIRS.index(series.target)
        random = np.random.default_rng((series.seed, number))
        return divmod(number, len(SENSORS)), len(RANGES), random

    def labels(self, law: str, case: Scenario, outcome: Outcome) -> Row:
        """Return the kind of clock, and the plant's error."""
        balance = outcome.details["balance_min_j"]
        return {"target": "", "clock": clock_of(case), "balance_min_j": balance}

    def make(self, name: str) -> Scenario:
        """Return the case of a seed or a code."""
        return case_of(name, SECONDS)

    def run(self, law: str, case: Scenario, is_traced: bool = False) -> Outcome:
        """Run a case."""
        return run_law(law, case)

    def description(self, case: Scenario) -> Row:
        """Return the numbers of a case."""
        named = {"adversary": list(ADVERSARIES)[case.adversary], "sensor": SENSORS[case.sensor]}
        return case._asdict() | named

    def further(self, rows: Sequence[Row]) -> Row:
        """Return the largest error of the plant."""
        return {"balance_min_j": min(row["balance_min_j"] for row in rows)}

    def section(self, rows: Sequence[Row]) -> Iterator[str]:
        """Yield the section of a page."""
        yield self.introduction
        yield from spans(RANGES)
        yield ""
        yield "### Worst case of each law\n"
        yield from self.worst(rows)
        balance = -min(row["balance_min_j"] for row in rows)
        yield (
            f"\nThe integrator's own error: a step of the plant has never made more than"
            f" {balance:.0e} J (of steps that move up to kilojoules where no law bounds the force)."
            "\n"
        )
        yield from _leaks([row for row in rows if row[MARGIN] < -ENERGY_TOLERANCE])
        yield "### By clock and reading\n"
        yield "Lowest loss plus work. Cases are hard in other ways at once.\n"
        lines = ([row["clock"].get(name, {}).get(MARGIN) for name in CLOCKS] for row in rows)
        cells = (map(energy, one) for one in lines)
        named = ((f"`{row['law']}`", *one) for row, one in zip(rows, cells, strict=True))
        yield from table(("law", *CLOCKS), named)


def _leaks(rows: Sequence[Row]) -> Iterator[str]:
    if not rows:
        return
    yield "### The leaks, and the runs that cause them\n"
    yield "Law and case as `forcebound audit replay` takes them. *Steady*: the clock is as the"
    yield "paper's laws assume, neither jitter nor overruns; *exact*: so is the reading.\n"
    for row in rows:
        yield f"* `{row['law']}` gives {energy(-row[MARGIN])} away"
        found = row["kind"] | {
            name: row["clock"][name] for name in CLOCKS[:2] if name in row["clock"]
        }
        for name, one in found.items():
            if one[MARGIN] < -ENERGY_TOLERANCE:
                yield f"    * {name}: {energy(one[MARGIN])}, `{row['law']} {one['case']}`"
    yield ""
