"""The connections of a port that listens: peers that are established, and those that failed.

libzmq's monitor gives little: ACCEPTED and DISCONNECTED name a descriptor, the result of a
handshake names nothing. These facts can be relied on:

1. The events of one socket come in the order in which they happened.
2. HANDSHAKE_FAILED_NO_DETAIL and ..._PROTOCOL are followed at once by the DISCONNECTED of the same
   connection; ..._AUTH is followed by it later. Invalid bytes may give DISCONNECTED alone.
3. A message names the descriptor of its connection, the address and the key of its sender. So a
   peer is established with its first message, the greeting
   (:class:`forcebound.network.streams.Channel`).

The number of connections is limited by the descriptors of the process alone; each without a
handshake is closed after ``HANDSHAKE_MS``. If a flood uses all descriptors up, no new peer is
accepted until then, and those that are established stay.

The listener is also ZeroMQ's authenticator (ZAP, RFC 27). libzmq asks it about each peer, after the
peer has proved that it holds the secret of its key, and before any message passes. With
``ZAP_ENFORCE_DOMAIN=1``, a peer that is not explicitly allowed is refused. Status 400 reaches the
refused peer, whose monitor shows it; 300 would leave it waiting for its handshake to time out. Not
``zmq.auth.Authenticator``: its handler is a coroutine, it opens its own socket, and it reports the
address and key of a refused peer only to its log.
"""

import resource

import zmq
from zmq.utils import z85

from forcebound.network import limits
from forcebound.network.ends import RemoteEnd
from forcebound.network.monitor import EVENT_LIMIT, FAILURES, MonitoredSocket, SocketEvent, gone
from forcebound.network.notices import Notice
from forcebound.network.sockets import Network
from forcebound.network.streams import Greeting

ZAP_ENDPOINT = "inproc://zeromq.zap.01"


class Listener(MonitoredSocket):
    """A ROUTER that listens at ``endpoint``, and its connections; ConfigError if it cannot."""

    def __init__(self, network: Network, endpoint: str, end: RemoteEnd) -> None:
        # The authenticator comes first: else a peer could connect before it.
        self._requests = network.reply_socket(ZAP_ENDPOINT)
        super().__init__(network, zmq.ROUTER, endpoint, end)
        self.descriptors.append(int(self._requests.FD))
        # Connections by descriptor, the oldest first; with a greeting if they are established.
        self._open: dict[int, Greeting | None] = {}
        self._refused = 0  # handshakes that the authenticator has refused and reported
        self._failure: SocketEvent | None = None
        soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
        resource.setrlimit(resource.RLIMIT_NOFILE, (max(soft, min(hard, limits.DESCRIPTORS)), hard))

    @property
    def peers(self) -> list[str]:
        """Names and keys, or addresses, of the established peers."""
        greetings = filter(None, self._open.values())
        return [self._named(peer.key) if peer.key else peer.address for peer in greetings]

    def _look(self, time_ns: int) -> list[Notice]:
        """Decide about peers that wait; establish those that have greeted."""
        notices: list[Notice] = []
        for _ in range(EVENT_LIMIT):
            try:
                request = self._requests.recv_multipart(zmq.DONTWAIT)
            except zmq.Again:
                break
            notices += self._decide(*request)
        else:
            self.due_ns = time_ns
        for greeting in self.channel.greetings:
            descriptor, address, key = greeting.descriptor, greeting.address, greeting.key
            if descriptor not in self._open:
                continue  # it has gone since
            if self._open[descriptor] is None:
                sentence = f"{self._named(key)} connected from {address}"
                notices.append(self._notice("connected", sentence, address, key))
            self._open[descriptor] = greeting
        self.channel.greetings.clear()
        self.channel.set_peers(filter(None, self._open.values()))
        return notices

    def _decide(
        self,
        version: bytes,
        request: bytes,
        domain: bytes,
        peer: bytes,
        identity: bytes,
        mechanism: bytes,
        *credentials: bytes,
    ) -> list[Notice]:
        """Answer a request of ZAP."""
        key = z85.encode(credentials[0]).decode("ascii") if mechanism == b"CURVE" else ""
        names = self._end.peers  # by public key; empty: peers without keys are allowed
        is_allowed = version == b"1.0" and (key in names if names else mechanism == b"NULL")
        status, user = (b"200", key.encode()) if is_allowed else (b"400", b"")
        self._requests.send_multipart([b"1.0", request, status, b"", user, b""], zmq.DONTWAIT)
        if is_allowed:
            return []
        address = peer.decode("ascii").removeprefix("::ffff:")
        used = f"key {key}" if key else "with another security than ours"
        return [self._notice("refused_here", f"{address}, {used}", address, key)]

    def _handle(self, time_ns: int, event: SocketEvent) -> list[Notice]:
        if event.kind == zmq.EVENT_ACCEPTED:
            self._open[event.value] = None
        elif event.kind == zmq.EVENT_HANDSHAKE_FAILED_AUTH:
            self._refused += 1
        elif event.kind in FAILURES:
            self._failure = event
        elif event.kind == zmq.EVENT_DISCONNECTED and event.value in self._open:
            failure, self._failure = self._failure, None
            greeting = self._open.pop(event.value)
            if greeting is not None:
                address, key = greeting.address, greeting.key
                sentence = gone(self._named(key), address)
                return [self._notice("disconnected", sentence, address, key)]
            if failure is not None or not self._refused:
                return [self._notice("handshake_failed", self._cause(failure))]
            self._refused -= 1
        return []
