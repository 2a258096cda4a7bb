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
from dataclasses import dataclass, field
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


@dataclass(slots=True, eq=False)
class _Seat:
    """A node of a simulation, and what waits for it."""

    node: Node
    step: Callable[[int, Sequence[Packet]], Sequence[Packet]]  # of the node
    links: list[Link[Packet]] = field(default_factory=list)  # that are not perfect
    mail: dict[str, Packet] = field(default_factory=dict)  # delivered by the others, not taken
    # Of its entries in the heap that count, by their kind.
    due: list[int | None] = field(default_factory=lambda: [None, None])


# Name of a stream, who receives it, its link, whether the receiver wakes on arrival.
_Delivery: TypeAlias = tuple[str, _Seat, Link[Packet] | None, bool]


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
        self._deliveries: dict[Route, _Delivery] = {}
        self._routes: dict[str, Route] = {}  # by the name of the stream
        self._heap: list[tuple[int, int, int, _Seat]] = []  # time, kind, number, whose
        self._number = 0
        self._now: deque[_Seat] = deque()  # to which something was delivered just now
        self.time_ns = 0
        names = [node.events.node for node in nodes]
        for name, node in zip(names, nodes, strict=True):
            seat = _Seat(node, node.step)
            for route, stream in graph.routes(name).items():
                if stream.receiver != name:
                    continue
                if stream.sender not in names:
                    raise ConfigError(f"no node of the graph publishes {stream.name}")
                link = links.get(stream.name)
                self._routes[stream.name] = route
                self._deliveries[route] = (stream.name, seat, link, node.wakes_on_arrival)
                if link is not None:
                    seat.links.append(link)
            self._schedule(_WAKE, seat, node.wake_ns)

    def link(self, stream: str) -> Link[Packet] | None:
        """Return the model of the link of a stream; None if it is perfect."""
        return self._deliveries[self._routes[stream]][2]

    def set_link(self, stream: str, link: Link[Packet]) -> None:
        """Impair a link that was perfect."""
        route = self._routes[stream]
        name, receiver, _, wakes = self._deliveries[route]
        self._deliveries[route] = (name, receiver, link, wakes)
        receiver.links.append(link)

    def run(self, until_ns: int) -> None:
        """Let everything happen that is due before ``until_ns``."""
        heap, now = self._heap, self._now
        while heap and heap[0][0] < until_ns:
            time_ns, kind, _, seat = heappop(heap)
            if time_ns != seat.due[kind]:
                continue  # superseded: the node has been rescheduled
            seat.due[kind] = None
            self.time_ns = time_ns
            now.append(seat)
            while now:
                self._step(now.popleft(), time_ns)
        self.time_ns = until_ns

    def _step(self, seat: _Seat, time_ns: int) -> None:
        mail, links, now = seat.mail, seat.links, self._now
        received: list[Packet] = []
        if mail:
            received += mail.values()
            mail.clear()
        for link in links:
            received += link.due(time_ns)
        for packet in seat.step(time_ns, received):
            kind = type(packet)
            if kind in self._observed:
                self._observe(packet)
            delivery = self._deliveries.get((kind, packet.hand))
            if delivery is None:
                continue
            name, receiver, model, wakes = delivery
            if model is None:
                receiver.mail[name] = packet
                if wakes and receiver not in now:
                    now.append(receiver)
                continue
            if model.has_rate:
                model.accept(time_ns, packet, len(encode(packet)))
            else:
                model.accept(time_ns, packet)
            if wakes:
                self._schedule(_ARRIVAL, receiver, model.next_due_ns)
        if links and seat.node.wakes_on_arrival:
            for link in links:
                self._schedule(_ARRIVAL, seat, link.next_due_ns)
        wake_ns = seat.node.wake_ns
        if wake_ns != seat.due[_WAKE]:
            seat.due[_WAKE] = None
            self._schedule(_WAKE, seat, wake_ns)

    def _schedule(self, kind: int, seat: _Seat, time_ns: int | None) -> None:
        if time_ns is None:
            return
        due_ns = seat.due[kind]
        if due_ns is None or time_ns < due_ns:
            seat.due[kind] = time_ns
            self._number += 1
            heappush(self._heap, (time_ns, kind, self._number, seat))
