"""Streams of packets, one frame each, out and in.

No send waits or raises: a packet that nobody takes is dropped. A descriptor is edge-triggered: wait
for it only after ``pending`` has found nothing.

CONFLATE would keep the newest packet with less work, but a message of several frames may abort the
process that reads such a socket (trap 9 of :mod:`forcebound.network.sockets`). So a socket keeps
every packet, and the reader takes the newest one.
"""

from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from functools import partial
from typing import Any, NamedTuple

import zmq
from zmq.backend import Socket as _CompiledSocket

WAIT_MS = 10  # longest sleep in a receiving call
DRAIN_LIMIT = 1_000  # messages taken at once from a peer that floods; about 3 ms

# Plain integers: arithmetic on Python's enum members costs more than the call that it is for.
_EVENTS, _POLLIN, _RCVMORE = int(zmq.EVENTS), int(zmq.POLLIN), int(zmq.RCVMORE)
_DONTWAIT = int(zmq.DONTWAIT)


class Publisher:
    """One stream out; never blocks, and drops packets that no subscriber takes."""

    def __init__(self, socket: "zmq.Socket[bytes]") -> None:
        self._socket = socket

    @property
    def send(self) -> Callable[[bytes], Any]:
        """Function that sends one packet to all subscribers; keep it if you send often."""
        # The compiled method itself: pyzmq's Python one around it serves features not used here.
        return partial(_CompiledSocket.send, self._socket)

    def send_frames(self, frames: Sequence[bytes]) -> None:
        """Send one message of several frames, to a program that expects that."""
        self._socket.send_multipart(frames)


class Subscriber:
    """One stream in, of a SUB without CONFLATE."""

    def __init__(self, socket: "zmq.Socket[bytes]") -> None:
        self._socket = socket
        socket.set(zmq.RCVTIMEO, WAIT_MS)
        self._recv = partial(_CompiledSocket.recv, socket)
        # The compiled method: pyzmq's Python one makes an enum member of the name first.
        self._get = _CompiledSocket.get
        self.descriptor = int(socket.FD)

    def pending(self) -> bool:
        """Return whether a packet is there."""
        return bool(int(self._get(self._socket, _EVENTS)) & _POLLIN)

    def wait(self) -> bytes | None:
        """Sleep in the receiving call for at most ``WAIT_MS``; return one packet, or None.

        The packet is ``b""`` for a message of several frames. A newer one may be there already.
        """
        try:
            return self._receive(0)
        except zmq.Again:
            return None

    def receive(self) -> list[bytes]:
        """Return the packets that have arrived, ``b""`` for a message of several frames.

        At most ``DRAIN_LIMIT`` at once: a peer that floods must not hold the loop.
        """
        packets: list[bytes] = []
        try:  # `suppress` costs 3 to 7 us in a cold loop
            while len(packets) < DRAIN_LIMIT and self.pending():
                packets.append(self._receive(_DONTWAIT))
        except zmq.Again:  # EVENTS also counts the message of a peer that has just left
            pass
        return packets

    def _receive(self, flags: int) -> bytes:
        data = self._recv(flags)
        if not self._get(self._socket, _RCVMORE):
            return data
        while self._get(self._socket, _RCVMORE):
            self._recv(_DONTWAIT)  # the frames of a message arrive together
        return b""


class Greeting(NamedTuple):
    """The first message of a peer."""

    route: bytes  # its routing id
    descriptor: int  # of its connection
    address: str  # of its machine, without a port
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
    """Packets both ways: ROUTER at the end that listens, DEALER at the one that connects.

    An empty message is a *greeting*: a ROUTER can send only to a peer that has sent something
    before. So the end that connects greets when it is connected, and again once a second. ZeroMQ's
    greeting (PROBE_ROUTER) does not leave before the first message with IMMEDIATE 1, and is not
    repeated after a lost connection with IMMEDIATE 0 (libzmq 4.3.5).

    A send may consume the edge of the socket's descriptor, so call :meth:`pending` before waiting
    for it. Each packet comes with its *source*: the public key of the peer, or without keys its
    connection. A packet can carry any name; its source cannot be forged.
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
        """Return whether a message is there."""
        return bool(int(self._socket.get(_EVENTS)) & _POLLIN)

    def receive(self) -> list[Arrival]:
        """Return the packets that have arrived, in their order.

        At most ``DRAIN_LIMIT`` messages at once: a peer that floods must not hold the loop.
        """
        arrivals: list[Arrival] = []
        with suppress(zmq.Again):  # EVENTS also counts the message of a peer that has just left
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
        address = str(frames[0].get("Peer-Address")).removeprefix("::ffff:")
        greeting = Greeting(route, int(frames[0].get(zmq.SRCFD)), address, key)
        self.greetings.append(greeting)
        self._sources[route] = greeting.source
        return greeting.source, [frame.bytes for frame in frames]
