"""The virtual-time runner: the same nodes and links as a live run, in one process.

Strategy:

1. Time is an integer, in ns. A heap holds what happens next: a node wants to be stepped, because
   its time has come or because a packet is through on one of its links.
2. Entries of one time are ordered: packets first, then wake-ups, then in the order in which they
   were made. So a chain of instant links is run through before the device's next instant of the
   same time, and a run is a function of its configuration and seed: same seed, same bits.
3. A computation takes no virtual time, unless a node says so by answering later.
"""

from collections.abc import Callable, Mapping, Sequence
from heapq import heappop, heappush

from forcebound.errors import ConfigError
from forcebound.messages.packets import TOPIC_OF, Packet
from forcebound.network.link import Link
from forcebound.nodes import Node

_ARRIVAL, _WAKE = 0, 1  # order of entries of the same time


class Simulation:
    """A graph of nodes in virtual time.

    Args:
        nodes: The nodes; each topic has one publisher and at most one subscriber among them.
        links: The link of each topic that a node subscribes to.
        observe: Called with each packet at its sending, in order.

    Raises:
        ConfigError: If a subscribed topic has no publisher or no link.
    """

    def __init__(
        self,
        nodes: Sequence[Node],
        links: Mapping[str, Link[Packet]],
        observe: Callable[[Packet], None] = lambda packet: None,
    ) -> None:
        self._nodes = nodes
        self._observe = observe
        self._inboxes: list[list[Link[Packet]]] = []
        self._routes: dict[type[Packet], tuple[Link[Packet], int]] = {}
        self._heap: list[tuple[int, int, int, int]] = []  # time, kind, number, node
        self._number = 0
        self._due: list[list[int | None]] = [[None] * len(nodes), [None] * len(nodes)]  # by kind
        self.time_ns = 0
        published = {packet for node in nodes for packet in node.publishes}
        for index, node in enumerate(nodes):
            inbox = []
            for packet in node.subscribes:
                topic = TOPIC_OF[packet]
                if packet not in published:
                    raise ConfigError(f"no node of the graph publishes {topic}")
                if topic not in links:
                    raise ConfigError(f"no link for {topic}")
                inbox.append(links[topic])
                self._routes[packet] = (links[topic], index if node.wakes_on_arrival else -1)
            self._inboxes.append(inbox)
            self._schedule(_WAKE, index, node.wake_ns)

    def run(self, until_ns: int) -> None:
        """Let everything happen that is due before ``until_ns``."""
        heap = self._heap
        while heap and heap[0][0] < until_ns:
            time_ns, kind, _, index = heappop(heap)
            if time_ns != self._due[kind][index]:
                continue  # it has changed its mind since
            self._due[kind][index] = None
            self.time_ns = time_ns
            self._step(index)
        self.time_ns = until_ns

    def _step(self, index: int) -> None:
        node = self._nodes[index]
        received: list[Packet] = []
        for link in self._inboxes[index]:
            received += link.due(self.time_ns)
        for packet in node.step(self.time_ns, received):
            self._observe(packet)
            route = self._routes.get(type(packet))
            if route is not None:
                link, receiver = route
                link.accept(self.time_ns, packet)
                if receiver >= 0:
                    self._schedule(_ARRIVAL, receiver, link.next_due_ns)
        if node.wakes_on_arrival:
            for link in self._inboxes[index]:
                self._schedule(_ARRIVAL, index, link.next_due_ns)
        if (wake_ns := node.wake_ns) != self._due[_WAKE][index]:
            self._due[_WAKE][index] = None
            self._schedule(_WAKE, index, wake_ns)

    def _schedule(self, kind: int, index: int, time_ns: int | None) -> None:
        if time_ns is None:
            return
        due_ns = self._due[kind][index]
        if due_ns is None or time_ns < due_ns:
            self._due[kind][index] = time_ns
            self._number += 1
            heappush(self._heap, (time_ns, kind, self._number, index))
