"""Cases of attacks: drawn by a seed or named by a code; a search for the lowest objective.

The name of a case is enough to repeat it: the seed of a random case, or for one of a search a code
of its parameters (``c`` and base-32 digits).
"""

import math
import random
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from forcebound.errors import ConfigError
from forcebound.lab.cases import by_logarithm

LEVELS = 1024  # of each continuous parameter in a code: two base-32 digits
DIGITS = "0123456789abcdefghijklmnopqrstuv"
NOISES = 32  # sequences of random numbers that a code can name
LARGEST_SEED = 2**63 - 1  # a compiled run carries it as a 64-bit integer

GENERATION = 12  # cases of one generation; Hansen's 4 + 3 ln(21)
SPREAD = 0.25  # first standard deviation, of ranges of length 1

LEAST_PEAK = 1e-5  # J, of an energy; what is left of less, as a share, has no meaning

Floats: TypeAlias = NDArray[np.float64]
Found = TypeVar("Found")


@dataclass(frozen=True)
class Range:
    """Values of a continuous parameter: evenly or by logarithm from ``low`` to ``high``, or 0."""

    low: float  # SI units
    high: float
    is_logarithmic: bool = False
    zeros: int = 0  # in a random draw, the odds of 0 against a value, as N to 1
    zero_share: float = 0.0  # in a code, the share of the range that means 0
    is_signed: bool = False  # in a code, either sign is as likely

    def draw(self, random: random.Random) -> float:
        """Return a random value."""
        value = self.value(random)
        return random.choice((0.0,) * self.zeros + (value,)) if self.zeros else value

    def value(self, random: random.Random) -> float:
        """Return a random value that is not the special 0."""
        if self.is_logarithmic:
            return math.exp(random.uniform(math.log(self.low), math.log(self.high)))
        return random.uniform(self.low, self.high)

    def at(self, u: float) -> float:
        """Return the value at ``u``, 0 to 1, of a code."""
        if u < self.zero_share:
            return 0.0
        u -= self.zero_share
        present = 1.0 - self.zero_share
        if self.is_signed:
            side = 2.0 * u / present - 1.0
            return math.copysign(replace(self, zero_share=0.0, is_signed=False).at(abs(side)), side)
        if self.is_logarithmic:
            return by_logarithm(self.low, self.high, u / present)
        return self.low + (self.high - self.low) * u / present


def seed_of(name: str) -> int | None:
    """Return the seed that a name is; None if it is a code.

    Raises:
        ConfigError: If it is too large.
    """
    if not name.isdecimal():
        return None
    if int(name) > LARGEST_SEED:
        raise ConfigError(f"a seed must be at most {LARGEST_SEED}, got {name}")
    return int(name)


def encode(choices: Sequence[int], point: Sequence[float]) -> str:
    """Return the code of a case: what is chosen among a few, and a point of numbers in [0, 1]."""
    digits = list(choices)
    for u in point:
        digits += divmod(min(LEVELS - 1, max(0, round(u * (LEVELS - 1)))), len(DIGITS))
    return "c" + "".join(DIGITS[digit] for digit in digits)


def decode(
    code: str, most: Sequence[int], ranges: Mapping[str, Range]
) -> tuple[list[int], dict[str, float]]:
    """Return the choices and the numbers of a code of :func:`encode`.

    Args:
        code: The code.
        most: How many there are to choose from, for each choice.
        ranges: Of the numbers.

    Raises:
        ConfigError: If it is no code of such a case.
    """
    digits = [DIGITS.find(digit) for digit in code[1:]]
    choices, rest = digits[: len(most)], digits[len(most) :]
    if (
        not code.startswith("c")
        or len(rest) != 2 * len(ranges)
        or min(digits) < 0
        or any(choice >= limit for choice, limit in zip(choices, most, strict=True))
    ):
        raise ConfigError(f"expected as case a seed or a code printed by an audit, got {code!r}")
    pairs = zip(rest[::2], rest[1::2], strict=True)
    levels = [(len(DIGITS) * high + low) / (LEVELS - 1) for high, low in pairs]
    named = zip(ranges.items(), levels, strict=True)
    return choices, {name: one.at(u) for (name, one), u in named}


def optimiser() -> Any:
    """Return the package that searches.

    Raises:
        ConfigError: If it is not installed.
    """
    try:
        import cma
    except ImportError as error:
        raise ConfigError(
            "the search needs the package cma: pip install forcebound-proofs; or use --search 0"
        ) from error
    return cma


def seeds(first: int, count: int) -> list[str]:
    """Return the names of so many random cases."""
    return [str(seed) for seed in range(first, first + count)]


def minimise(
    cost: Callable[[Floats], float],
    first: Floats,
    spread: float,
    population: int,
    runs: int,
    random: np.random.Generator | int,
    **options: Any,
) -> list[Floats]:
    """Search for the lowest cost by CMA-ES; return the middle of the distribution over generations.

    The covariance matrix adaptation evolution strategy (N. Hansen, "The CMA evolution strategy: a
    tutorial", arXiv:1604.00772) draws points from a normal distribution and moves it towards those
    with the lowest cost.

    Args:
        cost: Of a point.
        first: Middle of the first generation.
        spread: Standard deviation of the first generation.
        population: Points of a generation.
        runs: Points at most; it ends earlier if it has converged.
        random: Decides all; or a seed.
        options: Further options of the package.

    Raises:
        ConfigError: If the package ``cma`` is not installed.
    """
    chance: dict[str, Any] = {"seed": random}
    if isinstance(random, np.random.Generator):  # the package would seed numpy's global generator
        chance = {"seed": np.nan, "randn": lambda *shape: random.standard_normal(shape)}
    chosen = {"popsize": population, "verbose": -9, **chance, **options}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        strategy = optimiser().CMAEvolutionStrategy(first, spread, chosen)
        middles, left = [], runs
        while left > 0 and not strategy.stop():
            points = [np.asarray(point) for point in strategy.ask()]
            costs = [cost(point) for point in points[:left]]
            left -= len(costs)
            if len(costs) == len(points):
                strategy.tell(points, costs)
                middles.append(strategy.mean)
    return middles


def search(
    attack: Callable[[str], tuple[Found, float]],
    choices: Sequence[int],
    dimensions: int,
    runs: int,
    random: np.random.Generator,
) -> list[Found]:
    """Search for the lowest objective; return what each run has found.

    After convergence it restarts at another point.

    Args:
        attack: Returns result and objective of a code.
        choices: First choices of each code; the last one is one of :data:`NOISES` sequences of
            random numbers.
        dimensions: Continuous parameters of a code.
        runs: How many.
        random: Decides all.

    Raises:
        ConfigError: If the package ``cma`` is not installed.
    """
    found: list[Found] = []
    while len(found) < runs:
        chosen = (*choices, int(random.integers(NOISES)))

        def cost(point: Floats, chosen: Sequence[int] = chosen) -> float:
            one, value = attack(encode(chosen, point.tolist()))
            found.append(one)
            return value

        first = random.uniform(0.2, 0.8, dimensions)
        left = runs - len(found)
        minimise(cost, first, SPREAD, GENERATION, left, random, bounds=[0.0, 1.0])
    return found
