"""The connections of a port that listens: established peers, failures, surplus connections.

libzmq's monitor gives little: ACCEPTED and DISCONNECTED name a descriptor, the result of a
handshake names nothing. These facts can be relied on:

1. The events of one socket come in the order in which they happened.
2. HANDSHAKE_FAILED_NO_DETAIL and ..._PROTOCOL are followed at once by the DISCONNECTED of the same
   connection; ..._AUTH is followed by it later. Invalid bytes may give DISCONNECTED alone.
3. A message names the descriptor of its connection and the key of its sender. So a peer is
   established with its first message, the greeting (:class:`forcebound.network.streams.Channel`).
4. A descriptor is closed only after its DISCONNECTED is in the monitor's queue. So if the queue has
   no such event after a duplicate was made, the duplicate is of that connection.

libzmq has no limit on connections, so for each beyond ``MAX_CONNECTIONS`` the oldest that is not
established is shut. If they use up all descriptors between two turns of the loop, libzmq's thread
tries to accept without a pause; so the process may have many more than it needs.

The listener is also ZeroMQ's authenticator (ZAP, RFC 27). libzmq asks it about each peer, after the
peer has proved that it holds the secret of its key, and before any message passes. With
``ZAP_ENFORCE_DOMAIN=1``, a peer that is not explicitly allowed is refused. Status 400 reaches the
refused peer, whose monitor shows it; 300 would leave it waiting for its handshake to time out. Not
``zmq.auth.Authenticator``: its handler is a coroutine, it opens its own socket, and it reports the
address and key of a refused peer only to its log.
"""

import resource
import socket
from contextlib import suppress
from dataclasses import dataclass

import zmq
from zmq.utils import z85

from forcebound.network import limits
from forcebound.network.ends import RemoteEnd
from forcebound.network.monitor import (
    FAILURES,
    OTHER_SECURITY,
    WRONG_KEY,
    MonitoredSocket,
    SocketEvent,
)
from forcebound.network.notices import Notice, gone
from forcebound.network.sockets import Network
from forcebound.network.streams import Greeting

ZAP_ENDPOINT = "inproc://zeromq.zap.01"


@dataclass
class _Connection:
    address: str
    greeting: Greeting | None = None  # once it is established
    is_shut: bool = False


class Listener(MonitoredSocket):
    """A ROUTER that listens at ``endpoint``, and its connections; ConfigError if it cannot."""

    def __init__(self, network: Network, endpoint: str, end: RemoteEnd) -> None:
        # The authenticator comes first: else a peer could connect before it.
        self._requests = network.reply_socket(ZAP_ENDPOINT)
        super().__init__(network, zmq.ROUTER, endpoint, end)
        self.descriptors.append(int(self._requests.FD))
        self._names = end.peers  # by public key; empty: peers without keys are allowed
        self._list_name = "environment_keys" if end.role == "graph" else "graph_key"
        self._open: dict[int, _Connection] = {}  # by descriptor, the oldest first
        self._refused = 0  # handshakes that the authenticator has refused and reported
        self._failure: SocketEvent | None = None
        soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
        resource.setrlimit(resource.RLIMIT_NOFILE, (max(soft, min(hard, limits.DESCRIPTORS)), hard))

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

    def _greet(self, notices: list[Notice]) -> None:
        """Establish the peers that have greeted; all events before that must have been taken."""
        for greeting in self.channel.greetings:
            connection = self._open.get(greeting.descriptor)
            if connection is None:
                continue  # it has gone since
            is_new = connection.greeting is None
            connection.greeting = greeting
            if is_new:
                sentence = f"{self._name(connection)} connected from {connection.address}"
                notices.append(self._notice("connected", sentence, connection))
        self.channel.greetings.clear()
        peers = self._open.values()
        self.channel.set_peers(c.greeting for c in peers if c.greeting is not None)

    def take(self, time_ns: int, limit: int) -> list[Notice]:
        """Admit or refuse peers, take events, shut surplus connections: up to ``limit`` of each."""
        notices: list[Notice] = []
        has_more = self._decide(limit, notices)
        has_more |= self._read(limit, notices)
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
        self._greet(notices)
        self.due_ns = time_ns if has_more else None
        return notices

    def _decide(self, limit: int, notices: list[Notice]) -> bool:
        """Decide about peers that wait; return whether the limit ended it."""
        for _ in range(limit):
            try:
                frames = self._requests.recv_multipart(zmq.DONTWAIT)
            except zmq.Again:
                return False
            version, request, _, peer, _, mechanism, *credentials = frames
            key = z85.encode(credentials[0]).decode("ascii") if mechanism == b"CURVE" else ""
            is_allowed = key in self._names if self._names else mechanism == b"NULL"
            is_allowed = is_allowed and version == b"1.0"
            status, user = (b"200", key.encode()) if is_allowed else (b"400", b"")
            answer = [b"1.0", request, status, b"", user, b""]
            self._requests.send_multipart(answer, zmq.DONTWAIT)
            if not is_allowed:
                address = peer.decode("ascii").removeprefix("::ffff:")
                cause = (
                    f"its key {key} is not in the list of allowed keys; to admit it, name it under "
                    f"{self._list_name} in the launch file"
                )
                if not key:
                    cause = "it uses another security than this end"
                data = {"address": address, "key": key}
                notices.append(Notice("refused_here", f"refused {address}: {cause}", data))
        return True

    def _read(self, limit: int, notices: list[Notice]) -> bool:
        """Handle events; return whether the limit ended it."""
        for _ in range(limit):
            event = self.next_event()
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
