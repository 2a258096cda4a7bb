"""Settings of a bad link, in the words and with the meaning of Linux netem.

:mod:`forcebound.network.chances` draws what happens to each packet,
:class:`forcebound.network.link.Link` holds the packets on the way, and
:mod:`forcebound.network.distribution` has the distributions of a delay.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Final, Literal

from forcebound.errors import ConfigError
from forcebound.files import RECORDING_SUFFIX
from forcebound.network.distribution import QUANTILES, read_distribution
from forcebound.quantities import (
    NOT_NEGATIVE,
    PROBABILITY,
    DataRate,
    Range,
    Ratio,
    Time,
    check_ranges,
)

LOOP: Final = "loop"  # all four hops, instead of one


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

    def __post_init__(self) -> None:
        check_ranges(self)


@dataclass(frozen=True)
class Slot:
    """Delivery in bundles, as by a radio that gets the medium only now and then.

    A packet that is through after the last slot waits for a new one, ``min_delay`` to ``max_delay``
    (uniform) later; all packets that are through until then go with it.

    Attributes:
        min_delay: Shortest time until the slot.
        max_delay: Longest; null: ``min_delay``.
        packets: How many go in one slot, the rest in the next one; 0: all.
    """

    min_delay: Annotated[Time, NOT_NEGATIVE]
    max_delay: Time | None = None
    packets: Annotated[int, NOT_NEGATIVE] = 0

    def __post_init__(self) -> None:
        check_ranges(self)
        if self.max_delay is not None and not self.min_delay <= self.max_delay < math.inf:
            message = f"max_delay must be at least min_delay, got {self.max_delay} s"
            raise ConfigError(message, field="max_delay")


@dataclass(frozen=True)
class Outage:
    """A time in which every packet that arrives is lost.

    Counted from the first packet that the link gets after the outages were set.
    """

    start: Annotated[Time, NOT_NEGATIVE]
    duration: Annotated[Time, NOT_NEGATIVE]

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
        distribution: Of the deviation; docs/impairments.md has the shapes.
        distribution_file: Table of the deviation instead, in the format of tc's ``.dist`` files.
        trace: File of recorded delays, instead of ``delay`` and ``jitter``.
        trace_hop: Where a recording that ``trace`` names has these delays: on one link, or all
            around the loop.
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
    trace_hop: Literal[
        "loop", "device_state", "environment_query", "environment_reply", "force_command"
    ] = LOOP
    _table: tuple[float, ...] = field(default=(), init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        check_ranges(self)
        if self.gemodel is not None and self.loss > 0.0:
            raise ConfigError("gemodel excludes loss: give one of them", field="gemodel")
        if self.reorder > 0.0 and self.delay == 0.0 and self.trace is None:
            message = "reorder needs a delay: a packet that goes at once overtakes delayed ones"
            raise ConfigError(message, field="reorder")
        if self.trace_hop != LOOP and (self.trace is None or self.trace.suffix != RECORDING_SUFFIX):
            message = f"trace_hop {self.trace_hop} is a link in a recording: give trace: RUN.mcap"
            raise ConfigError(message, field="trace_hop")
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


def check_delay(settings: Any, prefix: str = "") -> tuple[float, ...]:
    """Check the settings of a delay, with a prefix; return the table of their file, if any.

    ``settings`` has ``delay``, ``jitter``, ``distribution``, ``distribution_file`` and ``trace`` of
    :class:`Impairment`. ConfigError if they are wrong or do not go together.
    """
    names = ("delay", "jitter", "distribution", "distribution_file", "trace")
    delay, jitter, distribution, file, trace = (getattr(settings, prefix + n) for n in names)
    if distribution not in QUANTILES:
        raise ConfigError(
            f"{prefix}distribution must be one of {', '.join(QUANTILES)}, got {distribution!r}",
            field=f"{prefix}distribution",
        )
    file_name = f"{prefix}distribution_file"
    if file is not None and distribution != "uniform":
        message = f"{file_name} excludes {prefix}distribution: give one of them"
        raise ConfigError(message, field=file_name)
    if trace is not None and (delay or jitter or file is not None):
        raise ConfigError(
            f"{prefix}trace sets each delay:"
            f" give it without {prefix}delay, {prefix}jitter and {file_name}",
            field=f"{prefix}trace",
        )
    try:
        return () if file is None else read_distribution(Path(file))
    except ConfigError as error:
        raise ConfigError(f"{file_name}: {error}", field=file_name) from None


PERFECT = Impairment()
