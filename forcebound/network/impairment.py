"""Settings of a bad link, in the words and with the meaning of Linux netem.

:mod:`forcebound.network.chances` draws what happens to each packet,
:class:`forcebound.network.link.Link` holds the packets on the way.

The deviation of a delay is ``jitter * quantile(u)`` of a number ``u``, uniform in [0, 1). The
quantiles are those of the tables that tc loads (iproute2 ``netem/*.c``), without their 4096 steps
and, as there, within 4.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from statistics import NormalDist
from typing import Annotated, Final, Literal

from forcebound.errors import ConfigError
from forcebound.files import RECORDING_SUFFIX
from forcebound.network.trace import MAHIMAHI, TABLE
from forcebound.quantities import (
    NOT_NEGATIVE,
    POSITIVE,
    PROBABILITY,
    DataRate,
    Range,
    Ranged,
    Ratio,
    Time,
    check_ranges,
)

LOOP: Final = "loop"  # all four hops, instead of one
_NORMAL = NormalDist()
_LARGEST = 4.0  # jitters: an entry of a table has 16 bits, of which 8192 are one jitter


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


@dataclass(frozen=True)
class GilbertElliott(Ranged):
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


@dataclass(frozen=True)
class Outage(Ranged):
    """A time in which every packet that arrives is lost.

    Counted from the first packet that the link gets after the outages were set.

    Attributes:
        start: Of the outage.
        duration: Of the outage.
    """

    start: Annotated[Time, NOT_NEGATIVE]
    duration: Annotated[Time, NOT_NEGATIVE]


@dataclass(frozen=True)
class Spike(Ranged):
    """A time in each period in which packets take longer; netem has no such word.

    Counted from the first packet of the link.

    Attributes:
        period: From one to the next.
        start: Of the spike in its period.
        duration: Of the spike.
        delay: Added to that of each packet that arrives in the spike.
        chance: Of a period having the spike.

    Raises:
        ConfigError: If the spike does not end with its period.
    """

    period: Annotated[Time, Range(at_least=0.001)]
    duration: Annotated[Time, NOT_NEGATIVE]
    delay: Annotated[Time, NOT_NEGATIVE]
    start: Annotated[Time, NOT_NEGATIVE] = 0.0
    chance: Annotated[Ratio, PROBABILITY] = 1.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.start + self.duration > self.period:
            end = f"{self.start + self.duration:g} s, after its period of {self.period:g} s"
            raise ConfigError(f"the spike ends at {end}: split it in two", field="duration")


@dataclass(frozen=True)
class Impairment:
    """Impairment of packets by a link; the default is a perfect link.

    Attributes:
        delay: Time on the way, in s, at least 0.
        jitter: Scale of the deviation from ``delay``, in s, at least 0. May exceed ``delay``: a
            packet that would be through before it arrives is through when it arrives.
        loss: Probability of a packet being lost, 0 to 1.
        distribution: Of the deviation; docs/impairments.md has the shapes.
        trace: File of recorded delays, instead of ``delay`` and ``jitter``.
        trace_format: Of that file: with a header that names its columns; without one, with a
            delay, or a time and a delay, in a line, in this unit; or mahimahi's times in ms at
            which a packet can go, to which ``delay`` is added.
        trace_interval: Between the delays of a file that has one number in a line.
        trace_hop: Where a recording that ``trace`` names has these delays: on one link, or all
            around the loop.
        correlation: Of a delay with the one before, 0 to 1.
        gemodel: Loss in bursts, instead of ``loss``.
        duplicate: Probability of a packet coming twice. The copy has separate chances.
        corrupt: Probability of a packet being damaged. Packets are whole here, so a damaged one
            travels as any other and is thrown away on arrival, as by a checksum.
        reorder: Probability of a packet going at once, before those that are delayed.
        rate: Bytes/s that the link carries, one packet after the other, at least 1; 0: any number.
        limit: How many packets are on the way at most, more are lost; 0: any number.
        outages: When the link is down.
        spikes: When packets take longer.
        deadband: Weber fraction: a packet is not sent while its force (of a state or query: its
            velocity) differs from that of the last one sent by at most this share of it; 0: all
            are sent.
        keep_alive: Time after which a link with a deadband sends a packet in any case.

    Raises:
        ConfigError: If a value is not finite or out of its range.

    Source: tc-netem(8), Linux net/sched/sch_netem.c.
    """

    delay: Annotated[Time, NOT_NEGATIVE] = 0.0
    jitter: Annotated[Time, NOT_NEGATIVE] = 0.0
    loss: Annotated[Ratio, PROBABILITY] = 0.0
    distribution: Literal["uniform", "normal", "pareto", "paretonormal"] = "uniform"
    correlation: Annotated[Ratio, PROBABILITY] = 0.0
    gemodel: GilbertElliott | None = None
    duplicate: Annotated[Ratio, PROBABILITY] = 0.0
    corrupt: Annotated[Ratio, PROBABILITY] = 0.0
    reorder: Annotated[Ratio, PROBABILITY] = 0.0
    rate: Annotated[DataRate, NOT_NEGATIVE] = 0.0
    limit: Annotated[int, NOT_NEGATIVE] = 0
    outages: tuple[Outage, ...] = ()
    spikes: tuple[Spike, ...] = ()
    deadband: Annotated[Ratio, Range(at_least=0, below=1)] = 0.0
    keep_alive: Annotated[Time, Range(above=0, at_most=0.05)] = 0.02
    trace: Path | None = None
    trace_format: Literal["table", "s", "ms", "mahimahi"] = TABLE
    trace_interval: Annotated[Time, POSITIVE] = 0.001
    trace_hop: Literal[
        "loop", "device_state", "environment_query", "environment_reply", "force_command"
    ] = LOOP

    def __post_init__(self) -> None:
        check_ranges(self)
        if 0.0 < self.rate < 1.0:
            message = f"rate must be 0, for any number, or at least 1 B/s, got {self.rate:g} B/s"
            raise ConfigError(message, field="rate")
        if self.gemodel is not None and self.loss > 0.0:
            raise ConfigError("gemodel excludes loss: give one of them", field="gemodel")
        if self.reorder > 0.0 and self.delay == 0.0 and self.trace is None:
            message = "reorder needs a delay: a packet that goes at once overtakes delayed ones"
            raise ConfigError(message, field="reorder")
        if self.trace_hop != LOOP and (self.trace is None or self.trace.suffix != RECORDING_SUFFIX):
            message = f"trace_hop {self.trace_hop} is a link in a recording: give trace: RUN.mcap"
            raise ConfigError(message, field="trace_hop")
        if self.trace_format != TABLE and (
            self.trace is None or self.trace.suffix == RECORDING_SUFFIX
        ):
            message = f"trace_format {self.trace_format} is of a text file: give trace: FILE"
            raise ConfigError(message, field="trace_format")
        if self.distribution not in QUANTILES:
            message = (
                f"distribution must be one of {', '.join(QUANTILES)}, got {self.distribution!r}"
            )
            raise ConfigError(message, field="distribution")
        has_delay = self.delay and self.trace_format != MAHIMAHI
        if self.trace is not None and (has_delay or self.jitter):
            message = "trace sets each delay: give it without delay and jitter"
            raise ConfigError(message, field="trace")

    @property
    def reorders(self) -> bool:
        """True if packets may overtake others or come twice, so that some are rejected."""
        return bool(self.jitter or self.reorder or self.duplicate or self.trace)

    @property
    def is_plain(self) -> bool:
        """True if there is nothing but delay, uniform jitter and independent loss."""
        return self == Impairment(self.delay, self.jitter, self.loss)

    @property
    def quantile(self) -> Callable[[float], float]:
        """The deviation, in jitters, of a number uniform in [0, 1)."""
        return QUANTILES[self.distribution]

    @property
    def shortest(self) -> float:
        """The shortest time on the way, in s; that of a ``trace`` only its reader knows."""
        if self.reorder > 0.0:
            return 0.0
        return max(0.0, self.delay + self.jitter * self.quantile(0.0))


PERFECT = Impairment()
