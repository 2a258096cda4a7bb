"""Packets both ways on one socket: ROUTER at the end that listens, DEALER at the one that connects.

A packet is one frame. An empty message is a *greeting*: a ROUTER can send only to a peer from
which it has heard, so the end that connects greets when it is connected, and again once a second.
ZeroMQ's own greeting (PROBE_ROUTER) does not leave before the first message with IMMEDIATE 1, and
is not repeated after a lost connection with IMMEDIATE 0 (libzmq 4.3.5).

Neither socket waits or raises when it sends: what a peer does not take is dropped. A send may
swallow the edge of the socket's descriptor; who waits for it asks :meth:`Channel.pending` first.

Each packet comes with its *source*: the public key of the peer, or without keys its connection. A
name in a packet can be anybody's, a source cannot.
"""

from collections.abc import Iterable
from contextlib import suppress
from typing import NamedTuple

import zmq

from forcebound.network.subscriber import DRAIN_LIMIT

_DONTWAIT, _RCVMORE = int(zmq.DONTWAIT), int(zmq.RCVMORE)
_EVENTS, _POLLIN = int(zmq.EVENTS), int(zmq.POLLIN)


class Greeting(NamedTuple):
    """The first message of a peer."""

    route: bytes  # its routing id
    descriptor: int  # of its connection
    key: str  # its public key in Z85; empty without keys

    @property
    def source(self) -> str:
        """What distinguishes the peer from others."""
        return self.key or f"connection {self.route.hex()}"


class Arrival(NamedTuple):
    """A packet and who sent it."""

    source: str
    data: bytes  # empty for a message of several frames


class Channel:
    """One ROUTER or DEALER, both ways.

    Args:
        socket: The ROUTER or DEALER.
        newest_only: Whether of each source only the newest packet counts.

    Attributes:
        newest_only: May be changed.
        descriptor: Readable when something has happened; edge-triggered, so it may be waited for
            only after :meth:`pending` has found nothing.
        superseded: Packets for which a newer one of the same source was there already.
        greetings: Since they were last taken away.
        heard: Routes of a ROUTER on which a message came since it was last cleared; of a DEALER an
            empty one.
    """

    def __init__(self, socket: "zmq.Socket[bytes]", newest_only: bool) -> None:
        self._socket = socket
        self._is_router = socket.type == zmq.ROUTER
        self._routes: list[bytes] = []
        self._sources: dict[bytes, str] = {}  # of peers that have greeted, by route
        self.newest_only = newest_only
        self.descriptor = int(socket.FD)
        self.superseded = 0
        self.greetings: list[Greeting] = []
        self.heard: set[bytes] = set()

    def send(self, data: bytes) -> None:
        """Send a packet to every peer, or to the one at the other end; empty: a greeting."""
        if not self._is_router:
            with suppress(zmq.Again):  # nobody is there, or takes it
                self._socket.send(data, _DONTWAIT)
            return
        for route in self._routes:
            with suppress(zmq.Again):
                self._socket.send_multipart((route, data), _DONTWAIT)

    def set_peers(self, peers: Iterable[Greeting]) -> None:
        """Set who gets the packets of a ROUTER; others are greeted anew when they send."""
        self._sources = {peer.route: peer.source for peer in peers}
        self._routes = list(self._sources)

    def pending(self) -> bool:
        """Whether something is there."""
        return bool(int(self._socket.get(_EVENTS)) & _POLLIN)

    def receive(self) -> list[Arrival]:
        """Return what has come, in its order; if only the newest counts, one packet a source.

        At most ``DRAIN_LIMIT`` messages at once: a peer that floods must not hold the loop.
        """
        came: list[Arrival] = []
        for _ in range(DRAIN_LIMIT):
            if not self.pending():
                break
            arrival = self._receive()
            if arrival is not None:
                came.append(arrival)
        if not self.newest_only or len(came) < 2:
            return came
        newest = {arrival.source: arrival for arrival in came if arrival.data}
        kept = [each for each in came if not each.data or each is newest[each.source]]
        self.superseded += len(came) - len(kept)
        return kept

    def _receive(self) -> Arrival | None:
        """Return what the next message holds; None for a greeting."""
        socket, source, route = self._socket, "", b""
        if self._is_router:
            route = socket.recv(_DONTWAIT)
            data = socket.recv(_DONTWAIT) if route in self._sources else self._greeted(route)
            source = self._sources[route]
        else:
            data = socket.recv(_DONTWAIT)
        self.heard.add(route)
        if not socket.get(_RCVMORE):
            return Arrival(source, data) if data else None
        while socket.get(_RCVMORE):
            socket.recv(_DONTWAIT)  # the frames of a message arrive together
        return Arrival(source, b"")

    def _greeted(self, route: bytes) -> bytes:
        """Note the greeting of a peer, and return its message."""
        frame = self._socket.recv(_DONTWAIT, copy=False)
        try:
            key = str(frame.get("User-Id"))
        except zmq.ZMQError:  # it has none
            key = ""
        greeting = Greeting(route, int(frame.get(zmq.SRCFD)), key)
        self.greetings.append(greeting)
        self._sources[route] = greeting.source
        return frame.bytes
