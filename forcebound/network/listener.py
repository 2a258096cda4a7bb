"""The connections of a port that listens: established peers, failures, surplus connections.

libzmq's monitor gives little: ACCEPTED and DISCONNECTED name a descriptor, the result of a
handshake names nothing. What can be relied on:

1. The events of one socket come in the order in which they happened.
2. HANDSHAKE_FAILED_NO_DETAIL and ..._PROTOCOL are followed at once by the DISCONNECTED of the same
   connection; ..._AUTH is followed by it later. Garbage may give DISCONNECTED alone.
3. A message names the descriptor of its connection and the key of its sender. So a peer is
   established with its first message, the greeting (:mod:`forcebound.network.channel`).
4. A descriptor is closed only after its DISCONNECTED is in the monitor's queue. So a duplicate of
   it, made before a look at the queue that finds no such event, is of that connection for sure.

libzmq has no limit on connections. Here, beyond ``MAX_CONNECTIONS`` or what the descriptors of the
process allow, the oldest that is not established is shut (4 makes sure that no other is hit): a
peer that holds a key is through its handshake in milliseconds, one that holds none can only wait.

libzmq limits the size of a frame, not that of a message: it keeps the frames of one that never
ends. A connection on which more than ``MAX_UNFINISHED`` bytes came without a message is shut, too.
"""

import socket
from collections.abc import Collection, Mapping
from contextlib import suppress
from dataclasses import dataclass

import zmq

from forcebound.network import limits
from forcebound.network.channel import Channel, Greeting
from forcebound.network.descriptors import Grip
from forcebound.network.monitor import WRONG_KEY, Monitor, SocketEvent
from forcebound.network.notices import Notice


@dataclass
class _Connection:
    address: str
    port: int
    since_ns: int
    greeting: Greeting | None = None  # once it is established
    is_shut: bool = False
    received: int = 0  # bytes, at the last look that found a whole message

    def __str__(self) -> str:
        host = f"[{self.address}]" if ":" in self.address else self.address
        return f"{host}:{self.port}" if self.port else host


class Listener:
    """The connections of one listening socket."""

    def __init__(self, monitor: Monitor, names: Mapping[str, str], most: int) -> None:
        self._monitor = monitor
        self._names = names  # of the peers that may come, by public key; empty: no keys
        self._open: dict[int, _Connection] = {}
        self._refused = 0
        self._failure: SocketEvent | None = None
        self._grip = Grip()
        self._most = most  # connections
        self.due_ns: int | None = None

    @property
    def established(self) -> int:
        """Number of peers that may send and receive packets now."""
        return sum(c.greeting is not None for c in self._open.values())

    @property
    def connections(self) -> int:
        """Number of connections, established or not."""
        return len(self._open)

    @property
    def peers(self) -> list[str]:
        """Names and keys, or addresses, of the established peers."""
        return [
            f"{self._names.get(c.greeting.key, '')} (key {c.greeting.key})"
            if c.greeting.key
            else str(c)
            for c in self._open.values()
            if c.greeting is not None
        ]

    def greet(self, channel: Channel) -> list[Notice]:
        """Establish those who have greeted; all events before that must have been taken."""
        notices = []
        for greeting in channel.greetings:
            connection = self._open.get(greeting.descriptor)
            if connection is None:
                continue  # it has gone meanwhile
            is_new = connection.greeting is None
            connection.greeting = greeting
            if is_new:
                notices.append(self._notice("came", connection))
        channel.greetings.clear()
        peers = self._open.values()
        channel.set_peers(c.greeting for c in peers if c.greeting is not None)
        return notices

    def take(self, time_ns: int, limit: int) -> list[Notice]:
        """Take up to ``limit`` events; :attr:`due_ns` is set if there may be more."""
        notices: list[Notice] = []
        self.due_ns = time_ns if self._read(time_ns, limit, notices) else None
        while len(alive := self._alive()) > self._most:
            # The oldest that is not established; if all are, the newest.
            descriptor, victim = next((e for e in alive if e[1].greeting is None), alive[-1])
            if not self._shut(descriptor, victim, "too_many", time_ns, limit, notices):
                self.due_ns = time_ns
                break
        return notices

    def look(self, time_ns: int, limit: int, heard: Collection[bytes]) -> list[Notice]:
        """Shut connections on which too much came without a message.

        Args:
            time_ns: Now, in ns.
            limit: Of events, as for :meth:`take`.
            heard: Routes on which a message came since the last look.
        """
        notices: list[Notice] = []
        for descriptor, connection in self._alive():
            received = self._grip.bytes_received(descriptor)
            if connection.greeting is not None and connection.greeting.route in heard:
                connection.received = received
            elif received - connection.received > limits.MAX_UNFINISHED:
                self._shut(descriptor, connection, "unfinished", time_ns, limit, notices)
        return notices

    def _alive(self) -> list[tuple[int, _Connection]]:
        return [(fd, c) for fd, c in self._open.items() if not c.is_shut]

    def _read(self, time_ns: int, limit: int, notices: list[Notice]) -> bool:
        """Handle events; return whether the limit ended it."""
        for _ in range(limit):
            event = self._monitor.take()
            if event is None:
                return False
            notices += self._handle(time_ns, event)
        return True

    def _handle(self, time_ns: int, event: SocketEvent) -> list[Notice]:
        if event.kind == zmq.EVENT_ACCEPTED:
            self._open[event.value] = _Connection(*self._peer_of(event.value), time_ns)
        elif event.kind == zmq.EVENT_HANDSHAKE_FAILED_AUTH:
            self._refused += 1  # the authenticator has reported why
        elif event.kind in (
            zmq.EVENT_HANDSHAKE_FAILED_NO_DETAIL,
            zmq.EVENT_HANDSHAKE_FAILED_PROTOCOL,
        ):
            self._failure = event
        elif event.kind == zmq.EVENT_DISCONNECTED:
            return self._lose(time_ns, event.value)
        return []

    def _lose(self, time_ns: int, descriptor: int) -> list[Notice]:
        failure, self._failure = self._failure, None
        connection = self._open.pop(descriptor, None)
        if connection is None:
            return []
        if connection.greeting is not None:
            return [self._notice("left", connection)]
        if failure is None and self._refused:  # it was refused just before
            self._refused -= 1
            return []
        if connection.is_shut:
            return []
        code = "no_zmtp"
        if failure == WRONG_KEY:
            code = "expects_other_key"
        elif failure is not None:
            left = "left_as_without_keys" if self._names else "left_as_with_keys"
            code = failure.failure(time_ns - connection.since_ns, bool(self._names), left)
        return [self._notice(code, connection)]

    def _notice(self, code: str, connection: _Connection) -> Notice:
        data = {"address": str(connection)}
        if connection.greeting is not None:
            key = connection.greeting.key
            data |= {"key": key, "name": self._names.get(key, "")}
        return Notice(code, data)

    def _shut(
        self,
        descriptor: int,
        victim: _Connection,
        code: str,
        time_ns: int,
        limit: int,
        notices: list[Notice],
    ) -> bool:
        """Shut a connection; False if there are too many events to be certain which one it is."""
        try:
            with self._grip.hold(descriptor) as connection:
                if self._read(time_ns, limit, notices):
                    return False
                if self._open.get(descriptor) is victim:
                    connection.shutdown(socket.SHUT_RDWR)
        except OSError:
            pass  # it is gone, and its event is on the way
        victim.is_shut = True
        notices.append(self._notice(code, victim))
        return True

    def _peer_of(self, descriptor: int) -> tuple[str, int]:
        """Return address and port of a connection; unknown if it has gone already."""
        with suppress(OSError), self._grip.hold(descriptor) as connection:
            if connection.family in (socket.AF_INET, socket.AF_INET6):
                host, port, *_ = connection.getpeername()
                return str(host).removeprefix("::ffff:"), int(port)
        return "unknown address", 0
