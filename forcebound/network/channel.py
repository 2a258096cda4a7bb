"""Packets both ways on one socket: ROUTER at the end that listens, DEALER at the one that connects.

A packet is one frame. An empty message is a *greeting*: a ROUTER can send only to a peer that has
sent something before. So the end that connects greets when it is connected, and again once a
second. ZeroMQ's own greeting (PROBE_ROUTER) does not leave before the first message with
IMMEDIATE 1, and is not repeated after a lost connection with IMMEDIATE 0 (libzmq 4.3.5).

Neither socket waits or raises when it sends: a packet that a peer does not take is dropped. A send
may consume the edge of the socket's descriptor; call :meth:`Channel.pending` before waiting for it.

Each packet comes with its *source*: the public key of the peer, or without keys its connection. A
packet can carry any name; its source cannot be forged.
"""

from collections.abc import Iterable
from contextlib import suppress
from typing import NamedTuple

import zmq

from forcebound.network.subscriber import DRAIN_LIMIT

_DONTWAIT = int(zmq.DONTWAIT)
_EVENTS, _POLLIN = int(zmq.EVENTS), int(zmq.POLLIN)


class Greeting(NamedTuple):
    """The first message of a peer."""

    route: bytes  # its routing id
    descriptor: int  # of its connection
    key: str  # its public key in Z85; empty without keys

    @property
    def source(self) -> str:
        """Name that distinguishes the peer from others."""
        return self.key or f"connection {self.route.hex()}"


class Arrival(NamedTuple):
    """A packet and its source."""

    source: str
    data: bytes  # empty for a message of several frames


class Channel:
    """One ROUTER or DEALER, both ways.

    Its descriptor is edge-triggered: wait for it only after :meth:`pending` has found nothing.
    """

    def __init__(self, socket: "zmq.Socket[bytes]") -> None:
        self._socket = socket
        self._is_router = socket.type == zmq.ROUTER
        self._routes: list[bytes] = []
        self._sources: dict[bytes, str] = {}  # of peers that have greeted, by route
        self.descriptor = int(socket.FD)
        self.greetings: list[Greeting] = []  # since they were last cleared

    def send(self, data: bytes) -> None:
        """Send a packet to every peer, or to the one at the other end; empty: a greeting."""
        if not self._is_router:
            with suppress(zmq.Again):  # no peer is there, or its queue is full
                self._socket.send(data, _DONTWAIT)
            return
        for route in self._routes:
            with suppress(zmq.Again):
                self._socket.send_multipart((route, data), _DONTWAIT)

    def set_peers(self, peers: Iterable[Greeting]) -> None:
        """Set the receivers of a ROUTER's packets; another peer that sends is greeted again."""
        self._sources = {peer.route: peer.source for peer in peers}
        self._routes = list(self._sources)

    def pending(self) -> bool:
        """Whether a message is there."""
        return bool(int(self._socket.get(_EVENTS)) & _POLLIN)

    def receive(self) -> list[Arrival]:
        """Return the packets that have arrived, in their order.

        At most ``DRAIN_LIMIT`` messages at once: a peer that floods must not hold the loop.
        """
        arrivals: list[Arrival] = []
        for _ in range(DRAIN_LIMIT):
            if not self.pending():
                break
            source, frames = self._message()
            if len(frames) > 1 or frames[0]:
                arrivals.append(Arrival(source, b"" if len(frames) > 1 else frames[0]))
        return arrivals

    def _message(self) -> tuple[str, list[bytes]]:
        """Return source and frames of a message; a peer that is new is noted in ``greetings``."""
        if not self._is_router:
            return "", self._socket.recv_multipart(_DONTWAIT)
        route = self._socket.recv(_DONTWAIT)
        if route in self._sources:
            return self._sources[route], self._socket.recv_multipart(_DONTWAIT)
        frames = self._socket.recv_multipart(_DONTWAIT, copy=False)
        try:
            key = str(frames[0].get("User-Id"))
        except zmq.ZMQError:  # it has none
            key = ""
        greeting = Greeting(route, int(frames[0].get(zmq.SRCFD)), key)
        self.greetings.append(greeting)
        self._sources[route] = greeting.source
        return greeting.source, [frame.bytes for frame in frames]
