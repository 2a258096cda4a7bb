"""Campaign of random and searched attacks on laws, on all cores.

The campaign consists of independent tasks, so its numbers do not depend on the number of cores.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, NamedTuple, Protocol, TypeVar

from forcebound.audit.cases import difficulties, draw_case
from forcebound.audit.run import Result, attack
from forcebound.audit.search import NICHES, search
from forcebound.bounding import ENERGY_TOLERANCE, LAWS, check_law
from forcebound.errors import ConfigError
from forcebound.workers import completed, local_executor

PIECE = 500  # random runs of a task: about a second

#: Called with the runs done and all runs.
Progress = Callable[[int, int], None]


class Task(NamedTuple):
    """Part of a campaign."""

    law: str
    niche: int | None  # of the search; None: random runs
    seed: int  # first of the random runs; or of the search
    runs: int
    seconds: float  # of each run


class Extreme(NamedTuple):
    """Lowest loss plus work of some runs, and the run that has it."""

    runs: int
    loss_and_work: float  # J
    energy: float  # J, the lowest of the hand in any of the runs
    share_left: float
    balance: float  # J
    case: str


Tally = dict[tuple[str, ...], Extreme]
"""By ``(law, "random" or "search")`` and by ``(law, axis, difficulty)``."""


def results_of(task: Task) -> Iterator[Result]:
    """Run a task."""
    if task.niche is None:
        for seed in range(task.seed, task.seed + task.runs):
            yield attack(task.law, draw_case(seed, task.seconds))[0]
    else:
        yield from search(task.law, task.niche, task.runs, task.seed, task.seconds)


def tally(task: Task) -> Tally:
    """Run a task and return the worst results."""
    worst: Tally = {}
    kind = "random" if task.niche is None else "search"
    for result in results_of(task):
        one = Extreme(
            1,
            result.loss_and_work_min,
            result.energy_min,
            result.share_left,
            result.balance_min,
            result.case.name,
        )
        for key in ((kind,), *difficulties(result.case).items()):
            _add(worst, (task.law, *key), one)
    return worst


def _add(worst: Tally, key: tuple[str, ...], other: Extreme) -> None:
    own = worst.get(key)
    if own is None:
        worst[key] = other
        return
    lower = other if other.loss_and_work < own.loss_and_work else own
    worst[key] = Extreme(
        own.runs + other.runs,
        lower.loss_and_work,
        min(own.energy, other.energy),
        min(own.share_left, other.share_left),
        min(own.balance, other.balance),
        lower.case,
    )


def plan(laws: Iterable[str], runs: int, searched: int, seed: int, seconds: float) -> list[Task]:
    """Return the tasks of a campaign; arguments as in :func:`run_campaign`."""
    tasks = []
    for law in laws:
        for first, number in pieces(seed, runs):
            tasks.append(Task(law, None, first, number, seconds))
        for niche, number in shares(searched, len(NICHES)):
            tasks.append(Task(law, niche, seed, number, seconds))
    return tasks


def pieces(seed: int, runs: int) -> Iterator[tuple[int, int]]:
    """Yield first seed and number of the random runs of each task."""
    for first in range(0, runs, PIECE):
        yield seed + first, min(PIECE, runs - first)


def shares(searched: int, niches: int) -> Iterator[tuple[int, int]]:
    """Yield each niche that has runs of a search, and how many."""
    for niche in range(niches):
        number = searched * (niche + 1) // niches - searched * niche // niches
        if number:
            yield niche, number


def check_runs(runs: int, searched: int) -> None:
    """Check that there is something to run.

    Raises:
        ConfigError: If there is not.
    """
    if runs < 0 or searched < 0 or runs + searched < 1:
        raise ConfigError(f"runs must be >= 1, got {runs} random and {searched} searched")


def run_campaign(
    laws: Sequence[str],
    runs: int,
    searched: int = 0,
    seed: int = 1,
    seconds: float = 2.0,
    workers: int | None = None,
    progress: Progress = lambda done, total: None,
) -> dict[str, Any]:
    """Attack ``laws`` and return the worst results, ready for JSON.

    Args:
        laws: Keys of :data:`forcebound.bounding.LAWS`.
        runs: Random runs of each law; they have the seeds ``seed``, ``seed + 1``, ...
        searched: Runs of each law in the search.
        seed: Seed of the first random run, and of the search.
        seconds: Length of each run, in s.
        workers: Processes; None: one for each core; 0: this process.
        progress: Called with the progress, in this process.

    Returns:
        ``runs`` in all, ``seed``, ``seconds``, and ``laws``: one entry each with ``law``,
        ``is_certified``, ``holds`` (always true without a certificate), ``runs``,
        ``loss_and_work_min_j`` and its ``case``, ``energy_min_j``, ``share_left_min``,
        ``balance_min_j``; ``random`` and ``search``: the same of each kind; ``difficulties``: by
        axis and difficulty ``runs``, ``loss_and_work_min_j`` and ``case``.

    Raises:
        ConfigError: If a law is not known or there is no run.
    """
    for law in laws:
        check_law(law)
    check_runs(runs, searched)
    tasks = plan(laws, runs, searched, seed, seconds)
    worst: Tally = {}
    for _, part in in_order(tally, tasks, workers, progress):
        for key, extreme in part.items():
            _add(worst, key, extreme)
    return {
        "runs": sum(task.runs for task in tasks),
        "seed": seed,
        "seconds": seconds,
        "laws": [_summary(law, worst) for law in laws],
    }


class HasRuns(Protocol):
    """A part of a campaign."""

    @property
    def runs(self) -> int:
        """Number of its runs."""
        ...


Part = TypeVar("Part", bound=HasRuns)
Outcome = TypeVar("Outcome")


def in_order(
    work: Callable[[Part], Outcome],
    tasks: Sequence[Part],
    workers: int | None,
    progress: Progress,
) -> Iterator[tuple[Part, Outcome]]:
    """Run ``work`` on each task; yield it with its outcome, in the order of tasks.

    So ties are deterministic. ``workers`` and ``progress`` as in :func:`run_campaign`.
    """
    total, done = sum(task.runs for task in tasks), 0
    progress(done, total)
    for task, outcome in _in_order(work, tasks, workers):
        yield task, outcome
        done += task.runs
        progress(done, total)


def _in_order(
    work: Callable[[Part], Outcome], tasks: Sequence[Part], workers: int | None
) -> Iterator[tuple[Part, Outcome]]:
    if workers == 0:
        yield from ((task, work(task)) for task in tasks)
        return
    with local_executor(workers) as executor:
        waiting: dict[int, Outcome] = {}
        following = 0
        for index, part in completed(executor, work, tasks):
            waiting[index] = part
            while following in waiting:
                yield tasks[following], waiting.pop(following)
                following += 1


def _summary(law: str, worst: Tally) -> dict[str, Any]:
    kinds = {kind: worst[law, kind] for kind in ("random", "search") if (law, kind) in worst}
    both: Tally = {}
    for extreme in kinds.values():
        _add(both, (law,), extreme)
    axes: dict[str, dict[str, Any]] = {}
    for key, extreme in sorted(worst.items()):
        if key[0] == law and len(key) == 3:
            axes.setdefault(key[1], {})[key[2]] = {
                "runs": extreme.runs,
                "loss_and_work_min_j": extreme.loss_and_work,
                "case": extreme.case,
            }
    lowest = both[law,]
    certified = LAWS[law].is_certified
    holds = min(lowest.loss_and_work, lowest.energy) >= -ENERGY_TOLERANCE
    return {
        "law": law,
        "is_certified": certified,
        "holds": not certified or holds,
        **_numbers(lowest),
        **{kind: _numbers(extreme) for kind, extreme in kinds.items()},
        "difficulties": axes,
    }


def _numbers(extreme: Extreme) -> dict[str, Any]:
    return {
        "runs": extreme.runs,
        "loss_and_work_min_j": extreme.loss_and_work,
        "energy_min_j": extreme.energy,
        "share_left_min": extreme.share_left,
        "balance_min_j": extreme.balance,
        "case": extreme.case,
    }
