"""What a bad network does to packets: a pure, seeded model of one link.

A link knows no clock and no socket. The receiving runner, live or in virtual time, hands it every
packet that arrives with the time (:meth:`Link.accept`), and asks which packets are through
(:meth:`Link.due`) and when the next one will be (:attr:`Link.next_due_ns`). The same seed and the
same arrivals give the same deliveries, whoever asks and however often.

The words and their meaning are those of Linux netem:

1. A packet is lost with probability ``loss``, independently of all others.
2. One that is not lost is through at ``arrival + delay + jitter * u``, with ``u`` uniform in
   [-1, 1), drawn anew for each packet, but never before its arrival. So jitter reorders packets.
3. Packets come out by that time; equal times, in the order in which they arrived.

Each random decision (lost or not; how late) has a generator of its own, so that a link with loss
delays the packets that survive exactly as the link without loss does, packet by packet: two
settings compared under one seed differ in nothing but the setting.

To add an impairment: a field with its check in :class:`Impairment`, a generator of its own at the
*end* of ``_DECISIONS``, and one step in ``Link._fate``. What it does must hold the sum of the
counters (:class:`Link`).

Newest wins
-----------

A consumer that wants the newest value (``newest_only``) gets, of the packets that are through,
only the newest, and never one that is older than what it got before. The others are counted as
superseded. So neither a pause of the consumer nor jitter ever brings it a stale packet.

Which of two packets is newer is decided by the *origin*: the device state that a packet answers
(``device_time_ns``, ``device_seq``), or the packet itself if it answers nothing (``time_ns``,
``seq``). The answerer's own ``seq`` decides between two answers to one state. While a sender lives,
stamp and sequence number rise together and either would do. The stamp comes first because of
restarts:

* A *process* that starts again on the same machine counts from 0, but its monotonic clock goes on:
  its first packet is newer by its stamp and passes at once.
* A *machine* that starts again, or a microcontroller, also sets its clock back. Packets that arrive
  stamped more than ``RESTART_NS`` before the newest arrival begin a new life of the sender, newer
  than everything before. A clock set back by less is refused until it has caught up, so for at
  most ``RESTART_NS``, and never for ever.

The test is made in the order of arrival, before this link delays anything, so its own jitter,
however large, is never taken for a restart. It keeps order, not age: how old a force may be is
checked by the device node (age limit).
"""

import hashlib
import math
from collections.abc import Callable
from dataclasses import dataclass
from heapq import heappop, heappush
from typing import Generic, Protocol, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from forcebound.errors import ConfigError
from forcebound.quantities import Ratio, Time

RESTART_NS = 1_000_000_000  # 1 s: ten times the usual age limit of a force, far below an uptime

_DECISIONS = ("loss", "jitter")  # one generator each, by place: append only


@dataclass(frozen=True)
class Impairment:
    """What a link does to packets; the default is a perfect link.

    Attributes:
        delay: Time on the way, in s, at least 0.
        jitter: Largest deviation from ``delay``, in s, at least 0; uniform. May exceed ``delay``:
            a packet that would be through before it arrives is through when it arrives.
        loss: Probability of a packet being lost, 0 to 1.

    Raises:
        ConfigError: If a value is not finite or out of its range.

    Source: tc-netem(8).
    """

    delay: Time = 0.0
    jitter: Time = 0.0
    loss: Ratio = 0.0

    def __post_init__(self) -> None:
        for name in ("delay", "jitter"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0.0):
                raise ConfigError(f"{name} must be finite and >= 0 s, got {value} s")
        if not 0.0 <= self.loss <= 1.0:
            raise ConfigError(f"loss must be a probability, 0 to 1 without unit, got {self.loss}")


class Stamped(Protocol):
    """What a link needs to know of a packet; answers also have ``device_seq, device_time_ns``."""

    @property
    def seq(self) -> int:
        """Counts from 0 at the sender."""
        ...

    @property
    def time_ns(self) -> int:
        """Sender's monotonic clock, in ns."""
        ...


PacketT = TypeVar("PacketT", bound=Stamped)

_Rank: TypeAlias = tuple[
    int, int, int, int
]  # life, stamp of the origin, its seq, seq: newer > older

_OLDEST: _Rank = (-1, 0, 0, 0)


def link_seed(seed: int, topic: str) -> int:
    """Return the seed of the link of ``topic`` in a graph with ``seed``.

    Links of one graph are independent of each other, and a link keeps its seed when others are
    added or renamed.
    """
    digest = hashlib.blake2b(f"{seed}/{topic}".encode(), digest_size=16).digest()
    return int.from_bytes(digest, "big")


class Link(Generic[PacketT]):
    """One link of the graph, on its receiving side; see the page at the head of this module.

    At any time ``sent == lost + delivered + superseded + queued``.

    Attributes:
        newest_only: Whether only the newest packet is delivered.
        sent: Packets that :meth:`accept` got.
        lost: Packets that the impairment lost.
        delivered: Packets that :meth:`due` returned.
        superseded: Packets that were through, but older than one delivered.
    """

    def __init__(self, impairment: Impairment, seed: int, newest_only: bool) -> None:
        """Make an empty link.

        Args:
            impairment: What the link does to packets.
            seed: At least 0; see :func:`link_seed`.
            newest_only: Deliver only the newest of the packets that are through.
        """
        self.newest_only = newest_only
        self.sent = 0
        self.lost = 0
        self.delivered = 0
        self.superseded = 0
        self._queue: list[tuple[int, int, _Rank, PacketT]] = []  # heap: through at, number, ...
        self._life = 0
        self._newest_ns = -1
        self._delivered_rank = _OLDEST
        self._random_loss, self._random_jitter = (
            _generator(seed, place) for place in range(len(_DECISIONS))
        )
        self.change(impairment)

    def change(self, impairment: Impairment) -> None:
        """Impair packets that arrive from now on by ``impairment``; those on the way stay."""
        self._delay_ns = round(impairment.delay * 1e9)
        self._jitter_ns = impairment.jitter * 1e9
        self._loss = impairment.loss
        self._is_perfect = impairment == Impairment()

    @property
    def queued(self) -> int:
        """How many packets are on the way."""
        return len(self._queue)

    @property
    def next_due_ns(self) -> int | None:
        """When the next packet on the way is through, in ns; None if there is none."""
        return self._queue[0][0] if self._queue else None

    def accept(self, time_ns: int, packet: PacketT) -> None:
        """Take ``packet``, which arrives at ``time_ns`` on the receiver's clock, in ns."""
        self.sent += 1
        if not self._is_perfect:
            fate = self._fate()
            if fate is None:
                self.lost += 1
                return
            time_ns += fate
        rank = self._rank(packet) if self.newest_only else _OLDEST
        heappush(self._queue, (time_ns, self.sent, rank, packet))

    def due(self, time_ns: int) -> list[PacketT]:
        """Return the packets that are through at ``time_ns``, in ns, in the order of delivery."""
        queue = self._queue
        if not queue or queue[0][0] > time_ns:
            return []
        if self.newest_only:
            return self._newest_due(time_ns)
        packets = []
        while queue and queue[0][0] <= time_ns:
            packets.append(heappop(queue)[3])
        self.delivered += len(packets)
        return packets

    def _newest_due(self, time_ns: int) -> list[PacketT]:
        queue = self._queue
        _, _, newest, packet = heappop(queue)
        while queue and queue[0][0] <= time_ns:
            _, _, rank, other = heappop(queue)
            self.superseded += 1
            if rank > newest:
                newest, packet = rank, other
        if newest <= self._delivered_rank:
            self.superseded += 1
            return []
        self._delivered_rank = newest
        self.delivered += 1
        return [packet]

    def _fate(self) -> int | None:
        """Return how long the next packet is on its way, in ns; None if it is lost."""
        # Every packet draws all its numbers, so that packet k has the same ones in any setting.
        lost = self._random_loss() < self._loss
        deviation = self._jitter_ns * (2.0 * self._random_jitter() - 1.0)
        return None if lost else max(0, self._delay_ns + round(deviation))

    def _rank(self, packet: PacketT) -> _Rank:
        stamp: int | None = getattr(packet, "device_time_ns", None)
        if stamp is None:
            stamp = packet.time_ns
            origin_seq = packet.seq
        else:
            origin_seq = packet.device_seq  # type: ignore[attr-defined]  # comes with the stamp
        if stamp > self._newest_ns:
            self._newest_ns = stamp
        elif stamp < self._newest_ns - RESTART_NS:
            self._newest_ns = stamp
            self._life += 1
        return (self._life, stamp, origin_seq, packet.seq)


def uniform_numbers(seed: int, decision: str, count: int) -> NDArray[np.float64]:
    """Return the first ``count`` numbers that a link of this seed draws for a decision.

    Args:
        seed: As given to :class:`Link`.
        decision: ``"loss"`` or ``"jitter"``.
        count: How many.
    """
    return _bits(seed, _DECISIONS.index(decision)).random(count)


def _generator(seed: int, place: int) -> Callable[[], float]:
    """Return the generator of one decision: numbers uniform in [0, 1)."""
    return _bits(seed, place).random


def _bits(seed: int, place: int) -> np.random.Generator:
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence([seed, place])))
