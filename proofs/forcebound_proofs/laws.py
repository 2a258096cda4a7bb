"""Audit of laws against hands, walls and bad clocks: random cases, and a search of each niche."""

from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from forcebound.haptics.laws import ENERGY_TOLERANCE, LAWS, check_law
from forcebound.lab.engine import Row
from forcebound.lab.views import groups, least, table, verdict
from forcebound.units import energy_in_words as energy
from forcebound_proofs.cases import objective, ranges, search
from forcebound_proofs.law_cases import ADVERSARIES, CLOCKS, RANGES, SENSORS, case_of, clock_of
from forcebound_proofs.law_run import SECONDS, attack

NICHES = [(a, s) for a in range(len(ADVERSARIES)) for s in range(len(SENSORS))]
LOSS = "loss_and_work_min_j"


class LawCase(NamedTuple):
    """One random run against a law, or a search for the lowest energy in one niche."""

    law: str
    niche: int | None  # index in NICHES; None: a random run
    seed: int
    runs: int
    seconds: float  # of each run

    def rows(self) -> list[Row]:
        """Run it, in a niche towards lower energies; return a row for each run."""
        if self.niche is None:
            return [self._row(str(self.seed))]

        def run(code: str) -> tuple[Row, float]:
            row = self._row(code)
            return row, objective(row[LOSS], row["share_left"])

        random = np.random.default_rng((self.seed, self.niche))
        return list(search(run, NICHES[self.niche], len(RANGES), self.runs, random))

    def _row(self, name: str) -> Row:
        scenario = case_of(name, self.seconds)
        kind = "random" if self.niche is None else "search"
        row = {"law": self.law, "kind": kind, "case": name, "clock": clock_of(scenario)}
        return row | attack(self.law, scenario)[0]._asdict()


def cases(
    laws: Iterable[str], runs: int, searched: int, seed: int = 1, seconds: float = SECONDS
) -> list[LawCase]:
    """Return the cases of an audit.

    Args:
        laws: Keys of :data:`forcebound.haptics.laws.LAWS`.
        runs: Random runs of each law; they have the seeds ``seed``, ``seed + 1``, ...
        searched: Runs of each law in the search, shared by the niches.
        seed: Of the first random run, and of the search.
        seconds: Length of each run, in s.

    Raises:
        ConfigError: If a law is not known.
    """
    found = []
    for law in laws:
        check_law(law)
        found += [LawCase(law, None, one, 1, seconds) for one in range(seed, seed + runs)]
        for niche in range(len(NICHES)):
            share = searched * (niche + 1) // len(NICHES) - searched * niche // len(NICHES)
            if share:
                found.append(LawCase(law, niche, seed, share, seconds))
    return found


def summary(rows: Sequence[Row]) -> list[Row]:
    """Return the worst of each law, ready for JSON.

    Each has ``law``, ``is_certified``, ``holds`` (always true without a certificate), ``verdict``,
    ``runs``, ``loss_and_work_min_j`` and its ``case``, ``energy_min_j``, ``share_left_min``,
    ``balance_min_j``; ``random`` and ``search``: the same of each kind; ``clocks``: of each of
    :data:`CLOCKS` ``runs``, ``loss_and_work_min_j`` and ``case``.
    """
    found = []
    for (law,), own in groups(rows, "law").items():
        certified, numbers = LAWS[law].is_certified, _numbers(own)
        lowest = min(numbers[LOSS], numbers["energy_min_j"] if certified else 0.0)
        found.append(
            {
                "law": law,
                "is_certified": certified,
                "holds": not certified or lowest >= -ENERGY_TOLERANCE,
                "verdict": verdict(lowest, certified),
                **numbers,
                **{kind: _numbers(some) for (kind,), some in groups(own, "kind").items()},
                "clocks": {name: _lowest(some) for (name,), some in groups(own, "clock").items()},
            }
        )
    return found


def _lowest(rows: Sequence[Row]) -> Row:
    lowest = least(rows, LOSS)
    return {"runs": len(rows), LOSS: lowest[LOSS], "case": lowest["case"]}


def _numbers(rows: Sequence[Row]) -> Row:
    return {
        **_lowest(rows),
        "energy_min_j": min(row["energy_min_j"] for row in rows),
        "share_left_min": min(row["share_left"] for row in rows),
        "balance_min_j": min(row["balance_min_j"] for row in rows),
    }


INTRODUCTION = """\
## The laws against hands and walls

Each run simulates a device with a hand for {seconds:g} s, with an adversary as environment, a bad
network and a bad clock. It records the *loss plus work*: the energy that the device has dissipated
plus the work done against its motor. This equals the energy put in by the hand less the kinetic
energy of the device. A passive device keeps it at or above zero; the tolerance is {tolerance:.0e}
J. The device dissipates exactly the minimum that the law assumes, so no law has a hidden reserve.

A *random* case is named by its seed. The *search* is CMA-ES (N. Hansen) over the {dimensions}
continuous parameters of a case, in each of the {niches} pairs of adversary and kind of reading,
with the same budget for each law; its cases are named by a code of their parameters. Without a leak
the search minimises the *share left*: the lowest ratio of the loss plus work to its earlier
maximum.

The device is stated to the law as it is. An *overrun* is a period up to six times as long; every
other one lasts 0.3 to 2 T. The numbers of the cases are drawn from these evenly or by their
logarithm; many of them are 0 in some of the cases.
"""


def section(document: Row) -> Iterator[str]:
    """Yield the section of a page; ``document`` has ``seconds`` and the ``laws`` of `summary`."""
    laws = document["laws"]
    yield INTRODUCTION.format(
        seconds=document["seconds"],
        tolerance=ENERGY_TOLERANCE,
        dimensions=len(RANGES),
        niches=len(NICHES),
    )
    yield from table(("number, SI units", "from", "to"), ranges(RANGES))
    yield ""
    yield "### Worst case of each law\n"
    yield from worst(laws)
    balance = -min(row["balance_min_j"] for row in laws)
    yield (
        f"\nThe integrator's own error: a step of the plant has never made more than {balance:.0e}"
        " J (of steps that move up to kilojoules where no law bounds the force).\n"
    )
    leaks = [row for row in laws if row[LOSS] < -ENERGY_TOLERANCE]
    if leaks:
        yield "### The leaks, and the runs that cause them\n"
        yield "Law and case as `forcebound audit replay` takes them. *Steady*: the clock is as the"
        yield "paper's laws assume, neither jitter nor overruns; *exact*: so is the reading.\n"
        for row in leaks:
            yield f"* `{row['law']}` gives {energy(-row[LOSS])} away"
            found = {kind: row[kind] for kind in ("random", "search") if kind in row}
            found |= {name: row["clocks"][name] for name in CLOCKS[:2] if name in row["clocks"]}
            for name, one in found.items():
                if one[LOSS] < -ENERGY_TOLERANCE:
                    yield f"    * {name}: {energy(one[LOSS])}, `{row['law']} {one['case']}`"
        yield ""
    yield "### By clock and reading\n"
    yield "Lowest loss plus work. Cases are hard in other ways at once.\n"
    lines = ([row["clocks"].get(name, {}).get(LOSS) for name in CLOCKS] for row in laws)
    cells = (map(energy, one) for one in lines)
    yield from table(
        ("law", *CLOCKS), ((f"`{row['law']}`", *one) for row, one in zip(laws, cells, strict=True))
    )


def worst(laws: Iterable[Row]) -> Iterator[str]:
    """Yield a table of the worst case of each law; ``laws`` as of :func:`summary`."""
    heads = ("law", "lowest loss plus work", "random", "search", "share left", "verdict", "case")
    yield from table(heads, map(_worst, laws))


def _worst(row: Row) -> tuple[str, ...]:
    kinds = [energy(row[kind][LOSS] if kind in row else None) for kind in ("random", "search")]
    left = "–" if row[LOSS] < -ENERGY_TOLERANCE else f"{row['share_left_min']:.2%}"
    return (f"`{row['law']}`", energy(row[LOSS]), *kinds, left, row["verdict"], row["case"])
