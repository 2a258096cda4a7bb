"""What a link does to packets, in the words and with the meaning of Linux netem, and its chances.

:class:`Impairment` holds the parameters, :class:`Chances` draws what happens to each packet;
:class:`forcebound.network.link.Link` holds the queue.

Each random decision has a generator of its own, and every packet draws all its numbers: two
settings compared under one seed differ in nothing but the setting.

1. *Correlation* is netem's: ``u = (1 - rho) * new + rho * last`` of numbers uniform in [0, 1). As
   in netem, this narrows the distribution around 1/2 (variance times ``(1 - rho) / (1 + rho)``), so
   a correlated loss of 10 % loses less than 10 % (tc-netem(8) warns of it). ``gemodel`` does not.
2. The *deviation* of the delay is ``jitter * quantile(u)``. The quantiles are those of the tables
   that tc loads (iproute2 ``netem/normal.c``, ``pareto.c``, ``paretonormal.c``), without their
   4096 steps and, as there, within 4:

   ``uniform``
       ``2 u - 1``: jitter is the largest deviation.
   ``normal``
       jitter is the standard deviation.
   ``pareto``
       ``4/3 (X - 3/2)``, ``X`` Pareto with shape 3 from 1: mean 0, from -2/3. tc scales by the
       variance 3/4, so the standard deviation is ``2 / sqrt(3)`` times the jitter before the cut.
   ``paretonormal``
       ``(normal + 3 pareto) / 4`` of the same ``u``.

   A ``distribution_file`` is such a table: each of its entries is as likely as the others. The
   kernel takes the entry ``number % size``; here it is ``floor(u * size)`` of the sorted ones,
   which is as likely and keeps the correlation.

3. *Gilbert-Elliott*: the state in which a packet finds the link decides its loss, then the link
   changes its state. It begins good.
"""

import math
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from statistics import NormalDist
from typing import Annotated, Any, ClassVar, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from forcebound.errors import ConfigError
from forcebound.network.distribution import read_distribution
from forcebound.quantities import (
    NOT_NEGATIVE,
    PROBABILITY,
    DataRate,
    Range,
    Ratio,
    Time,
    check_ranges,
)

_DECISIONS = (  # one generator each, by place: append only
    *("loss", "jitter", "state", "state_loss"),
    *("duplicate", "reorder", "corrupt", "slot"),
)

_STRICT = {"extra": "forbid", "strict": True}  # pydantic: no unknown keys in a launch file


@dataclass(frozen=True)
class GilbertElliott:
    """Loss in bursts.

    Attributes:
        p: Probability of changing from the good to the bad state, at each packet.
        r: Probability of changing from the bad to the good state, at each packet.
        h: Probability that the bad state does *not* lose a packet; tc takes ``1-h``.
        k: Probability that the good state does not lose a packet; tc takes ``1-k``.
    """

    p: Annotated[Ratio, PROBABILITY]
    r: Annotated[Ratio, PROBABILITY]
    h: Annotated[Ratio, PROBABILITY] = 0.0
    k: Annotated[Ratio, PROBABILITY] = 1.0

    __pydantic_config__: ClassVar[Any] = _STRICT

    def __post_init__(self) -> None:
        check_ranges(self)


@dataclass(frozen=True)
class Slot:
    """Delivery in bundles, as of a radio that gets the medium now and then.

    A packet that is through after the last slot waits for a new one, ``min_delay`` to ``max_delay``
    (uniform) later; whatever is through until then goes with it.

    Attributes:
        min_delay: Shortest time until the slot, in s.
        max_delay: Longest, in s; None: ``min_delay``.
        packets: How many go in one slot, the rest in the next one; 0: all.
    """

    min_delay: Annotated[Time, NOT_NEGATIVE]
    max_delay: Time | None = None
    packets: Annotated[int, NOT_NEGATIVE] = 0

    __pydantic_config__: ClassVar[Any] = _STRICT

    def __post_init__(self) -> None:
        check_ranges(self)
        if self.max_delay is not None and not self.min_delay <= self.max_delay < math.inf:
            message = f"max_delay must be at least min_delay, got {self.max_delay} s"
            raise ConfigError(message, field="max_delay")


@dataclass(frozen=True)
class Outage:
    """A time in which every packet that arrives is lost, counted from the link's first packet."""

    start: Annotated[Time, NOT_NEGATIVE]
    duration: Annotated[Time, NOT_NEGATIVE]

    __pydantic_config__: ClassVar[Any] = _STRICT

    def __post_init__(self) -> None:
        check_ranges(self)


@dataclass(frozen=True)
class Impairment:
    """What a link does to packets; the default is a perfect link.

    Attributes:
        delay: Time on the way, in s, at least 0.
        jitter: Scale of the deviation from ``delay``, in s, at least 0. May exceed ``delay``: a
            packet that would be through before it arrives is through when it arrives.
        loss: Probability of a packet being lost, 0 to 1.
        distribution: Of the deviation; see the head of this module.
        distribution_file: Table of the deviation instead, in the format of tc's ``.dist`` files.
        trace: File of recorded delays, instead of ``delay`` and ``jitter``; whoever builds the link
            reads it (:class:`forcebound.network.trace.DelayTrace`).
        correlation: Of a delay with the one before, 0 to 1.
        loss_correlation: Of a loss with the one before.
        gemodel: Loss in bursts, instead of ``loss``.
        duplicate: Probability of a packet coming twice. The copy has its own chances.
        duplicate_correlation: Of duplications.
        corrupt: Probability of a packet being damaged. Packets are whole here, so a damaged one
            travels as any other and is thrown away on arrival, as by a checksum.
        corrupt_correlation: Of damages.
        reorder: Probability of a packet going at once, before those that are delayed.
        reorder_correlation: Of reorderings.
        gap: At least ``gap - 1`` packets are delayed before one may go at once.
        rate: Bytes/s that the link carries, one packet after the other; 0: any number.
        limit: How many packets are on the way at most, more are lost; 0: any number.
        slot: Delivery in bundles.
        outages: When the link is down.

    Raises:
        ConfigError: If a value is not finite or out of its range.

    Source: tc-netem(8), Linux net/sched/sch_netem.c.
    """

    delay: Annotated[Time, NOT_NEGATIVE] = 0.0
    jitter: Annotated[Time, NOT_NEGATIVE] = 0.0
    loss: Annotated[Ratio, PROBABILITY] = 0.0
    distribution: Literal["uniform", "normal", "pareto", "paretonormal"] = "uniform"
    correlation: Annotated[Ratio, PROBABILITY] = 0.0
    loss_correlation: Annotated[Ratio, PROBABILITY] = 0.0
    gemodel: GilbertElliott | None = None
    duplicate: Annotated[Ratio, PROBABILITY] = 0.0
    duplicate_correlation: Annotated[Ratio, PROBABILITY] = 0.0
    corrupt: Annotated[Ratio, PROBABILITY] = 0.0
    corrupt_correlation: Annotated[Ratio, PROBABILITY] = 0.0
    reorder: Annotated[Ratio, PROBABILITY] = 0.0
    reorder_correlation: Annotated[Ratio, PROBABILITY] = 0.0
    gap: Annotated[int, Range(at_least=1)] = 1
    rate: Annotated[DataRate, NOT_NEGATIVE] = 0.0
    limit: Annotated[int, NOT_NEGATIVE] = 0
    slot: Slot | None = None
    outages: tuple[Outage, ...] = ()
    distribution_file: Path | None = None
    trace: Path | None = None
    _table: tuple[float, ...] = field(default=(), init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        check_ranges(self)
        if self.gemodel is not None and self.loss > 0.0:
            raise ConfigError("gemodel excludes loss: give one of them", field="gemodel")
        if self.reorder > 0.0 and self.delay == 0.0 and self.trace is None:
            message = "reorder needs a delay: what goes at once overtakes what is delayed"
            raise ConfigError(message, field="reorder")
        object.__setattr__(self, "_table", check_delay(self))

    @property
    def is_plain(self) -> bool:
        """Whether there is nothing but delay, uniform jitter and independent loss."""
        return self == Impairment(self.delay, self.jitter, self.loss)

    @property
    def quantile(self) -> Callable[[float], float]:
        """The deviation, in jitters, of a number uniform in [0, 1)."""
        table = self._table
        if table:
            return lambda u: table[int(u * len(table))]
        return QUANTILES[self.distribution]

    @property
    def shortest(self) -> float:
        """The shortest time on the way, in s; of a ``trace``, which only its reader knows, 0."""
        if self.reorder > 0.0:
            return 0.0
        return max(0.0, self.delay + self.jitter * self.quantile(0.0))


_NORMAL = NormalDist()
_LARGEST = 4.0  # of a table's entries: 16 bits, of which 8192 are one jitter


def _uniform(u: float) -> float:
    return 2.0 * u - 1.0


def _normal(u: float) -> float:
    return max(-_LARGEST, min(_NORMAL.inv_cdf(u), _LARGEST)) if 0.0 < u < 1.0 else -_LARGEST


def _pareto(u: float) -> float:
    return float(min(4.0 / 3.0 * ((1.0 - u) ** (-1.0 / 3.0) - 1.5), _LARGEST))


def _paretonormal(u: float) -> float:
    return (_normal(u) + 3.0 * _pareto(u)) / 4.0


QUANTILES: Mapping[str, Callable[[float], float]] = {
    "uniform": _uniform,
    "normal": _normal,
    "pareto": _pareto,
    "paretonormal": _paretonormal,
}


class Fate(NamedTuple):
    """What chance does to one packet."""

    is_lost: bool
    is_duplicated: bool
    is_corrupt: bool
    goes_at_once: bool  # if the gap allows it
    delay_ns: int


class _Correlated:
    """Numbers in [0, 1), each drawn towards the one before."""

    def __init__(self, draw: Callable[[], float], rho: float) -> None:
        self._draw = draw
        self._rho = rho
        self._last: float | None = None

    def __call__(self) -> float:
        number = self._draw()
        if self._rho and self._last is not None:
            number = (1.0 - self._rho) * number + self._rho * self._last
        self._last = number
        return number


class Chances:
    """The random processes of one link under one impairment.

    Args:
        impairment: What the link does.
        draws: From :func:`generators`; the processes go on with them.
    """

    def __init__(self, impairment: Impairment, draws: Mapping[str, Callable[[], float]]) -> None:
        """Begin: the state is good, and there is no number before."""
        self._impairment = impairment
        self._delay_ns = round(impairment.delay * 1e9)
        self._jitter_ns = impairment.jitter * 1e9
        self._quantile = impairment.quantile
        self._loss = _Correlated(draws["loss"], impairment.loss_correlation)
        self._jitter = _Correlated(draws["jitter"], impairment.correlation)
        self._duplicate = _Correlated(draws["duplicate"], impairment.duplicate_correlation)
        self._reorder = _Correlated(draws["reorder"], impairment.reorder_correlation)
        self._corrupt = _Correlated(draws["corrupt"], impairment.corrupt_correlation)
        self._state, self._state_loss = draws["state"], draws["state_loss"]
        self._slot = draws["slot"]
        self._is_bad = False

    def next(self) -> Fate:
        """Return the fate of the next packet."""
        impairment = self._impairment
        deviation = self._jitter_ns * self._quantile(self._jitter())
        is_lost = self._loss() < impairment.loss
        return Fate(
            self._is_lost_by_state() or is_lost,
            self._duplicate() < impairment.duplicate,
            self._corrupt() < impairment.corrupt,
            self._reorder() < impairment.reorder,
            max(0, self._delay_ns + round(deviation)),
        )

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


def generators(
    seed: int, decisions: Collection[str] = _DECISIONS, *, is_copy: bool = False
) -> dict[str, Callable[[], float]]:
    """Return what draws the numbers, uniform in [0, 1), of each decision.

    Args:
        seed: As given to :class:`~forcebound.network.link.Link`.
        decisions: Which ones.
        is_copy: For the copies of duplicated packets, which have numbers of their own.
    """
    return {
        decision: _bits(seed, _DECISIONS.index(decision), is_copy).random for decision in decisions
    }


def uniform_numbers(seed: int, decision: str, count: int) -> NDArray[np.float64]:
    """Return the first ``count`` numbers that a link of this seed draws for a decision.

    Args:
        seed: As given to :class:`~forcebound.network.link.Link`.
        decision: ``"loss"`` or ``"jitter"``.
        count: How many.
    """
    return _bits(seed, _DECISIONS.index(decision)).random(count)


def _bits(seed: int, place: int, is_copy: bool = False) -> np.random.Generator:
    words = [seed, place, 1] if is_copy else [seed, place]
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence(words)))


def check_delay(settings: Any, prefix: str = "") -> tuple[float, ...]:
    """Check the settings that say how long something takes; return the table of their file.

    Args:
        settings: Has ``delay``, ``jitter``, ``distribution``, ``correlation``,
            ``distribution_file`` and ``trace`` of :class:`Impairment`.
        prefix: Before each of these names.

    Returns:
        Of :func:`~forcebound.network.distribution.read_distribution`; empty if there is no file.

    Raises:
        ConfigError: If they are wrong or do not go together.
    """

    def value(name: str) -> Any:
        return getattr(settings, prefix + name)

    distribution, file = value("distribution"), value("distribution_file")
    if distribution not in QUANTILES:
        raise ConfigError(
            f"{prefix}distribution must be one of {', '.join(QUANTILES)}, got {distribution!r}",
            field=f"{prefix}distribution",
        )
    if file is not None and distribution != "uniform":
        raise ConfigError(
            f"{prefix}distribution_file excludes {prefix}distribution: give one of them",
            field=f"{prefix}distribution_file",
        )
    if value("trace") is not None and (value("delay") or value("jitter") or file is not None):
        raise ConfigError(
            f"{prefix}trace says what each delay is:"
            f" give it without {prefix}delay, {prefix}jitter and {prefix}distribution_file",
            field=f"{prefix}trace",
        )
    if file is None:
        return ()
    try:
        return read_distribution(Path(file))
    except ConfigError as error:
        name = f"{prefix}distribution_file"
        raise ConfigError(f"{name}: {error}", field=name) from None
