"""Cases of attacks: drawn by a seed or named by a code; a search for the lowest objective.

The name of a case is enough to repeat it: the seed of a random case, or for one of a search a code
of its parameters (``c`` and base-32 digits).
"""

import math
import random
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np

from forcebound.errors import ConfigError
from forcebound.haptics.laws import ENERGY_TOLERANCE
from forcebound.lab.cases import by_logarithm

LEVELS = 1024  # of each continuous parameter in a code: two base-32 digits
DIGITS = "0123456789abcdefghijklmnopqrstuv"
NOISES = 32  # sequences of random numbers that a code can name
LARGEST_SEED = 2**63 - 1  # a compiled run carries it as a 64-bit integer

GENERATION = 12  # cases of one generation; Hansen's 4 + 3 ln(21)
SPREAD = 0.25  # first standard deviation, of ranges of length 1

LEAST_PEAK = 1e-5  # J, of an energy; what is left of less, as a share, has no meaning

Found = TypeVar("Found")


@dataclass(frozen=True)
class Range:
    """Values of a continuous parameter: evenly or by logarithm from ``low`` to ``high``, or 0."""

    low: float  # SI units
    high: float
    is_logarithmic: bool = False
    zeros: int = 0  # in a random draw, the odds of 0 against a value, as N to 1
    zero_share: float = 0.0  # in a code, the share of the range that means 0

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


def objective(leak: float, share_left: float) -> float:
    """Return the value that a search minimises.

    With a leak, its energy, in J. Without one, the share that was left, at the worst moment, of the
    loss plus work up to then: the smaller it is, the closer the law is to a leak.
    """
    return leak if leak < -ENERGY_TOLERANCE else max(share_left, 0.0)


def search(
    attack: Callable[[str], tuple[Found, float]],
    niche: Sequence[int],
    dimensions: int,
    runs: int,
    random: np.random.Generator,
) -> Iterator[Found]:
    """Search for the lowest objective by CMA-ES, and yield what every run has found.

    The covariance matrix adaptation evolution strategy (N. Hansen, "The CMA evolution strategy: a
    tutorial", arXiv:1604.00772) draws cases from a normal distribution and moves it towards those
    with the lowest objective. After convergence it restarts at another point.

    Args:
        attack: Returns result and objective of a code.
        niche: First choices of each code; the last one is one of :data:`NOISES` sequences of
            random numbers.
        dimensions: Continuous parameters of a code.
        runs: How many.
        random: Decides all.

    Raises:
        ConfigError: If the package ``cma`` is not installed.
    """
    cma, left = optimiser(), runs
    while left > 0:
        choices = (*niche, int(random.integers(NOISES)))
        strategy = cma.CMAEvolutionStrategy(
            random.uniform(0.2, 0.8, dimensions),
            SPREAD,
            {
                "bounds": [0.0, 1.0],
                "popsize": GENERATION,
                "randn": lambda *shape: random.standard_normal(shape),
                "seed": np.nan,  # randn decides; the package would seed numpy's global generator
                "verbose": -9,
            },
        )
        while left > 0 and not strategy.stop():
            points = strategy.ask()
            results = [attack(encode(choices, point)) for point in points[:left]]
            yield from (found for found, _ in results)
            left -= len(results)
            if len(results) == len(points):
                strategy.tell(points, [value for _, value in results])


def ranges(numbers: Mapping[str, Range]) -> Iterator[tuple[object, ...]]:
    """Yield a row of a table for each number of a case: its name and its ends."""
    for name, one in numbers.items():
        yield f"`{name}`", f"{one.low:g}", f"{one.high:g}"
