"""Chances of a link: loss, delay and the rest, drawn alike for links, computations and sweeps.

Each random decision has a generator of its own, and every packet draws all its numbers: two
settings compared under one seed differ in nothing but the setting. *Correlation* is netem's, ``u =
(1 - rho) * new + rho * last``. The *time on the way* is ``delay + jitter * quantile(u)``, rounded
to nanoseconds and never negative.

A link that has nothing but delay, uniform jitter and independent loss is *plain*: a packet draws
two numbers only (:meth:`Chances.next_plain`), or all packets of a run draw theirs as arrays
(:func:`plain_fates`).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

from forcebound.network.impairment import Impairment, Slot

if TYPE_CHECKING:  # a launcher has no link, and starts without numpy
    import numpy as np
    from numpy.typing import NDArray

Draw: TypeAlias = Callable[[], float]

_DECISIONS = (  # one generator each, by place: append only
    *("loss", "jitter", "state", "state_loss"),
    *("duplicate", "reorder", "corrupt", "slot"),
)


class Fate(NamedTuple):
    """The random outcome of one packet."""

    is_lost: bool
    is_duplicated: bool
    is_corrupt: bool
    goes_at_once: bool  # if the gap allows it
    delay_ns: int


class Draws(dict[str, Draw]):
    """The random numbers of one link by decision, uniform in [0, 1), a generator for each.

    The copies of duplicated packets have numbers of their own (``is_copy``).
    """

    def __init__(self, seed: int, *, is_copy: bool = False) -> None:
        super().__init__()
        self._seed = seed
        self._is_copy = is_copy

    def __missing__(self, decision: str) -> Draw:
        """Make the generator of a decision; most links need two of eight."""
        self[decision] = _generator(self._seed, decision, self._is_copy).random
        return self[decision]


def _generator(seed: int, decision: str, is_copy: bool = False) -> np.random.Generator:
    import numpy as np

    place = _DECISIONS.index(decision)
    words = [seed, place, 1] if is_copy else [seed, place]
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence(words)))


def plain_fates(
    impairment: Impairment, seed: int, count: int
) -> tuple[NDArray[np.bool_], NDArray[np.int64]]:
    """Return which of the first packets of a plain link are lost, and all times on the way, ns."""
    import numpy as np

    lost = np.zeros(count, dtype=np.bool_)
    deviation = np.zeros(count)
    if impairment.loss > 0.0:  # a generator costs more than all the rest
        lost = _generator(seed, "loss").random(count) < impairment.loss
    if impairment.jitter > 0.0:
        numbers = _generator(seed, "jitter").random(count)
        deviation = impairment.jitter * 1e9 * (2.0 * numbers - 1.0)
    # rint takes ties to even, as round does for one number.
    travel = round(impairment.delay * 1e9) + np.rint(deviation).astype(np.int64)
    return lost, np.maximum(travel, 0)


class Chances:
    """The random processes of one link under one impairment; they go on with its numbers."""

    def __init__(self, impairment: Impairment, draws: Draws) -> None:
        self._impairment = impairment
        self._delay_ns = round(impairment.delay * 1e9)
        self._jitter_ns = impairment.jitter * 1e9
        self._quantile = impairment.quantile
        self._loss_share = impairment.loss
        self._loss = _correlated(draws["loss"], impairment.loss_correlation)
        self._jitter = _correlated(draws["jitter"], impairment.correlation)
        self._is_bad = False
        if impairment.is_plain:
            return  # it needs no more generators
        self._duplicate = _correlated(draws["duplicate"], impairment.duplicate_correlation)
        self._reorder = _correlated(draws["reorder"], impairment.reorder_correlation)
        self._corrupt = _correlated(draws["corrupt"], impairment.corrupt_correlation)
        self._state, self._state_loss = draws["state"], draws["state_loss"]
        self._slot = draws["slot"]

    def next_plain(self) -> int | None:
        """Return how long the next packet of a plain link travels, in ns; None if it is lost."""
        is_lost = self._loss() < self._loss_share
        travel_ns = self.travel_ns()
        return None if is_lost else travel_ns

    def next(self) -> Fate:
        """Return the fate of the next packet of a link that is not plain."""
        impairment = self._impairment
        is_lost = self._loss() < self._loss_share
        return Fate(
            self._is_lost_by_state() or is_lost,
            self._duplicate() < impairment.duplicate,
            self._corrupt() < impairment.corrupt,
            self._reorder() < impairment.reorder,
            self.travel_ns(),
        )

    def travel_ns(self) -> int:
        """Return the next time on the way, in ns."""
        deviation_ns = self._jitter_ns * self._quantile(self._jitter())
        return max(0, self._delay_ns + round(deviation_ns))

    def slot_delay_ns(self, slot: Slot) -> int:
        """Return the time until the next slot, in ns."""
        longest = slot.min_delay if slot.max_delay is None else slot.max_delay
        return round((slot.min_delay + (longest - slot.min_delay) * self._slot()) * 1e9)

    def _is_lost_by_state(self) -> bool:
        change, chance = self._state(), self._state_loss()
        model = self._impairment.gemodel
        if model is None:
            return False
        is_lost = chance < 1.0 - (model.h if self._is_bad else model.k)
        if change < (model.r if self._is_bad else model.p):
            self._is_bad = not self._is_bad
        return is_lost


def _correlated(draw: Draw, rho: float) -> Draw:
    """Return a function that draws numbers in [0, 1), each correlated with the one before."""
    last: float | None = None

    def draw_towards_last() -> float:
        nonlocal last
        number = draw()
        last = number if last is None else (1.0 - rho) * number + rho * last
        return last

    return draw_towards_last if rho else draw
