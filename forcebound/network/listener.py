"""The connections of a port that listens: established peers, failures, surplus connections.

libzmq's monitor gives little: ACCEPTED and DISCONNECTED name a descriptor, the result of a
handshake names nothing. These facts can be relied on:

1. The events of one socket come in the order in which they happened.
2. HANDSHAKE_FAILED_NO_DETAIL and ..._PROTOCOL are followed at once by the DISCONNECTED of the same
   connection; ..._AUTH is followed by it later. Invalid bytes may give DISCONNECTED alone.
3. A message names the descriptor of its connection and the key of its sender. So a peer is
   established with its first message, the greeting (:mod:`forcebound.network.channel`).
4. A descriptor is closed only after its DISCONNECTED is in the monitor's queue. So if the queue has
   no such event after a duplicate was made, the duplicate is of that connection.

libzmq has no limit on connections, so for each beyond ``MAX_CONNECTIONS`` the oldest that is not
established is shut. If they use up all descriptors between two turns of the loop, libzmq's thread
tries to accept without a pause; so the process may have many more than it needs.
"""

import resource
import socket
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass

import zmq

from forcebound.network import limits
from forcebound.network.channel import Channel, Greeting
from forcebound.network.monitor import FAILURES, OTHER_SECURITY, WRONG_KEY, Monitor, SocketEvent
from forcebound.network.notices import Notice, gone


@dataclass
class _Connection:
    address: str
    greeting: Greeting | None = None  # once it is established
    is_shut: bool = False


class Listener:
    """The connections of one listening socket; ``names`` of the peers by public key, if any."""

    def __init__(self, monitor: Monitor, names: Mapping[str, str]) -> None:
        self._monitor = monitor
        self._names = names
        self._open: dict[int, _Connection] = {}  # by descriptor, the oldest first
        self._refused = 0  # handshakes that the authenticator has refused and reported
        self._failure: SocketEvent | None = None
        soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
        resource.setrlimit(resource.RLIMIT_NOFILE, (max(soft, min(hard, limits.DESCRIPTORS)), hard))
        self.due_ns: int | None = None  # when to call :meth:`take` even if nothing happens

    @property
    def connections(self) -> int:
        """Number of connections, established or not."""
        return len(self._open)

    @property
    def peers(self) -> list[str]:
        """Names and keys, or addresses, of the established peers."""
        return [
            self._name(connection) if connection.greeting.key else connection.address
            for connection in self._open.values()
            if connection.greeting is not None
        ]

    def greet(self, channel: Channel) -> list[Notice]:
        """Establish the peers that have greeted; all events before that must have been taken."""
        notices = []
        for greeting in channel.greetings:
            connection = self._open.get(greeting.descriptor)
            if connection is None:
                continue  # it has gone since
            is_new = connection.greeting is None
            connection.greeting = greeting
            if is_new:
                sentence = f"{self._name(connection)} connected from {connection.address}"
                notices.append(self._notice("connected", sentence, connection))
        channel.greetings.clear()
        peers = self._open.values()
        channel.set_peers(c.greeting for c in peers if c.greeting is not None)
        return notices

    def take(self, time_ns: int, limit: int) -> list[Notice]:
        """Take up to ``limit`` events, and shut up to ``limit`` surplus connections."""
        notices: list[Notice] = []
        has_more = self._read(limit, notices)
        alive = [entry for entry in self._open.items() if not entry[1].is_shut]
        surplus = min(len(alive) - limits.MAX_CONNECTIONS, limit)
        if surplus > 0:
            # The oldest that are not established; then, of those that are, the newest.
            victims = [entry for entry in alive if entry[1].greeting is None]
            victims += [entry for entry in reversed(alive) if entry[1].greeting is not None]
            has_more = True
            for descriptor, victim in victims[:surplus]:
                if not self._shut(descriptor, victim, limit, notices):
                    break
        self.due_ns = time_ns if has_more else None
        return notices

    def _read(self, limit: int, notices: list[Notice]) -> bool:
        """Handle events; return whether the limit ended it."""
        for _ in range(limit):
            event = self._monitor.take()
            if event is None:
                return False
            if event.kind == zmq.EVENT_ACCEPTED:
                self._open[event.value] = _Connection(_address_of(event.value))
            elif event.kind == zmq.EVENT_HANDSHAKE_FAILED_AUTH:
                self._refused += 1
            elif event.kind == zmq.EVENT_DISCONNECTED:
                notices += self._lose(event.value)
            elif event.kind in FAILURES:
                self._failure = event
        return True

    def _lose(self, descriptor: int) -> list[Notice]:
        failure, self._failure = self._failure, None
        connection = self._open.pop(descriptor, None)
        if connection is None:
            return []
        if connection.greeting is not None:
            sentence = gone(self._name(connection), connection.address)
            return [self._notice("disconnected", sentence, connection)]
        if failure is None and self._refused:
            self._refused -= 1
            return []
        if connection.is_shut:
            return []
        ours, theirs = ("keys", "no keys") if self._names else ("no keys", "keys")
        kind = "handshake_failed"
        cause = (
            f"it was silent for {limits.HANDSHAKE_MS / 1000:g} s, left during the handshake, uses "
            f"{theirs}, or does not speak ZMTP, the protocol of ZeroMQ"
        )
        if failure == WRONG_KEY:
            kind, cause = "wrong_key", "it expects another public key of ours"
        elif failure == OTHER_SECURITY:
            kind, cause = "other_security", f"it uses {theirs} (CURVE), and we use {ours}"
        sentence = f"no connection with {connection.address}: {cause}"
        return [self._notice(kind, sentence, connection)]

    def _name(self, connection: _Connection) -> str:
        key = "" if connection.greeting is None else connection.greeting.key
        return f"{self._names.get(key, '')} (key {key})" if key else "a peer without keys"

    def _notice(self, kind: str, sentence: str, connection: _Connection) -> Notice:
        data = {"address": connection.address}
        if connection.greeting is not None:
            key = connection.greeting.key
            data |= {"key": key, "name": self._names.get(key, "")}
        return Notice(kind, sentence, data)

    def _shut(
        self, descriptor: int, victim: _Connection, limit: int, notices: list[Notice]
    ) -> bool:
        """Shut a connection; False if there are too many events to be certain which one it is."""
        with suppress(OSError), _duplicate(descriptor) as connection:  # an error: it is gone
            if self._read(limit, notices):
                return False
            if self._open.get(descriptor) is victim:
                connection.shutdown(socket.SHUT_RDWR)
        victim.is_shut = True
        sentence = (
            f"ended the connection of {victim.address}: this port has more than "
            f"{limits.MAX_CONNECTIONS} connections"
        )
        notices.append(self._notice("too_many_connections", sentence, victim))
        return True


def _address_of(descriptor: int) -> str:
    """Return address and port of a connection; unknown if it has gone already."""
    with suppress(OSError), _duplicate(descriptor) as connection:
        name = connection.getpeername()
        if isinstance(name, tuple):  # else it is of another socket by now, such as one of ipc
            host = str(name[0]).removeprefix("::ffff:")
            return f"[{host}]:{name[1]}" if ":" in host else f"{host}:{name[1]}"
    return "unknown address"


def _duplicate(descriptor: int) -> socket.socket:
    """Return a duplicate of a connection, which libzmq may close at any time; else OSError."""
    return socket.fromfd(descriptor, socket.AF_INET6, socket.SOCK_STREAM)
