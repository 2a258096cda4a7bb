"""Packets both ways on one socket: ROUTER at the end that listens, DEALER at the one that connects.

A packet is one frame. An empty message is a *greeting*: a ROUTER can send only to a peer from
which it has heard, so the end that connects greets when it is connected, and again once a second.
ZeroMQ's own greeting (PROBE_ROUTER) does not leave before the first message with IMMEDIATE 1, and
is not repeated after a lost connection with IMMEDIATE 0 (libzmq 4.3.5).

Neither socket waits or raises when it sends: what a peer does not take is dropped. A send may
swallow the edge of the socket's descriptor; who waits for it asks
:meth:`forcebound.network.subscriber.Subscriber.pending` first.
"""

from collections.abc import Sequence
from contextlib import suppress
from typing import NamedTuple

import zmq

_DONTWAIT, _RCVMORE = int(zmq.DONTWAIT), int(zmq.RCVMORE)


class Greeting(NamedTuple):
    """The first message of a peer."""

    route: bytes  # its routing id
    descriptor: int  # of its connection
    key: str  # its public key in Z85; empty without keys


class Channel:
    """One ROUTER or DEALER, both ways."""

    def __init__(self, socket: "zmq.Socket[bytes]") -> None:
        self._socket = socket
        self._is_router = socket.type == zmq.ROUTER
        self._routes: list[bytes] = []
        self._known: frozenset[bytes] = frozenset()
        self.greetings: list[Greeting] = []  # since they were last taken away

    def send(self, data: bytes) -> None:
        """Send a packet to every peer, or to the one at the other end; empty: a greeting."""
        if not self._is_router:
            with suppress(zmq.Again):  # nobody is there, or takes it
                self._socket.send(data, _DONTWAIT)
            return
        for route in self._routes:
            with suppress(zmq.Again):
                self._socket.send_multipart((route, data), _DONTWAIT)

    def set_routes(self, routes: Sequence[bytes]) -> None:
        """Set who gets the packets of a ROUTER; others are greeted anew when they send."""
        self._routes = list(routes)
        self._known = frozenset(routes)

    def receive(self) -> bytes | None:
        """Return one packet, ``b""`` for a message of several frames, None for a greeting.

        Raises:
            zmq.Again: If there is none.
        """
        socket = self._socket
        if self._is_router and (route := socket.recv(_DONTWAIT)) not in self._known:
            data = self._greeted(route)
        else:
            data = socket.recv(_DONTWAIT)
        if not socket.get(_RCVMORE):
            return data or None
        while socket.get(_RCVMORE):
            socket.recv(_DONTWAIT)  # the frames of a message arrive together
        return b""

    def _greeted(self, route: bytes) -> bytes:
        """Note the greeting of a peer, and return its message."""
        frame = self._socket.recv(_DONTWAIT, copy=False)
        try:
            key = str(frame.get("User-Id"))
        except zmq.ZMQError:  # it has none
            key = ""
        self.greetings.append(Greeting(route, int(frame.get(zmq.SRCFD)), key))
        self._known |= {route}
        return frame.bytes
