"""Inbox of a node: sockets, decoding, and models of impaired links.

Strategy:

1. All streams of this machine share one socket, so the process can sleep in the receiving call
   itself. Waiting for descriptors first costs more per packet, because Python code that has not
   run for a millisecond is slow.
2. Of a perfect link only the newest packet is taken, and the link has no object. A call that has
   slept returns the only packet; after a call that has not slept, the inbox looks for more.
3. If a link is impaired, if the node waits for an instant, or if packets also come from another
   machine, the process waits for descriptors; this wait ends within microseconds of the instant.
"""

import time
from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple, TypeAlias

from forcebound.errors import PacketError
from forcebound.messages.codec import decode
from forcebound.messages.packets import TOPIC_OF, TOPICS, Packet
from forcebound.messages.topology import HAND, Route, Stream, endpoint
from forcebound.network import sockets
from forcebound.network.link import Link
from forcebound.network.sockets import Network
from forcebound.network.streams import Channel, Subscriber

LONGEST_WAIT_NS = 10_000_000  # then the runner polls its control socket
SLEPT_NS = 5_000  # a receiving call that took longer has slept

HERE = ""  # source of packets of this machine

_clock = time.monotonic_ns


#: What passes on the packets of streams that are not for this node.
Relays: TypeAlias = Mapping[Stream, Callable[[bytes], Any]]
_NONE: Relays = MappingProxyType({})


class _Expected:
    """The streams whose packets may come over a socket."""

    def __init__(self, streams: Mapping[Route, Stream], relays: "Relays") -> None:
        self.relays = {stream.name: send for stream, send in relays.items()}
        self._names = {route: stream.name for route, stream in streams.items()}
        self._names |= {(TOPICS[each.topic], each.hand or HAND): each.name for each in relays}
        kinds = {kind for kind, _ in self._names}
        self.kind = next(iter(kinds)) if len(kinds) == 1 else None
        # Of a socket with one stream nothing is looked up.
        (self._hand, self._only), *others = [
            (hand, name) for (_, hand), name in self._names.items()
        ]
        if others:
            self._only = ""

    def stream_of(self, packet: Packet) -> str:
        """Return the name of a packet's stream; "" if it is none of these."""
        if self._only:
            return self._only if packet.hand == self._hand else ""
        return self._names.get((type(packet), packet.hand), "")

    def __str__(self) -> str:
        return ", ".join(self._names.values())


class _Remote(NamedTuple):
    """The link to another machine, over which packets of one class and hand come."""

    expected: _Expected
    channel: Channel
    forward: Callable[[bytes], Any]


class Inbox:
    """Receives the packets of one node, on streams of which some have impaired ``links``.

    ``reject`` is called for each packet that is rejected, with the reason, and what was expected
    and what came; ``admit`` (:meth:`forcebound.nodes.Node.admit`) before a link or a newer packet
    decides. ``received`` has the number of packets by stream; of a stream ``elsewhere``, once one
    has come. Packets of ``relays`` that come from this machine are passed on as they are.
    """

    def __init__(
        self,
        streams: Mapping[Route, Stream],
        links: Mapping[str, Link[Packet]],
        reject: Callable[[str, str], None],
        admit: Callable[[Packet, str, int], bool],
        elsewhere: Collection[str] = (),
        relays: Relays = _NONE,
    ) -> None:
        self._streams = streams
        names = [stream.name for stream in streams.values()]
        self.received = {name: 0 for name in names if name not in elsewhere}
        self._expected = _Expected(streams, relays)
        ends = {*names} - {*self._expected.relays}
        self.links = {name: link for name, link in links.items() if name in ends}
        self._reject = reject
        self._admit = admit
        self._local: Subscriber | None = None
        self._remotes: list[_Remote] = []

    def listen(self, network: Network, run_dir: Path, without: Collection[str] = ()) -> None:
        """Receive from the processes of this machine, but for the streams of some hands."""
        streams = [stream for (_, hand), stream in self._streams.items() if hand not in without]
        if streams:
            self._local = network.subscriber(*(endpoint(run_dir, s) for s in streams))

    def listen_remotely(
        self,
        expected: type[Packet],
        hand: str,
        channel: Channel,
        forward: Callable[[bytes], Any],
        relays: Relays = _NONE,
    ) -> None:
        """Receive a hand's packets of a class from another machine, too; ``forward`` gets each.

        Packets of other hands are rejected: a peer may not speak for another hand. Those of
        ``relays`` are passed on.
        """
        only = _Expected({(expected, hand): self._streams[expected, hand]}, relays)
        self._remotes.append(_Remote(only, channel, forward))

    def link(self, stream: str) -> Link[Packet] | None:
        """Return the model of the link of a stream; None if it is perfect."""
        return self.links.get(stream)

    def set_link(self, stream: str, link: Link[Packet]) -> None:
        """Impair a link that was perfect."""
        self.links[stream] = link

    def link_counts(self) -> dict[str, dict[str, int]]:
        """Return the counts of packets by fate on each impaired link, by stream."""
        return {name: link.counts for name, link in self.links.items()}

    def wait(self, wake_ns: int | None, stop_descriptor: int) -> tuple[int, Sequence[Packet]]:
        """Sleep until a packet arrives, at most ``LONGEST_WAIT_NS``, or until ``wake_ns``.

        ``stop_descriptor`` ends the sleep when it is readable, unless in the receiving call.
        Returns the time, in ns, and the packets that are through their links.
        """
        local = self._local
        if self.links or self._remotes or wake_ns is not None or local is None:
            self._sleep(wake_ns, stop_descriptor)
            time_ns = _clock()
            return time_ns, self.take(time_ns)
        begun_ns = _clock()
        data = local.wait()
        time_ns = _clock()
        if data is None:
            return time_ns, ()
        if time_ns - begun_ns < SLEPT_NS:
            newest: dict[str, Packet] = {}
            for each in (data, *local.receive()):
                self._accept(each, self._expected, HERE, time_ns, newest)
            return time_ns, list(newest.values())
        found = self._decoded(data, self._expected, HERE, time_ns)
        return time_ns, () if found is None else (found[1],)

    def _sleep(self, wake_ns: int | None, stop_descriptor: int) -> None:
        """Wait for descriptors until the next time of the node or of a link."""
        times_ns = [link.next_due_ns for link in self.links.values()]
        due_ns = min((t for t in (wake_ns, *times_ns) if t is not None), default=None)
        subscribers: list[Subscriber | Channel] = [each.channel for each in self._remotes]
        if self._local is not None:
            subscribers.append(self._local)
        if not any(each.pending() for each in subscribers):
            sleep_ns = LONGEST_WAIT_NS if due_ns is None else due_ns - _clock()
            waited = [each.descriptor for each in subscribers]
            sockets.wait((*waited, stop_descriptor), min(sleep_ns, LONGEST_WAIT_NS))

    def take(self, time_ns: int) -> list[Packet]:
        """Return the packets that have passed their links; never waits."""
        newest: dict[str, Packet] = {}
        if self._local is not None:
            for data in self._local.receive():
                self._accept(data, self._expected, HERE, time_ns, newest)
        for expected, channel, forward in self._remotes:
            for source, data in channel.receive():
                if self._accept(data, expected, source, time_ns, newest):
                    forward(data)
        received = list(newest.values())
        for link in self.links.values():
            received += link.due(time_ns)
        return received

    def _accept(
        self,
        data: bytes,
        expected: _Expected,
        source: str,
        time_ns: int,
        newest: dict[str, Packet],
    ) -> bool:
        """Decode a frame, and give its packet to its link or, where that is perfect, to newest."""
        found = self._decoded(data, expected, source, time_ns)
        if found is None:
            return False
        name, packet = found
        if name in expected.relays:
            expected.relays[name](data)
            return False
        link = self.links.get(name)
        if link is None:
            newest[name] = packet
        else:
            link.accept(time_ns, packet, len(data))
        return True

    def _decoded(
        self, data: bytes, expected: _Expected, source: str, time_ns: int
    ) -> tuple[str, Packet] | None:
        """Return stream and packet of a frame; None, and counted, if it is rejected."""
        try:
            packet = decode(data, expected.kind)
        except PacketError as error:
            self._reject(error.reason, str(error))
            return None
        name = expected.stream_of(packet)
        if not name:
            got = f"{TOPIC_OF[type(packet)]} of hand {packet.hand!r}"
            self._reject("unexpected", f"expected {expected}, got {got}")
            return None
        self.received[name] = self.received.get(name, 0) + 1
        return (name, packet) if self._admit(packet, source, time_ns) else None
