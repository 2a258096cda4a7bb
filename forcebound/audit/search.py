"""CMA-ES search for the lowest energy over the parameters of a case.

The covariance matrix adaptation evolution strategy (N. Hansen, "The CMA evolution strategy: a
tutorial", arXiv:1604.00772) draws cases from a normal distribution and moves it towards those with
the lowest objective. It searches one niche at a time, an adversary with a sensor, since these are
not numbers with neighbours. After convergence it restarts at another point of its niche.
"""

from collections.abc import Callable, Iterator, Sequence
from typing import Any, TypeVar

import numpy as np

from forcebound.audit.cases import ADVERSARIES, DIMENSIONS, NOISES, SENSORS, encode
from forcebound.audit.run import Result, replay
from forcebound.bounding import ENERGY_TOLERANCE
from forcebound.errors import ConfigError

NICHES = [(a, s) for a in range(len(ADVERSARIES)) for s in range(len(SENSORS))]
GENERATION = 12  # cases of one generation; Hansen's 4 + 3 ln(21)
SPREAD = 0.25  # first standard deviation, of ranges of length 1

Found = TypeVar("Found")


def objective(leak: float, share_left: float) -> float:
    """Return the value that the search minimises.

    With a leak, its energy, in J. Without one, the share that was left, at the worst moment, of the
    loss plus work up to then: the smaller it is, the closer the law is to a leak.
    """
    return leak if leak < -ENERGY_TOLERANCE else max(share_left, 0.0)


def optimiser() -> Any:
    """Return the package that searches.

    Raises:
        ConfigError: If it is not installed.
    """
    try:
        import cma
    except ImportError as error:
        raise ConfigError(
            "the search needs the package cma: pip install 'forcebound[audit]'; or use --search 0"
        ) from error
    return cma


def search(law: str, niche: int, runs: int, seed: int, seconds: float) -> Iterator[Result]:
    """Attack ``law`` in one niche and yield every run.

    Args:
        law: A key of :data:`forcebound.bounding.LAWS`.
        niche: Index in :data:`NICHES`.
        runs: How many.
        seed: Of the search; the same seed gives the same runs.
        seconds: Length of each run, in s.

    Raises:
        ConfigError: If the package ``cma`` is not installed.
    """

    def attack(noise: int, point: Sequence[float]) -> tuple[Result, float]:
        result = replay(law, encode((*NICHES[niche], noise), point), seconds)[0]
        return result, objective(result.loss_and_work_min, result.share_left)

    return descend(attack, DIMENSIONS, runs, np.random.default_rng((seed, niche)))


def descend(
    attack: Callable[[int, Sequence[float]], tuple[Found, float]],
    dimensions: int,
    runs: int,
    random: np.random.Generator,
    first: Sequence[float] | None = None,
) -> Iterator[Found]:
    """Search for the lowest objective, and yield what every run has found.

    Args:
        attack: ``(noise, point) -> (result, objective)``, with the point in the unit cube and one
            of :data:`~forcebound.audit.cases.NOISES` sequences of random numbers.
        dimensions: Of the point.
        runs: How many.
        random: Decides all.
        first: Where the first search begins; None: anywhere, as every later one does.

    Raises:
        ConfigError: If the package ``cma`` is not installed.
    """
    cma = optimiser()
    left = runs
    while left > 0:
        noise = int(random.integers(NOISES))
        anywhere = random.uniform(0.2, 0.8, dimensions)
        strategy = cma.CMAEvolutionStrategy(
            anywhere if first is None else first,
            SPREAD,
            {
                "bounds": [0.0, 1.0],
                "popsize": GENERATION,
                "randn": lambda *shape: random.standard_normal(shape),
                "seed": np.nan,  # randn decides; the package would seed numpy's global generator
                "verbose": -9,
            },
        )
        first = None
        while left > 0 and not strategy.stop():
            points = strategy.ask()
            outcomes = [attack(noise, point) for point in points[:left]]
            yield from (found for found, _ in outcomes)
            left -= len(outcomes)
            if len(outcomes) == len(points):
                strategy.tell(points, [value for _, value in outcomes])
