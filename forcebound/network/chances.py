"""Chances of a link: loss, delay and the rest, drawn alike for links and computations.

Each random decision has a separate generator, and every packet draws all its numbers: two
settings compared under one seed differ in nothing but the setting. *Correlation* is netem's, ``u =
(1 - rho) * new + rho * last``. The *time on the way* is ``delay + jitter * quantile(u)``, rounded
to nanoseconds and never negative, or that of a trace; to both, *spikes* add. Whether a period has
its spike depends on the number of the period alone, however many packets arrive.
"""

import hashlib
from collections.abc import Callable
from typing import NamedTuple, TypeAlias

from forcebound.network.impairment import PERFECT, Impairment
from forcebound.network.trace import DelayTrace

Draw: TypeAlias = Callable[[], float]

# A generator each, by place: append only.
_DECISIONS = ("loss", "jitter", "state", "state_loss", "duplicate", "reorder", "corrupt")


class Fate(NamedTuple):
    """The random outcome of one packet."""

    is_lost: bool
    is_duplicated: bool
    is_corrupt: bool
    goes_at_once: bool
    delay_ns: int | None  # None: its trace loses it


class Draws(dict[str, Draw]):
    """The random numbers of one link by decision, uniform in [0, 1), a generator for each.

    The copies of duplicated packets have other numbers (``is_copy``).
    """

    def __init__(self, seed: int, *, is_copy: bool = False) -> None:
        super().__init__()
        self._seed, self._copy = seed, [1] if is_copy else []

    def __missing__(self, decision: str) -> Draw:
        """Make the generator of a decision; most links need two of seven."""
        import numpy as np  # a launcher has no link, and starts without numpy

        words = [self._seed, _DECISIONS.index(decision), *self._copy]
        self[decision] = np.random.Generator(np.random.PCG64(np.random.SeedSequence(words))).random
        return self[decision]

    def once(self, *about: int) -> float:
        """Return a number in [0, 1) that depends on the seed and these numbers alone."""
        words = ",".join(map(str, (self._seed, *about))).encode()
        return int.from_bytes(hashlib.blake2b(words, digest_size=6).digest(), "big") / 2**48


class Chances:
    """The random processes of one link under one impairment; they go on with its numbers.

    ``trace`` is the content of the file ``impairment.trace``. ValueError if it is named and not
    given.
    """

    def __init__(
        self, impairment: Impairment, draws: Draws, trace: DelayTrace | None = None
    ) -> None:
        if trace is None and impairment.trace is not None:
            raise ValueError(f"the delays of the trace {impairment.trace} are missing")
        self._impairment, self._draws, self._trace = impairment, draws, trace
        self._delay_ns = round(impairment.delay * 1e9)
        self._jitter_ns = impairment.jitter * 1e9
        self._quantile = impairment.quantile
        self._spikes = [
            [round(at * 1e9) for at in (one.period, one.start, one.duration, one.delay)]
            for one in impairment.spikes
        ]
        self._last: float | None = None  # number of the last deviation
        self._is_bad = False

    def next(self, since_ns: int) -> Fate:
        """Return the fate of the next packet, ``since_ns`` ns after the first."""
        impairment, draws = self._impairment, self._draws
        is_lost = draws["loss"]() < impairment.loss
        return Fate(
            self._is_lost_by_state() or is_lost,
            draws["duplicate"]() < impairment.duplicate,
            draws["corrupt"]() < impairment.corrupt,
            draws["reorder"]() < impairment.reorder,
            self.travel_ns(since_ns),
        )

    def next_plain(self) -> int | None:
        """Return how long the next packet of a plain link travels, in ns; None if it is lost."""
        is_lost = self._draws["loss"]() < self._impairment.loss
        travel_ns = self.travel_ns()
        return None if is_lost else travel_ns

    def travel_ns(self, since_ns: int = 0) -> int | None:
        """Return the next time on the way, in ns; None if the trace loses the packet."""
        longer_ns = self._spike_ns(since_ns) if self._spikes else 0
        if self._trace is not None:
            travel_ns = self._trace.delay_ns(since_ns)
            return None if travel_ns is None else travel_ns + self._delay_ns + longer_ns
        number, rho = self._draws["jitter"](), self._impairment.correlation
        if rho and self._last is not None:
            number = (1.0 - rho) * number + rho * self._last
        self._last = number
        deviation_ns = round(self._jitter_ns * self._quantile(number))
        return max(0, self._delay_ns + deviation_ns) + longer_ns

    def _spike_ns(self, since_ns: int) -> int:
        """Return what the spikes add to a delay, in ns."""
        added_ns = 0
        for number, (period_ns, start_ns, lasts_ns, delay_ns) in enumerate(self._spikes):
            period, at_ns = divmod(since_ns, period_ns)
            chance = self._impairment.spikes[number].chance
            is_in = 0 <= at_ns - start_ns < lasts_ns
            if is_in and self._draws.once(number, period) < chance:
                added_ns += delay_ns
        return added_ns

    def _is_lost_by_state(self) -> bool:
        change, chance = self._draws["state"](), self._draws["state_loss"]()
        model = self._impairment.gemodel
        if model is None:
            return False
        is_lost = chance < 1.0 - (model.h if self._is_bad else model.k)
        if change < (model.r if self._is_bad else model.p):
            self._is_bad = not self._is_bad
        return is_lost


class ComputationTime:
    """The time that each of a row of computations of an environment takes, in the words of a link.

    Those are ``delay``, ``jitter``, ``distribution``, ``correlation`` and ``trace``. Nothing else
    of an impairment makes sense here, since a computation is no packet.
    """

    def __init__(
        self, impairment: Impairment = PERFECT, seed: int = 0, trace: DelayTrace | None = None
    ) -> None:
        self._draws = Draws(seed)
        self._first_ns: int | None = None
        self.change(impairment, trace)

    def change(self, impairment: Impairment, trace: DelayTrace | None = None) -> None:
        """Let computations that begin from now on take the time of ``impairment``."""
        self._chances = Chances(impairment, self._draws, trace)
        is_fixed = trace is None and not impairment.jitter
        self._fixed_ns = round(impairment.delay * 1e9) if is_fixed else None

    def next_ns(self, time_ns: int) -> int | None:
        """Return how long the computation that begins now takes, in ns.

        None: it fails, by its trace, which begins with the first computation.
        """
        if self._first_ns is None:
            self._first_ns = time_ns
        if self._fixed_ns is not None:
            return self._fixed_ns
        return self._chances.travel_ns(time_ns - self._first_ns)
