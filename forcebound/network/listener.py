"""Who is connected to a port that listens, and what of it is worth saying.

libzmq's monitor tells less than one would like: ACCEPTED and DISCONNECTED name a descriptor, the
result of a handshake names nothing. What can be relied on:

1. The events of one socket come in the order in which they happened.
2. HANDSHAKE_FAILED_NO_DETAIL and ..._PROTOCOL are followed at once by the DISCONNECTED of the same
   connection; ..._AUTH is followed by it later. Garbage may give DISCONNECTED alone.
3. The address of a peer that the authenticator let in. HANDSHAKE_SUCCEEDED is given to the newest
   connection from there. With several at the same moment that is a guess; if it was wrong, the
   failure of that connection shows it, and the next one gets the name.
4. A descriptor is closed only after its DISCONNECTED is in the monitor's queue. So a duplicate of
   it, made before a look at the queue that finds no such event, is of that connection for sure.

libzmq has no limit on connections. Here, beyond ``MAX_CONNECTIONS``, the oldest that is not
established is shut (4 makes sure that no other is hit): whoever holds a key is through its
handshake in milliseconds, whoever holds none can only wait.
"""

import os
import socket
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass

import zmq

from forcebound.network.monitor import CRYPTOGRAPHIC, MISMATCH, Monitor, SocketEvent
from forcebound.network.notices import Notice
from forcebound.network.sockets import (
    HANDSHAKE_MS,
    HANDSHAKE_TIMEOUT_NS,
    HEARTBEAT_TIMEOUT_MS,
    MAX_FRAME,
)
from forcebound.network.zap import Verdict

MAX_CONNECTIONS = 64  # of one port, established or not
MAX_PEERS = 16  # established ones of one port


@dataclass
class _Connection:
    address: str
    port: int
    since_ns: int
    peer: Verdict | None = None  # once it is established
    is_shut: bool = False

    def __str__(self) -> str:
        host = f"[{self.address}]" if ":" in self.address else self.address
        return f"{host}:{self.port}" if self.port else host


class Listener:
    """The connections of one listening socket.

    Args:
        stream: What travels there: ``"queries"`` or ``"replies"``.
        monitor: Of the socket.
        with_keys: Whether the socket speaks CURVE.
    """

    def __init__(self, stream: str, monitor: Monitor, with_keys: bool) -> None:
        self.stream = stream
        self._monitor = monitor
        self._with_keys = with_keys
        self._open: dict[int, _Connection] = {}
        self._admitted: deque[tuple[int, Verdict]] = deque(maxlen=MAX_CONNECTIONS)
        self._refused = 0
        self._failure: SocketEvent | None = None
        self.due_ns: int | None = None

    @property
    def established(self) -> int:
        """Number of peers that may exchange packets now."""
        return sum(connection.peer is not None for connection in self._open.values())

    @property
    def connections(self) -> int:
        """Number of connections, established or not."""
        return len(self._open)

    @property
    def peers(self) -> list[str]:
        """Names, keys or addresses of the established peers."""
        return [_name(c.peer) for c in self._open.values() if c.peer is not None]

    def admit(self, time_ns: int, verdict: Verdict) -> None:
        """Remember that the authenticator let a peer in, whose handshake will succeed."""
        self._admitted.append((time_ns, verdict))

    def has_room(self) -> bool:
        """Whether one more peer may come."""
        return self.established + len(self._admitted) < MAX_PEERS

    def take(self, time_ns: int, limit: int) -> list[Notice]:
        """Take up to ``limit`` events; :attr:`due_ns` tells whether there may be more."""
        notices: list[Notice] = []
        self.due_ns = time_ns if self._read(time_ns, limit, notices) else None
        # After the events: a peer that is through may have waited here for longer than that.
        while self._admitted and self._admitted[0][0] < time_ns - HANDSHAKE_MS * 1_000_000:
            self._admitted.popleft()
        while sum(not c.is_shut for c in self._open.values()) > MAX_CONNECTIONS:
            if not self._shut_one(time_ns, limit, notices):
                self.due_ns = time_ns
                break
        return notices

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
            self._open[event.value] = _Connection(*_peer_of(event.value), time_ns)
        elif event.kind == zmq.EVENT_HANDSHAKE_SUCCEEDED and self._admitted:
            return self._name_newest(self._admitted.popleft()[1])
        elif event.kind == zmq.EVENT_HANDSHAKE_FAILED_AUTH:
            self._refused += 1  # the authenticator has said why
        elif event.kind in (
            zmq.EVENT_HANDSHAKE_FAILED_NO_DETAIL,
            zmq.EVENT_HANDSHAKE_FAILED_PROTOCOL,
        ):
            self._failure = event
        elif event.kind == zmq.EVENT_DISCONNECTED:
            return self._lose(time_ns, event.value)
        return []

    def _name_newest(self, peer: Verdict) -> list[Notice]:
        unnamed = [c for c in self._open.values() if c.peer is None]
        same = [c for c in unnamed if c.address == peer.address] or unnamed
        if not same:
            return []
        same[-1].peer = peer
        message = f"{_name(peer)} connected from {same[-1]} ({self.stream})"
        return [Notice("connected", message, self._data(same[-1], peer))]

    def _lose(self, time_ns: int, descriptor: int) -> list[Notice]:
        failure, self._failure = self._failure, None
        connection = self._open.pop(descriptor, None)
        if connection is None:
            return []
        if connection.is_shut and connection.peer is None:
            if failure is None and self._refused:  # it was refused just before
                self._refused -= 1
            return []
        peer = connection.peer
        if failure is not None:
            if peer is not None:  # it had the name of another one
                self._name_newest(peer)
            return [self._failed(time_ns, connection, failure)]
        if peer is not None:
            message = (
                f"{_name(peer)} at {connection} ({self.stream}) has gone: it left, was silent for "
                f"{HEARTBEAT_TIMEOUT_MS} ms, or sent a message of over {MAX_FRAME} bytes"
            )
            return [Notice("disconnected", message, self._data(connection, peer))]
        if self._refused:
            self._refused -= 1
            return []
        return [self._failed(time_ns, connection, SocketEvent(0, 0))]

    def _failed(self, time_ns: int, connection: _Connection, failure: SocketEvent) -> Notice:
        kind = "handshake_failed"
        why = "it does not speak ZMTP, the protocol of ZeroMQ, or left in its midst"
        if failure.kind == zmq.EVENT_HANDSHAKE_FAILED_PROTOCOL and failure.value == CRYPTOGRAPHIC:
            kind = "wrong_key_of_ours"
            why = "it expects another public key of ours than we have: give it the right one"
        elif failure.kind == zmq.EVENT_HANDSHAKE_FAILED_PROTOCOL and failure.value == MISMATCH:
            kind = "other_security"
            why = (
                "it uses no keys (CURVE)"
                if self._with_keys
                else "it uses keys (CURVE), which this end does not (insecure, or without keys)"
            )
        elif failure.kind and time_ns - connection.since_ns >= HANDSHAKE_TIMEOUT_NS:
            kind = "handshake_timeout"
            why = f"it was not through its handshake in {HANDSHAKE_MS / 1000:g} s"
        elif failure.kind == zmq.EVENT_HANDSHAKE_FAILED_NO_DETAIL:
            why = (
                "it left during the handshake, "
                + ("as one that uses no keys does" if self._with_keys else "as one with keys does")
                + ", or as one that does not speak ZMTP"
            )
        message = f"ended the connection of {connection} ({self.stream}): {why}"
        return Notice(kind, message, self._data(connection, None))

    def _data(self, connection: _Connection, peer: Verdict | None) -> dict[str, str]:
        data = {"stream": self.stream, "address": str(connection)}
        return data if peer is None else {**data, "key": peer.key, "name": peer.name}

    def _shut_one(self, time_ns: int, limit: int, notices: list[Notice]) -> bool:
        """Shut the oldest connection that is not established; if all are, the newest.

        Return False if there are too many events to be certain which connection that would hit.
        """
        alive = [(fd, c) for fd, c in self._open.items() if not c.is_shut]
        descriptor, victim = next(((fd, c) for fd, c in alive if c.peer is None), alive[-1])
        try:
            with _duplicate(descriptor) as connection:
                if self._read(time_ns, limit, notices):
                    return False
                if self._open.get(descriptor) is victim:
                    connection.shutdown(socket.SHUT_RDWR)
        except OSError:
            pass  # it is gone, and its event is on the way
        victim.is_shut = True
        why = f"this port has more than {MAX_CONNECTIONS} connections"
        message = f"ended the connection of {victim} ({self.stream}): {why}"
        notices.append(Notice("too_many_connections", message, self._data(victim, victim.peer)))
        return True


def _name(peer: Verdict) -> str:
    return f"{peer.name} (key {peer.key})" if peer.key else "a peer without keys"


@contextmanager
def _duplicate(descriptor: int) -> Iterator[socket.socket]:
    """Hold on to the connection behind a descriptor, which libzmq may close at any time."""
    duplicate = os.dup(descriptor)
    try:
        connection = socket.socket(fileno=duplicate)
    except OSError:
        os.close(duplicate)
        raise
    with connection:
        yield connection


def _peer_of(descriptor: int) -> tuple[str, int]:
    """Return address and port of a connection; unknown if it has gone already."""
    with suppress(OSError), _duplicate(descriptor) as connection:
        if connection.family in (socket.AF_INET, socket.AF_INET6):
            host, port, *_ = connection.getpeername()
            return str(host).removeprefix("::ffff:"), int(port)
    return "unknown address", 0
