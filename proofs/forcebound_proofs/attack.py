"""What all attacks on laws share: names, series of runs, their rows, summary and tables.

The name of a run is enough to repeat it. Its first word is a key of :data:`ATTACKS`, the rest is
that attack's: ``laws:176``, ``paths:guarding:s3.17``, ``worlds:mesh/direct:c12...``.

To add an attack: a class with the methods of :class:`Attack`, and one line in :data:`ATTACKS`.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import cache
from importlib import import_module
from typing import Any, ClassVar, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from forcebound.errors import ConfigError
from forcebound.haptics.laws import ENERGY_TOLERANCE, LAWS
from forcebound.lab.engine import Row
from forcebound.lab.views import groups, table
from forcebound.units import energy_in_words as energy
from forcebound_proofs.cases import Range, search, seeds
from forcebound_proofs.views import least, verdict

RANDOM, SEARCH = "random", "search"  # kinds of series
MARGIN = "margin_j"  # of a row: what a passive law keeps at or above zero, in J
PIECE = 50  # random runs of one series

Names: TypeAlias = Sequence[str]
Floats: TypeAlias = NDArray[np.float64]

#: Attacks by the first word of their names: module and class.
ATTACKS: dict[str, str] = {
    "paths": "forcebound_proofs.paths.campaign:PathAttack",
    "laws": "forcebound_proofs.laws:LawAttack",
    "worlds": "forcebound_proofs.worlds:WorldAttack",
    "sensitivity": "forcebound_proofs.sensitivity:MistakeAttack",
}

#: Columns of tables of worst runs: cells of a row of :meth:`Attack.summary`.
COLUMNS: dict[str, Callable[[Row], str]] = {
    "law": lambda row: f"`{row['law']}`",
    "runs": lambda row: f"{row['runs']:,}",
    "lowest energy": lambda row: energy(row[MARGIN]),
    "verdict": lambda row: str(row["verdict"]),
    "case": lambda row: str(row["case"]),
}


class Budget(NamedTuple):
    """How much is to be run."""

    runs: int  # at random, of each law and target
    searched: int  # in searches, of each
    seed: int = 1  # of the first random run, and of the searches


class Outcome(NamedTuple):
    """Result of one run."""

    margin_j: float  # lowest energy, J, which a passive law keeps at or above zero
    share_left: float  # lowest share left of the energy so far; 1, or infinite, if there was none
    details: Row  # further numbers, ready for JSON
    trace: dict[str, Floats]  # columns, SI units, to be drawn; empty unless it is asked for


class Series(NamedTuple):
    """Runs of one attack on one law: random ones, or a search."""

    attack: str  # key of ATTACKS
    law: str
    target: str  # what the law is attacked through; the attack knows
    kind: str  # RANDOM or SEARCH
    seed: int
    runs: int

    def rows(self) -> list[Row]:
        """Run it; a row has ``attack``, ``law``, ``target``, ``kind``, ``runs`` and ``case``.

        ``runs`` are those that the row sums up, ``case`` is the name of the one with the lowest
        energy; ``margin_j`` and ``share_left`` as of :class:`Outcome`. An attack adds others.
        """
        return list(attack_named(self.attack).rows(self))

    def row(self, name: str, outcome: Outcome, **others: Any) -> Row:
        """Return the row of a run."""
        numbers = {MARGIN: outcome.margin_j, "share_left": outcome.share_left}
        return {**self._asdict(), "runs": 1, "case": name, **numbers, **others}


class Attack(ABC):
    """A kind of attack on laws."""

    name: ClassVar[str]  # key of ATTACKS
    title: ClassVar[str] = "Audit of the laws"  # of a page that begins with it
    introduction: ClassVar[str]  # of its section
    #: Heads of the table of its worst runs, and the cells of those that are not in `COLUMNS`.
    columns: ClassVar[Mapping[str, Callable[[Row], str] | None]]
    groups: ClassVar[tuple[str, ...]] = ("kind",)  # keys of rows; the summary has each group's

    @abstractmethod
    def series(self, laws: Names, targets: Names, budget: Budget) -> list[Series]:
        """Return what is to be run.

        Args:
            laws: Keys of :data:`forcebound.haptics.laws.LAWS`; none: those that it is meant for.
            targets: What they are attacked through; none: everything.
            budget: Of each law and target.

        Raises:
            ConfigError: If a law or a target is not known.
        """

    @abstractmethod
    def rows(self, series: Series) -> Iterable[Row]:
        """Run a series."""

    @abstractmethod
    def make(self, name: str) -> Any:
        """Return the case of a name, without its first word.

        Raises:
            ConfigError: If it is none.
        """

    @abstractmethod
    def run(self, law: str, case: Any, is_traced: bool = False) -> Outcome:
        """Run a case.

        Raises:
            ConfigError: If there is no such law.
        """

    @abstractmethod
    def description(self, case: Any) -> Row:
        """Return the numbers of a case, ready for JSON."""

    def summary(self, rows: Iterable[Row]) -> list[Row]:
        """Return the worst of each target and law, ready for JSON.

        Each has ``target``, ``law``, ``is_certified``, ``holds`` (always true without a
        certificate), ``verdict``, ``runs``, ``margin_j`` and its ``case``, ``share_left``; for each
        of the attack's ``groups`` the last four by its values; and :meth:`further`.
        """
        found = []
        for (target, law), own in groups(rows, "target", "law").items():
            certified, stated = LAWS[law].is_certified, [one for one in own if is_stated(one)]
            numbers = lowest(stated)
            found.append(
                {
                    "target": target,
                    "law": law,
                    "is_certified": certified,
                    "holds": not certified or numbers[MARGIN] >= -ENERGY_TOLERANCE,
                    "verdict": verdict(numbers[MARGIN], certified),
                    **numbers,
                    **{
                        key: {value: lowest(some) for (value,), some in groups(stated, key).items()}
                        for key in self.groups
                    },
                    **self.further(own),
                }
            )
        return found

    def further(self, rows: Sequence[Row]) -> Row:
        """Return what else the summary has of the rows of a target and law."""
        return {}

    def section(self, rows: Sequence[Row]) -> Iterator[str]:
        """Yield the section of a page; ``rows`` as of :meth:`summary`."""
        yield self.introduction
        yield from self.worst(rows)
        yield ""

    def worst(self, rows: Sequence[Row]) -> Iterator[str]:
        """Yield a table of the worst run of each target and law."""
        cells = [cell or COLUMNS[head] for head, cell in self.columns.items()]
        yield from table(list(self.columns), ([cell(row) for cell in cells] for row in rows))


class CodedAttack(Attack):
    """An attack whose cases are named by a seed, or by the code of a search."""

    @abstractmethod
    def prefix(self, target: str) -> str:
        """Return what the names of a series begin with."""

    @abstractmethod
    def space(self, series: Series) -> tuple[Sequence[int], int, np.random.Generator]:
        """Return the first choices of the codes of a search, its dimensions, its chance."""

    def labels(self, law: str, case: Any, outcome: Outcome) -> Row:
        """Return what else a row has; ``target`` may be another one than that of the series."""
        return {}

    def rows(self, series: Series) -> Iterator[Row]:
        """Run a series; a row for each run."""
        prefix = self.prefix(series.target)

        def run(code: str) -> tuple[Row, float]:
            case = self.make(prefix + code)
            outcome = self.run(series.law, case)
            name, labels = f"{self.name}:{prefix}{code}", self.labels(series.law, case, outcome)
            return series.row(name, outcome, **labels), objective(outcome)

        if series.kind == RANDOM:
            yield from (run(seed)[0] for seed in seeds(series.seed, series.runs))
        else:
            choices, dimensions, random = self.space(series)
            yield from search(run, choices, dimensions, series.runs, random)

    def at_random(self, law: str, target: str, runs: int, seed: int) -> list[Series]:
        """Return series of random runs, with the seeds from ``seed`` on."""
        return cut(Series(self.name, law, target, RANDOM, seed, runs), PIECE, PIECE)


def cut(series: Series, size: int, step: int = 1) -> list[Series]:
    """Return series of at most ``size`` runs; the seed of each is by ``step`` larger."""
    return [
        series._replace(seed=series.seed + number * step, runs=min(size, series.runs - first))
        for number, first in enumerate(range(0, series.runs, size))
    ]


def certified_laws() -> list[str]:
    """Return the laws that have a certificate."""
    return [name for name, law in LAWS.items() if law.is_certified]


def objective(outcome: Outcome) -> float:
    """Return the value that a search minimises.

    With a leak, its energy, in J. Without one, the share that was left, at the worst moment, of the
    energy up to then: the smaller it is, the closer the law is to a leak.
    """
    if outcome.margin_j < -ENERGY_TOLERANCE:
        return outcome.margin_j
    return max(outcome.share_left, 0.0)


@cache
def attack_named(name: str) -> Attack:
    """Return the attack of a key of :data:`ATTACKS`."""
    module, kind = ATTACKS[name].split(":")
    made: Attack = getattr(import_module(module), kind)()
    return made


def attack_of(name: str) -> tuple[Attack, str]:
    """Return the attack of the name of a run, and the rest of the name.

    Raises:
        ConfigError: If there is no such attack.
    """
    first, colon, rest = name.partition(":")
    if not colon or first not in ATTACKS:
        known = ", ".join(f"{one}:..." for one in ATTACKS)
        raise ConfigError(f"expected the name of a run, such as laws:176, got {name!r}", known)
    return attack_named(first), rest


def is_stated(row: Row) -> bool:
    """Return whether the law was given all that it is promised, so that its verdict counts."""
    return not row.get("left_out")


def lowest(rows: Sequence[Row]) -> Row:
    """Return the number of runs, the lowest energy, its case, and the lowest share left."""
    found = least(rows, MARGIN)
    return {
        "runs": sum(row["runs"] for row in rows),
        MARGIN: found[MARGIN],
        "case": found["case"],
        "share_left": min(row["share_left"] for row in rows),
    }


def spans(numbers: Mapping[str, Range]) -> Iterator[str]:
    """Yield a table of the numbers of a case: their names and their ends."""
    rows = ((f"`{name}`", f"{one.low:g}", f"{one.high:g}") for name, one in numbers.items())
    yield from table(("number, SI units", "from", "to"), rows)
