"""The virtual-time runner: the same nodes and links as a live run, in one process.

Strategy:

1. Time is an integer, in ns. A heap holds what happens next: a node wants to be stepped, because
   its time has come or because a packet is through on one of its links.
2. Entries of one time are ordered: packets first, then wake-ups, then in the order in which they
   were made; what a perfect link delivers comes before all of them. So a chain of perfect links is
   run through before the device's next instant of the same time, and a run is a function of its
   configuration and seed: same seed, same bits.
3. A computation takes no virtual time, unless a node says so by answering later.
"""

from collections import deque
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from heapq import heappop, heappush
from random import Random
from typing import Annotated, TypeAlias

from forcebound.errors import ConfigError
from forcebound.graph.servo import ServoSettings
from forcebound.messages.codec import encode
from forcebound.messages.packets import TOPIC_OF, Packet
from forcebound.messages.topology import ONE_HAND, Graph, Route
from forcebound.network.link import Link
from forcebound.nodes import Node
from forcebound.quantities import NOT_NEGATIVE, Frequency, Time, check_ranges

_ARRIVAL, _WAKE = 0, 1  # order of entries of the same time

# Name of a stream, index of the node that receives it, its link, whether the node wakes on arrival.
_Delivery: TypeAlias = tuple[str, int, Link[Packet] | None, bool]


@dataclass(frozen=True)
class LateTicks:
    """Late ticks on purpose: the writes of a servo come late, as on a busy machine.

    Drawn from a seed, the same for every law and setting, so that they can be compared.

    Attributes:
        rate: Late ticks per second on average.
        shortest: Least lateness of a late tick.
        longest: Largest; in between all are equally likely.
        jitter: Every other write comes early or late by up to this.
        seed: Of the random numbers.

    Raises:
        ConfigError: If a value is out of range or ``longest`` is less than ``shortest``.
    """

    rate: Annotated[Frequency, NOT_NEGATIVE] = 0.0
    shortest: Annotated[Time, NOT_NEGATIVE] = 0.3e-3
    longest: Annotated[Time, NOT_NEGATIVE] = 2e-3
    jitter: Annotated[Time, NOT_NEGATIVE] = 0.0
    seed: Annotated[int, NOT_NEGATIVE] = 1

    def __post_init__(self) -> None:
        check_ranges(self)
        if self.longest < self.shortest:
            message = f"longest must be >= shortest, {self.shortest:g} s, got {self.longest:g} s"
            raise ConfigError(message, field="longest")

    def of(self, servo: ServoSettings) -> Callable[[], int]:
        """Return what draws how late the next write of a servo is, in ns; negative: early."""
        chance, random = self.rate * servo.period_ns * 1e-9, Random(self.seed)

        def draw_ns() -> int:
            is_late = random.random() < chance
            least, most = (self.shortest, self.longest) if is_late else (-self.jitter, self.jitter)
            return round(random.uniform(least, most) * 1e9)

        return draw_ns


class Simulation:
    """A graph of nodes in virtual time; those of one instant are stepped in the order of ``nodes``.

    A stream that is not in ``links`` has a perfect link, which delivers at once and keeps only the
    newest packet for a node that takes it later. ``observe`` is called with each packet of the
    classes ``observed`` at its sending, in order.

    Raises:
        ConfigError: If a node needs a stream that none of the nodes sends.
    """

    def __init__(
        self,
        nodes: Sequence[Node],
        links: Mapping[str, Link[Packet]],
        observe: Callable[[Packet], None],
        observed: Collection[type[Packet]] = tuple(TOPIC_OF),
        graph: Graph = ONE_HAND,
    ) -> None:
        self.nodes = nodes
        self.graph = graph
        self._observe = observe
        self._observed = frozenset(observed)
        self._mail: list[dict[str, Packet]] = [{} for _ in nodes]  # delivered, not taken
        self._links: list[list[Link[Packet]]] = [[] for _ in nodes]
        self._deliveries: dict[Route, _Delivery] = {}
        self._routes: dict[str, Route] = {}  # by the name of the stream
        self._heap: list[tuple[int, int, int, int]] = []  # time, kind, number, node
        self._number = 0
        self._due: list[list[int | None]] = [[None] * len(nodes), [None] * len(nodes)]  # by kind
        self._now: deque[int] = deque()  # nodes to which something was delivered just now
        self.time_ns = 0
        names = [node.events.node for node in nodes]
        for index, node in enumerate(nodes):
            for route, stream in graph.routes(names[index]).items():
                if stream.receiver != names[index]:
                    continue
                if stream.sender not in names:
                    raise ConfigError(f"no node of the graph publishes {stream.name}")
                link = links.get(stream.name)
                self._routes[stream.name] = route
                self._deliveries[route] = (stream.name, index, link, node.wakes_on_arrival)
                if link is not None:
                    self._links[index].append(link)
            self._schedule(_WAKE, index, node.wake_ns)

    def link(self, stream: str) -> Link[Packet] | None:
        """Return the model of the link of a stream; None if it is perfect."""
        return self._deliveries[self._routes[stream]][2]

    def set_link(self, stream: str, link: Link[Packet]) -> None:
        """Impair a link that was perfect."""
        route = self._routes[stream]
        name, index, _, wakes_on_arrival = self._deliveries[route]
        self._deliveries[route] = (name, index, link, wakes_on_arrival)
        self._links[index].append(link)

    def run(self, until_ns: int) -> None:
        """Let everything happen that is due before ``until_ns``."""
        heap = self._heap
        while heap and heap[0][0] < until_ns:
            time_ns, kind, _, index = heappop(heap)
            due = self._due[kind]
            if time_ns != due[index]:
                continue  # superseded: the node has been rescheduled
            due[index] = None
            self.time_ns = time_ns
            self._step(index, time_ns)
            while self._now:
                self._step(self._now.popleft(), time_ns)
        self.time_ns = until_ns

    def _step(self, index: int, time_ns: int) -> None:
        node, observed, deliveries = self.nodes[index], self._observed, self._deliveries
        mail = self._mail[index]
        received = list(mail.values())
        mail.clear()
        links = self._links[index]
        for link in links:
            received += link.due(time_ns)
        for packet in node.step(time_ns, received):
            kind = type(packet)
            if kind in observed:
                self._observe(packet)
            delivery = deliveries.get((kind, packet.hand))
            if delivery is None:
                continue
            name, receiver, model, wakes_on_arrival = delivery
            if model is not None:
                if model.has_rate:
                    model.accept(time_ns, packet, len(encode(packet)))
                else:
                    model.accept(time_ns, packet)
                if wakes_on_arrival:
                    self._schedule(_ARRIVAL, receiver, model.next_due_ns)
                continue
            self._mail[receiver][name] = packet
            if wakes_on_arrival and receiver not in self._now:
                self._now.append(receiver)
        if links and node.wakes_on_arrival:
            for link in links:
                self._schedule(_ARRIVAL, index, link.next_due_ns)
        wake_ns = node.wake_ns
        wakes = self._due[_WAKE]
        if wake_ns != wakes[index]:
            wakes[index] = None
            self._schedule(_WAKE, index, wake_ns)

    def _schedule(self, kind: int, index: int, time_ns: int | None) -> None:
        if time_ns is None:
            return
        due_ns = self._due[kind][index]
        if due_ns is None or time_ns < due_ns:
            self._due[kind][index] = time_ns
            self._number += 1
            heappush(self._heap, (time_ns, kind, self._number, index))
