"""A link of a bad network: a pure, seeded model of what happens to packets.

A link knows no clock and no socket. The receiving runner, live or in virtual time, hands it every
packet that arrives with the time (:meth:`Link.accept`), and asks which packets are through
(:meth:`Link.due`) and when the next one will be (:attr:`Link.next_due_ns`). The same seed and the
same arrivals give the same deliveries, however often one asks.

A deadband, which is the sender's, comes first: what it holds back is not on the link.

The words and their meaning are those of Linux netem (``docs/impairments.md``), in this order:
duplicated or lost, lost beyond the limit, delayed or sent at once, sent at a rate, thrown away as
corrupt. Where netem decides on delivery, as for the queue's length, this model decides when
the packet arrives.

*Newest wins*: the receiver gets, of the packets that are through, only the newest, and never one
that is older than what it got before; the others are superseded. Which of two packets is newer is
decided by the *origin*: the device state that a packet answers, or the packet itself if it answers
nothing; the answerer's ``seq`` decides between two answers to one state. The stamp comes before
the sequence number because of restarts: a *process* that starts again counts from 0, but its clock
goes on, so its first packet passes at once. A *machine* also sets its clock back: packets that
arrive stamped more than ``RESTART_NS`` before the newest begin a new life of the sender, newer than
everything before; a clock set back by less is refused until it has caught up. The test is made in
the order of arrival, before this link delays anything. It keeps order, not age: how old a force may
be is checked by the device node.
"""

import hashlib
from heapq import heappop, heappush
from typing import Generic, Protocol, TypeAlias, TypeVar

from forcebound.network.chances import Chances, Draws, Fate
from forcebound.network.deadband import Deadband
from forcebound.network.impairment import PERFECT, Impairment
from forcebound.network.trace import DelayTrace

RESTART_NS = 1_000_000_000  # 1 s: ten times the usual age limit of a force, far below an uptime

PACKET_SIZE = 128  # bytes, about what a packet of one axis takes on the wire


class Stamped(Protocol):
    """The stamps of a packet; answers also have ``device_seq, device_time_ns``."""

    @property
    def seq(self) -> int:
        """Counts from 0 at the sender."""
        ...

    @property
    def time_ns(self) -> int:
        """Sender's monotonic clock, in ns."""
        ...


PacketT = TypeVar("PacketT", bound=Stamped)

_Rank: TypeAlias = tuple[int, int, int, int]  # life, stamp and seq of the origin, seq

_OLDEST: _Rank = (-1, 0, 0, 0)
_FATES = ("sent", "duplicated", "lost", "corrupted", "delivered", "superseded", "queued", "saved")


def link_seed(seed: int, topic: str) -> int:
    """Return the seed of the link of ``topic`` in a graph with ``seed``.

    Links of one graph are independent of each other, and a link keeps its seed when others are
    added or renamed.
    """
    digest = hashlib.blake2b(f"{seed}/{topic}".encode(), digest_size=16).digest()
    return int.from_bytes(digest, "big")


class Link(Generic[PacketT]):
    """One link of the graph, on its receiving side; see the head of this module.

    A packet within the deadband counts as ``saved`` and has no other fate. At any time ``sent +
    duplicated == lost + corrupted + delivered + superseded + queued``.
    """

    def __init__(self, impairment: Impairment, seed: int, trace: DelayTrace | None = None) -> None:
        """Make an empty link; ``seed`` is at least 0, for the others see :meth:`change`."""
        self.sent = 0  # packets that accept got, but for those saved
        self.duplicated = 0
        self.lost = 0  # copies too
        self.corrupted = 0  # they arrived damaged and were thrown away
        self.delivered = 0  # packets that due returned
        self.superseded = 0  # through, but older than one delivered
        self.saved = 0  # packets within the deadband, which are not sent
        self._queue: list[tuple[int, int, _Rank, PacketT]] = []  # heap: through at, number, ...
        self._life = 0
        self._newest_ns = -1
        self._delivered_rank = _OLDEST
        self._number = 0  # of packets put on the way, for equal times
        self._first_ns: int | None = None
        self._outages: list[tuple[int, int]] = []  # start and end, in ns since the time below
        self._outages_ns: int | None = None  # arrival of the first packet after they were set
        self._tail_ns = 0  # when the last packet that the rate held is through
        self._ahead: list[int] = []  # heap: when what counts for the limit is through
        self._draws, self._copy_draws = Draws(seed), Draws(seed, is_copy=True)
        self.change(impairment, trace)

    def change(self, impairment: Impairment, trace: DelayTrace | None = None) -> None:
        """Impair packets that arrive from now on; packets on the way do not change.

        The ``trace`` is the content of the file ``impairment.trace``; its time counts from the
        first packet. ValueError if it is named and not given.
        """
        self._chances = Chances(impairment, self._draws, trace)
        self._impairment = impairment
        self._is_perfect = impairment == PERFECT
        share = impairment.deadband
        self._deadband = Deadband(share, impairment.keep_alive) if share else None
        self._is_plain = impairment.is_plain and trace is None
        outages = [
            (round(outage.start * 1e9), round((outage.start + outage.duration) * 1e9))
            for outage in impairment.outages
        ]
        if outages != self._outages:  # a later outage must not lie in the past
            self._outages, self._outages_ns = outages, None
        if self._is_plain:
            return
        self._copy_chances = Chances(impairment, self._copy_draws, trace)
        self._ahead = sorted(entry[0] for entry in self._queue)  # a sorted list is a heap

    @property
    def counts(self) -> dict[str, int]:
        """Numbers of packets by fate."""
        return {fate: getattr(self, fate) for fate in _FATES}

    @property
    def has_rate(self) -> bool:
        """True if the size of a packet matters."""
        return self._impairment.rate > 0.0

    @property
    def queued(self) -> int:
        """Number of packets on the way."""
        return len(self._queue)

    @property
    def next_due_ns(self) -> int | None:
        """Time when the next packet on the way is through, in ns; None if there is none."""
        return self._queue[0][0] if self._queue else None

    def accept(self, time_ns: int, packet: PacketT, size: int = PACKET_SIZE) -> None:
        """Take a packet that arrives at ``time_ns``, on the receiver's clock, in ns.

        Its ``size`` on the wire, in bytes, matters where :attr:`has_rate`.
        """
        if self._first_ns is None:
            self._first_ns = time_ns
        if self._deadband is not None and self._deadband.saves(time_ns, packet):
            self.saved += 1
            return
        self.sent += 1
        if not self._is_plain:
            self._impair(time_ns, packet, size)
            return
        if not self._is_perfect:
            travel_ns = self._chances.next_plain()
            if travel_ns is None:
                self.lost += 1
                return
            time_ns += travel_ns
        rank = self._rank(packet)
        self._number += 1
        heappush(self._queue, (time_ns, self._number, rank, packet))

    def due(self, time_ns: int) -> list[PacketT]:
        """Return the newest packet that is through at ``time_ns``, in ns; empty if there is none.

        A packet that is older than one delivered before is superseded.
        """
        queue = self._queue
        if not queue or queue[0][0] > time_ns:
            return []
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

    def _impair(self, time_ns: int, packet: PacketT, size: int) -> None:
        """Apply every impairment of netem to a packet."""
        since_ns = time_ns - (self._first_ns or 0)
        fate, copy_fate = self._chances.next(since_ns), self._copy_chances.next(since_ns)
        if self._outages_ns is None:
            self._outages_ns = time_ns
        since_ns = time_ns - self._outages_ns
        is_out = any(start <= since_ns < end for start, end in self._outages)
        if is_out or fate.delay_ns is None:
            self.lost += 1
            return
        rank = self._rank(packet)
        if fate.is_duplicated:
            self.duplicated += 1
        if fate.is_lost:
            self.lost += 1
            if not fate.is_duplicated:
                return
        self._send(time_ns, packet, size, rank, fate)
        if fate.is_duplicated and not fate.is_lost:
            if copy_fate.is_lost:
                self.lost += 1
            else:
                self._send(time_ns, packet, size, rank, copy_fate)

    def _send(self, time_ns: int, packet: PacketT, size: int, rank: _Rank, fate: Fate) -> None:
        """Put a packet that is not lost on its way."""
        limit, rate = self._impairment.limit, self._impairment.rate
        if limit:
            while self._ahead and self._ahead[0] <= time_ns:
                heappop(self._ahead)
            if len(self._ahead) >= limit:
                self.lost += 1
                return
        through_ns = time_ns
        if not fate.goes_at_once:
            through_ns += fate.delay_ns or 0
            if rate:
                through_ns = max(through_ns, self._tail_ns) + round(size * 1e9 / rate)
                self._tail_ns = through_ns
        if limit:
            heappush(self._ahead, through_ns)
        if fate.is_corrupt:
            self.corrupted += 1
            return
        self._number += 1
        heappush(self._queue, (through_ns, self._number, rank, packet))

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
