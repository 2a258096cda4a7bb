"""Campaign against worlds and controllers, in two and three axes, on all cores.

Every certified law meets every world through every controller: random cases, and a search for the
lowest energy. The law ``none`` meets a few of the random cases: what it gives away is what the
attack can do.
"""

from collections.abc import Iterator, Sequence
from functools import reduce
from typing import Any, NamedTuple
from zlib import crc32

import numpy as np

from forcebound.audit.campaign import Progress, check_runs, in_order
from forcebound.audit.cases import encode
from forcebound.audit.certify import TIGHT, Worst, worse
from forcebound.audit.search import descend
from forcebound.audit.world_run import WorldResult, replay_world
from forcebound.audit.worlds import CONTROLLERS, NUMBERS, WORLDS
from forcebound.bounding import ENERGY_TOLERANCE, LAWS, check_law
from forcebound.errors import ConfigError

PIECE = 50  # random runs of a task: about a second
UNBOUNDED, UNBOUNDED_SHARE = "none", 0.2  # of the random runs, for the law that does nothing


class WorldTask(NamedTuple):
    """Part of a campaign."""

    law: str
    world: str
    controller: str
    is_search: bool
    seed: int  # first of the random runs; or of the search
    runs: int


def results_of(task: WorldTask) -> Iterator[WorldResult]:
    """Run a task."""
    title = f"{task.world}/{task.controller}:"
    if not task.is_search:
        for seed in range(task.seed, task.seed + task.runs):
            yield replay_world(task.law, f"{title}{seed}")
        return

    def attack(noise: int, point: Sequence[float]) -> tuple[WorldResult, float]:
        result = replay_world(task.law, title + encode((noise,), point))
        return result, result.objective

    random = np.random.default_rng((task.seed, crc32(title.encode())))  # whatever else is attacked
    yield from descend(attack, len(NUMBERS), task.runs, random)


def tally(task: WorldTask) -> Worst:
    """Run a task and return the worst result."""
    results = results_of(task)
    return reduce(
        worse, (Worst(1, one.share_left < TIGHT, one.lowest, one.case.name) for one in results)
    )


def plan(
    laws: Sequence[str],
    worlds: Sequence[str],
    controllers: Sequence[str],
    runs: int,
    searched: int,
    seed: int,
) -> list[WorldTask]:
    """Return the tasks of a campaign; arguments as in :func:`run_worlds`."""
    tasks = []
    for world in worlds:
        for controller in controllers:
            for law in (UNBOUNDED, *laws):
                number = int(UNBOUNDED_SHARE * runs) if law == UNBOUNDED else runs
                for first in range(0, number, PIECE):
                    piece = min(PIECE, number - first)
                    tasks.append(WorldTask(law, world, controller, False, seed + first, piece))
                if searched and law != UNBOUNDED:
                    tasks.append(WorldTask(law, world, controller, True, seed, searched))
    return tasks


def run_worlds(
    laws: Sequence[str] = (),
    worlds: Sequence[str] = (),
    controllers: Sequence[str] = (),
    runs: int = 100,
    searched: int = 100,
    seed: int = 1,
    workers: int | None = None,
    progress: Progress = lambda done, total: None,
) -> dict[str, Any]:
    """Attack laws through worlds and controllers; return the worst results, ready for JSON.

    Args:
        laws: Keys of :data:`forcebound.bounding.LAWS`; none: the certified ones.
        worlds: Keys of :data:`forcebound.audit.worlds.WORLDS`; none: all.
        controllers: Keys of :data:`forcebound.audit.worlds.CONTROLLERS`; none: all.
        runs: Random runs of each law with each world and controller.
        searched: Runs of each in a search.
        seed: Seed of the first random run, and of the search.
        workers: Processes; None: one for each core; 0: this process.
        progress: Called with the progress, in this process.

    Returns:
        ``runs`` in all, those of certified laws as ``certified_runs``, ``seed``, and ``worlds``:
        one entry for each world and law with ``world``, ``law``, ``is_certified``, ``holds``
        (always true without a certificate), ``runs``, ``margin_min_j`` (the lowest energy) and its
        ``case``, ``tight_share``, and ``controllers``: the lowest energy through each, in J.

    Raises:
        ConfigError: If a law, a world or a controller is not known, or there is no run.
    """
    for law in laws:
        check_law(law)
    chosen = list(laws) or [name for name, law in LAWS.items() if law.is_certified]
    worlds = _known(worlds, WORLDS, "world")
    controllers = _known(controllers, CONTROLLERS, "controller")
    check_runs(runs, searched)
    tasks = plan(chosen, worlds, controllers, runs, searched, seed)
    found: dict[tuple[str, str], dict[str, Worst]] = {}
    for task, part in in_order(tally, tasks, workers, progress):
        row = found.setdefault((task.world, task.law), {})
        before = row.get(task.controller)
        row[task.controller] = part if before is None else worse(before, part)
    rows = [_row(world, law, row) for (world, law), row in sorted(found.items())]
    return {
        "runs": sum(task.runs for task in tasks),
        "certified_runs": sum(row["runs"] for row in rows if row["is_certified"]),
        "seed": seed,
        "worlds": rows,
    }


def _known(names: Sequence[str], table: dict[str, Any], what: str) -> list[str]:
    for name in names:
        if name not in table:
            raise ConfigError(f"no {what} {name!r} is under attack; known are {', '.join(table)}")
    return list(names) or list(table)


def _row(world: str, law: str, row: dict[str, Worst]) -> dict[str, Any]:
    lowest = reduce(worse, row.values())
    certified = LAWS[law].is_certified
    return {
        "world": world,
        "law": law,
        "is_certified": certified,
        "holds": not certified or lowest.margin >= -ENERGY_TOLERANCE,
        "runs": lowest.runs,
        "margin_min_j": lowest.margin,
        "case": lowest.case,
        "tight_share": lowest.tight / lowest.runs,
        "controllers": {controller: worst.margin for controller, worst in row.items()},
    }
