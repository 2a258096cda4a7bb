"""Hops of a tick: its way through the graph, link by link."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from typing import TYPE_CHECKING

from forcebound.messages.packets import (
    TOPIC_OF,
    EnvironmentQuery,
    EnvironmentReply,
    ForceCommand,
    Packet,
    Telemetry,
)
from forcebound.messages.topology import LINKS

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

_ANSWERS = (EnvironmentQuery, EnvironmentReply, ForceCommand, Telemetry)
HOPS = (*LINKS, TOPIC_OF[Telemetry])  # topics, in the order in which a tick goes through them


@dataclass(frozen=True)
class Hops:
    """When the packets of each tick were sent.

    A link's delay goes from the sending of its packet until its receiver has sent what it made of
    it. Clocks of two machines differ, so of a link to another one nothing is known.

    Attributes:
        sent_ns: By topic and tick, on the sender's clock, in ns.
    """

    sent_ns: Mapping[str, dict[int, int]] = field(
        default_factory=lambda: {topic: {} for topic in HOPS}
    )

    @classmethod
    def of(cls, packets: Iterable[Packet]) -> Hops:
        """Return the hops in packets of the topics ``HOPS``."""
        hops = cls()
        for packet in packets:
            hops.add(TOPIC_OF[type(packet)], packet)
        return hops

    def add(self, topic: str, packet: Packet) -> None:
        """Add a packet; of several that answer the same tick the first counts."""
        tick = packet.device_seq if isinstance(packet, _ANSWERS) else packet.seq
        if tick is not None:
            self.sent_ns[topic].setdefault(tick, packet.time_ns)

    def delays(self) -> dict[str, NDArray[np.float64]]:
        """Return the delays of each link and of ``loop``, all of them together, in ms."""
        found = {topic: self._between(topic, after) for topic, after in pairwise(HOPS)}
        return {**found, "loop": self._between(HOPS[0], HOPS[-1])}

    def _between(self, topic: str, later: str) -> NDArray[np.float64]:
        import numpy as np  # a launch file seldom names a recording, and a start needs no numpy

        starts, ends = self.sent_ns[topic], self.sent_ns[later]
        known = np.array([ends[tick] - starts[tick] for tick in starts if tick in ends]) * 1e-6
        return known[:0] if (known < 0.0).any() else known  # clocks of two machines
