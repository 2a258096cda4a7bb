"""Chances against their definitions: links that are run alone, and exact tests of what came out."""

import math
from collections.abc import Sequence
from heapq import heappop

from builders import MS, TimedPacket

from forcebound.network.impairment import Impairment
from forcebound.network.link import PACKET_SIZE, Link

SURELY_NOT = 1e-4  # a result less likely than this is a fault; the seeds are fixed


class EveryPacket(Link[TimedPacket]):
    """A link that also delivers packets that were overtaken, to see what happens to each."""

    def due(self, time_ns: int) -> list[TimedPacket]:
        packets = []
        while self._queue and self._queue[0][0] <= time_ns:
            packets.append(heappop(self._queue)[3])
        self.delivered += len(packets)
        return packets


def passed(
    impairment: Impairment,
    count: int,
    seed: int = 1,
    period_ns: int = MS,
    size: int = PACKET_SIZE,
) -> tuple[Link[TimedPacket], list[tuple[int, TimedPacket]]]:
    """Send one packet a period; return the link and what came out, in order, with its time."""
    link: Link[TimedPacket] = EveryPacket(impairment, seed)
    for seq in range(count):
        link.accept(seq * period_ns, TimedPacket(seq, seq * period_ns), size)
    deliveries = []
    while (due_ns := link.next_due_ns) is not None:
        deliveries += [(due_ns, packet) for packet in link.due(due_ns)]
    return link, deliveries


def delays(impairment: Impairment, count: int, seed: int = 1) -> list[int]:
    """The delay of each packet, in ns, in the order of sending."""
    _, deliveries = passed(impairment, count, seed)
    by_seq = sorted(deliveries, key=lambda delivery: delivery[1].seq)
    return [time_ns - packet.time_ns for time_ns, packet in by_seq]


def losses(impairment: Impairment, count: int, seed: int = 1) -> list[bool]:
    _, deliveries = passed(impairment, count, seed)
    arrived = {packet.seq for _, packet in deliveries}
    return [seq not in arrived for seq in range(count)]


def binomial_tail(count: int, probability: float, found: int) -> float:
    """P(|X - np| >= |found - np|) of X ~ binomial(n, p), exactly."""
    mean = count * probability
    log_p, log_q = math.log(probability), math.log1p(-probability)
    return math.fsum(
        math.exp(
            math.lgamma(count + 1)
            - math.lgamma(k + 1)
            - math.lgamma(count - k + 1)
            + k * log_p
            + (count - k) * log_q
        )
        for k in range(count + 1)
        if abs(k - mean) >= abs(found - mean) - 1e-9
    )


def is_likely(outcomes: Sequence[bool], probability: float) -> bool:
    return binomial_tail(len(outcomes), probability, sum(outcomes)) > SURELY_NOT


def distance_is_likely(sample: Sequence[float]) -> bool:
    """Whether a sample may be uniform on [0, 1].

    Dvoretzky, Kiefer, Wolfowitz, with Massart's constant: P(D > e) <= 2 exp(-2 n e^2) at any n.
    """
    count = len(sample)
    distance = max(max((i + 1) / count - x, x - i / count) for i, x in enumerate(sorted(sample)))
    return 2 * math.exp(-2 * count * distance**2) > SURELY_NOT
