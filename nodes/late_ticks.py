"""Late ticks on purpose: a servo on a busy machine, reproducible, for experiments.

On a real machine ticks are late by chance. Here the lateness is drawn from a seed, the same for
every law and setting, so that they can be compared; in virtual time to the bit.
"""

from dataclasses import dataclass
from random import Random
from typing import Annotated

from forcebound.errors import ConfigError
from forcebound.quantities import NOT_NEGATIVE, Frequency, Time, check_ranges


@dataclass(frozen=True)
class LateTicks:
    """Late ticks on purpose: the writes of a servo come late, as on a busy machine.

    Attributes:
        rate: Late ticks per second on average.
        shortest: Least lateness of a late tick.
        longest: Largest; in between all are equally likely.
        jitter: Every other write comes early or late by up to this.
        seed: Of the random numbers.

    Raises:
        ConfigError: If a value is out of range or ``longest`` is less than ``shortest``.
    """

    rate: Annotated[Frequency, NOT_NEGATIVE] = 0.0
    shortest: Annotated[Time, NOT_NEGATIVE] = 0.3e-3
    longest: Annotated[Time, NOT_NEGATIVE] = 2e-3
    jitter: Annotated[Time, NOT_NEGATIVE] = 0.0
    seed: Annotated[int, NOT_NEGATIVE] = 1

    def __post_init__(self) -> None:
        check_ranges(self)
        if self.longest < self.shortest:
            message = f"longest must be >= shortest, {self.shortest:g} s, got {self.longest:g} s"
            raise ConfigError(message, field="longest")


class Lateness:
    """Draws how late each write is."""

    def __init__(self, settings: LateTicks, period: float) -> None:
        self._settings = settings
        self._chance = settings.rate * period
        self._random = Random(settings.seed)

    def draw_ns(self) -> int:
        """Return how late the next write is, in ns; negative: early."""
        random, settings = self._random, self._settings
        if random.random() < self._chance:
            late = random.uniform(settings.shortest, settings.longest)
        else:
            late = random.uniform(-settings.jitter, settings.jitter)
        return round(late * 1e9)
