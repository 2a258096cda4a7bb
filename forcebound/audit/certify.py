"""Campaign against the certificates: random attacks and searches, on all cores.

Each certificate is attacked twice: with the law informed of what it is about, where no run may
leak; and without, where a short search must find a leak, or the certificate would be worth nothing.
"""

import math
from collections.abc import Iterator, Sequence
from functools import reduce
from typing import Any, NamedTuple

import numpy as np

from forcebound.audit.campaign import Progress, check_runs, in_order, pieces, shares
from forcebound.audit.cases import encode
from forcebound.audit.certificates import CERTIFICATES
from forcebound.audit.path_run import PathResult, replay_path
from forcebound.audit.paths import SENSORS, dimensions, prefix
from forcebound.audit.search import descend
from forcebound.bounding import ENERGY_TOLERANCE, LAWS
from forcebound.errors import ConfigError

TIGHT = 0.01  # an attack that leaves less than this share of the energy is tight
UNINFORMED_SHARE = 0.5  # of the runs, which a law without information gets


class PathTask(NamedTuple):
    """Part of a campaign."""

    law: str
    certificate: str
    is_stated: bool
    sensor: int | None  # of a search; None: random runs
    seed: int  # first of the random runs; or of the search
    runs: int


class Worst(NamedTuple):
    """Lowest energy of some runs, above what is promised."""

    runs: int
    tight: int  # runs that left nearly nothing
    margin: float  # J
    case: str


Key = tuple[str, str, bool, str]  # law, certificate, is it stated, "random" or "search"


def results_of(task: PathTask) -> Iterator[PathResult]:
    """Run a task."""
    title = prefix(task.certificate, task.is_stated)
    if task.sensor is None:
        for seed in range(task.seed, task.seed + task.runs):
            yield replay_path(task.law, f"{title}{seed}")[0]
        return
    sensor = task.sensor

    def attack(noise: int, point: Sequence[float]) -> tuple[PathResult, float]:
        result = replay_path(task.law, title + encode((sensor, noise), point))[0]
        return result, result.objective

    certificate = CERTIFICATES[task.certificate]
    rng = np.random.default_rng((task.seed, sensor))
    yield from descend(attack, dimensions(certificate), task.runs, rng)


def tally(task: PathTask) -> Worst:
    """Run a task and return the worst result."""
    results = results_of(task)
    return reduce(
        worse, (Worst(1, one.share_left < TIGHT, one.margin, one.case.name) for one in results)
    )


def worse(own: Worst, other: Worst) -> Worst:
    """Return the runs of both, and the lower energy of the two."""
    lower = other if other.margin < own.margin else own
    return Worst(own.runs + other.runs, own.tight + other.tight, *lower[2:])


def plan(
    laws: Sequence[str], certificates: Sequence[str], runs: int, searched: int, seed: int
) -> list[PathTask]:
    """Return the tasks of a campaign; arguments as in :func:`run_certificates`."""
    tasks: list[PathTask] = []
    few, few_searched = (math.ceil(UNINFORMED_SHARE * number) for number in (runs, searched))
    for certificate in certificates:
        for law in laws:
            tasks += _tasks(law, certificate, True, runs, searched, seed)
        if CERTIFICATES[certificate].unstated:
            tasks += _tasks(laws[0], certificate, False, few, few_searched, seed)
    return tasks


def _tasks(
    law: str, certificate: str, is_stated: bool, runs: int, searched: int, seed: int
) -> Iterator[PathTask]:
    for first, number in pieces(seed, runs):
        yield PathTask(law, certificate, is_stated, None, first, number)
    for sensor, number in shares(searched, len(SENSORS)):
        yield PathTask(law, certificate, is_stated, sensor, seed, number)


def run_certificates(
    laws: Sequence[str],
    certificates: Sequence[str],
    runs: int,
    searched: int,
    seed: int = 1,
    workers: int | None = None,
    progress: Progress = lambda done, total: None,
) -> dict[str, Any]:
    """Attack ``certificates`` and return the worst results, ready for JSON.

    Args:
        laws: Certified laws, keys of :data:`forcebound.bounding.LAWS`.
        certificates: Keys of :data:`forcebound.audit.certificates.CERTIFICATES`.
        runs: Random runs of each law with each certificate.
        searched: Runs of each in a search; the uninformed law gets half of both.
        seed: Seed of the first random run, and of the search.
        workers: Processes; None: one for each core; 0: this process.
        progress: Called with the progress, in this process.

    Returns:
        ``runs`` in all, ``seed``, and ``certificates``: one entry for each and each law with
        ``certificate``, ``summary``, ``law``, ``holds``, ``runs``, ``margin_min_j`` (the lowest
        energy, or that above what is promised for late holds) and its ``case``,
        ``random_min_j``, ``search_min_j``, ``tight_share``; and ``without``, with the
        same numbers, or None: the uninformed law.

    Raises:
        ConfigError: If a law is not certified, a certificate is not known, or there is no run.
    """
    for law in laws:
        if law not in LAWS or not LAWS[law].is_certified:
            raise ConfigError(f"only a certified law has certificates, got {law!r}")
    for certificate in certificates:
        if certificate not in CERTIFICATES:
            known = ", ".join(CERTIFICATES)
            raise ConfigError(f"no certificate {certificate!r}; known are {known}")
    check_runs(runs, searched)
    tasks = plan(laws, certificates, runs, searched, seed)
    worst: dict[Key, Worst] = {}
    for task, part in in_order(tally, tasks, workers, progress):
        kind = "random" if task.sensor is None else "search"
        key = (task.law, task.certificate, task.is_stated, kind)
        worst[key] = worse(worst[key], part) if key in worst else part
    rows = [_row(law, one, worst) for one in certificates for law in laws]
    return {"runs": sum(task.runs for task in tasks), "seed": seed, "certificates": rows}


def _row(law: str, certificate: str, worst: dict[Key, Worst]) -> dict[str, Any]:
    stated = _numbers(law, certificate, True, worst)
    assert stated is not None  # it had runs
    return {
        "certificate": certificate,
        "summary": CERTIFICATES[certificate].summary,
        "law": law,
        "holds": stated["margin_min_j"] >= -ENERGY_TOLERANCE,
        **stated,
        "without": _numbers(law, certificate, False, worst),
    }


def _numbers(
    law: str, certificate: str, is_stated: bool, worst: dict[Key, Worst]
) -> dict[str, Any] | None:
    kinds = {
        kind: worst[law, certificate, is_stated, kind]
        for kind in ("random", "search")
        if (law, certificate, is_stated, kind) in worst
    }
    if not kinds:
        return None
    both = reduce(worse, kinds.values())
    return {
        "runs": both.runs,
        "margin_min_j": both.margin,
        "case": both.case,
        **{f"{kind}_min_j": one.margin for kind, one in kinds.items()},
        "tight_share": both.tight / both.runs,
    }
