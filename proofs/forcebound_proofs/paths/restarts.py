"""Attacks by restarts: each draws a device and attacks it, at random or by a search.

Run 17 of restart 3 of a search on a target is named ``TARGET:s3.17``, of a random one
``TARGET:r3.17``: to repeat it, the restart is repeated up to there.
"""

import math
import re
from abc import abstractmethod
from collections.abc import Iterator, Mapping
from dataclasses import asdict
from typing import ClassVar, NamedTuple

import numpy as np

from forcebound.errors import ConfigError
from forcebound.lab.engine import Row
from forcebound_proofs.attack import RANDOM, SEARCH, Attack, Outcome, Series, cut
from forcebound_proofs.paths.draft import Random
from forcebound_proofs.paths.run import TRACE_COLUMNS, Vector
from forcebound_proofs.paths.search import Restart

KINDS = {"r": RANDOM, "s": SEARCH}  # by the letter of a name
LETTERS = {kind: letter for letter, kind in KINDS.items()}


class RestartedRun(NamedTuple):
    """Name of one run of a restart."""

    target: str
    kind: str  # RANDOM or SEARCH
    seed: int
    number: int  # of the run


class RestartAttack(Attack):
    """Base of the attacks by restarts."""

    sizes: ClassVar[Mapping[str, int]]  # runs of a restart, by kind

    @abstractmethod
    def begin(self, law: str, target: str, kind: str, seed: int) -> tuple[Restart, Random]:
        """Return a restart that has not begun, and its chance."""

    @abstractmethod
    def check(self, target: str) -> None:
        """Check that there is such a target; ConfigError if not."""

    def restart(self, law: str, target: str, kind: str, seed: int, runs: int) -> Restart:
        """Return a restart that has made so many runs."""
        restart, random = self.begin(law, target, kind, seed)
        (restart.search if kind == SEARCH else restart.at_random)(random, runs)
        return restart

    def restarts(self, law: str, target: str, kind: str, runs: int, seed: int) -> list[Series]:
        """Return series of a kind, each a restart, with the seeds from ``seed`` on."""
        return cut(Series(self.name, law, target, kind, seed, runs), self.sizes[kind])

    def rows(self, series: Series) -> Iterator[Row]:
        """Run a restart; one row for all its runs."""
        _, law, target, kind, seed, runs = series
        restart = self.restart(law, target, kind, seed, runs)
        assert restart.worst is not None
        name = f"{self.name}:{target}:{LETTERS[kind]}{seed}.{restart.worst.number}"
        outcome, others = outcome_of(restart), {"runs": runs, "is_tight": restart.is_tight}
        yield series.row(name, outcome, **others, **self.labels(target))

    def labels(self, target: str) -> Row:
        """Return what else a row has; ``target`` may be another one than that of the series."""
        return {}

    def make(self, name: str) -> RestartedRun:
        """Return the run of a name."""
        target, _, rest = name.rpartition(":")
        numbers = re.fullmatch(r"([rs])(\d{1,9})\.(\d{1,6})", rest)
        if numbers is None:
            raise ConfigError(f"expected a run such as {self.name}:TARGET:s3.17, got {name!r}")
        self.check(target)
        return RestartedRun(target, KINDS[numbers[1]], int(numbers[2]), int(numbers[3]))

    def description(self, case: RestartedRun) -> Row:
        """Return what the device states to the law."""
        restart, _ = self.begin("certified", case.target, case.kind, case.seed)
        return {key: one for key, one in asdict(restart.case.stated).items() if one}

    def run(self, law: str, case: RestartedRun, is_traced: bool = False) -> Outcome:
        """Repeat a restart up to a run."""
        target, kind, seed, number = case
        restart = self.restart(law, target, kind, seed, number + 1)
        assert restart.last is not None
        restart.worst, trace = restart.last, list[Vector]()
        if is_traced:
            restart.run(restart.last.program, restart.last.vector, trace)
        return outcome_of(restart)._replace(
            trace=dict(zip(TRACE_COLUMNS, np.array(trace).T, strict=True)) if trace else {}
        )


def outcome_of(restart: Restart) -> Outcome:
    """Return the outcome of the worst run of a restart."""
    assert restart.worst is not None
    result = restart.worst.result
    details = {name: one for name, one in result._asdict().items() if abs(one) < math.inf}
    return Outcome(restart.margin(result), min(result.share_left, 1.0), details, {})
