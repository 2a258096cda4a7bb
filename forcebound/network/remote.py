"""The link between a graph and an environment on another machine: one port, and its peers.

::

    graph (controller)            environment
      ROUTER  ◀────── PORT ─────── DEALER      the graph listens
      DEALER  ─────── PORT ──────▶ ROUTER      the environment listens

The end that listens is the ROUTER, the one that connects the DEALER. With keys, they speak CURVE:
the listener proves that it holds the secret of the key that the other end expects, and the other
end that it holds one of the keys that the listener allows. Without keys, only addresses that no
other machine can reach are accepted, unless ``insecure`` is set.

Everything runs in the loop of the process; no thread. The loop also waits for
:attr:`RemoteLink.descriptors`, and calls :meth:`RemoteLink.watch` when one is readable or
:attr:`RemoteLink.due_ns` has come.
"""

from typing import Any

import zmq

from forcebound.errors import ConfigError
from forcebound.network.addresses import resolve
from forcebound.network.channel import Channel
from forcebound.network.connector import Connector
from forcebound.network.ends import RemoteEnd, refuse_exposure
from forcebound.network.listener import Listener
from forcebound.network.monitor import Monitor
from forcebound.network.notices import Notice, NoticeLimit
from forcebound.network.sockets import Guard, Network
from forcebound.network.zap import ENDPOINT, Verdict, ZapHandler

EVENT_LIMIT = 200  # events handled in one call of watch; about 2 ms
LOOK_NS = 1_000_000_000  # watch is due this often: to greet, and in case a descriptor stayed silent
_DOMAIN = "remote"  # of the authenticator


class RemoteLink:
    """The socket of one end, and its peers.

    Ask ``channel`` whether something is pending before you wait for its descriptor.

    Raises:
        ConfigError: If an address cannot be found or used, or is open to others without keys.
    """

    def __init__(self, network: Network, end: RemoteEnd) -> None:
        host = resolve(end.address)
        refuse_exposure(host, end.address, end.listens, end.key is None and not end.insecure)
        self.end = end
        self._due_ns = 0
        keys = "without keys" if end.key is None else f"with the key {end.key.name}"
        verb = "listening at" if end.listens else "connecting to"
        sentence = f"{verb} {end.address} port {end.port}, {keys}"
        data = {"address": end.address, "port": str(end.port), "keys": keys}
        self._first = [Notice("opened", sentence, data)]
        self._limit = NoticeLimit()
        self._network = network
        self._sockets: list[zmq.Socket[bytes]] = []
        self._handler: ZapHandler | None = None
        self.descriptors: list[int] = []  # besides that of the channel; edge-triggered
        endpoint = f"tcp://{host.numeric}:{end.port}"
        try:
            if end.listens:  # the authenticator comes first: else a peer could connect before it
                self._open_handler()
            socket, monitor = self._open(endpoint)
        except ConfigError:
            self.close()
            raise
        self._peer: Listener | Connector
        if end.listens:
            self._peer = Listener(monitor, end.peers)
        else:
            self._peer = Connector(socket, endpoint, monitor, end)
        self.channel = Channel(socket)
        self.send = self.channel.send  # to every peer

    @property
    def connected(self) -> bool:
        """Whether a peer is there."""
        return bool(self._peer.peers)

    @property
    def due_ns(self) -> int:
        """When :meth:`watch` should be called at the latest, on the clock that it is given."""
        return 0 if self.channel.greetings else self._due_ns

    def status(self) -> dict[str, Any]:
        """Return the state of the link, as a map of plain values."""
        return {
            "listens": self.end.listens,
            "address": self.end.address,
            "port": self.end.port,
            "secure": self.end.key is not None,
            "connected": self.connected,
            "peers": self._peer.peers,
            "connections": self._peer.connections,
            "counts": dict(self._limit.counts),  # by kind, also of notices that were not reported
        }

    def watch(self, time_ns: int) -> list[Notice]:
        """Admit or refuse peers, connect again where it is needed, report what happened.

        Never waits and never raises. Of each kind of notice, the first few in ten seconds are
        returned, then how many more there were.
        """
        notices, self._first = self._first, []
        due = [time_ns + LOOK_NS]
        try:
            if self._handler is not None and self._serve(self._handler, notices):
                due.append(time_ns)
            notices += self._peer.take(time_ns, EVENT_LIMIT)
            notices += self._peer.greet(self.channel)
            if self._peer.due_ns is not None:
                due.append(self._peer.due_ns)
        except (zmq.ZMQError, OSError) as error:  # none is known; the loop must go on in any case
            notices.append(Notice("handshake_failed", f"a socket of the remote link: {error}"))
        self._due_ns = min(due)
        return self._limit.admit(time_ns, notices)

    def close(self) -> None:
        """Close the sockets; the network closes them, too."""
        if self._handler is not None:
            self._handler.close()
        self._network.release(self._sockets)
        self._sockets.clear()

    def _open_handler(self) -> None:
        socket = self._network.reply_socket(ENDPOINT)
        self._sockets.append(socket)
        self._handler = ZapHandler(socket, self.end.peers)
        self.descriptors.append(self._handler.descriptor)

    def _open(self, endpoint: str) -> "tuple[zmq.Socket[bytes], Monitor]":
        end = self.end
        kind, guard = zmq.ROUTER, Guard(domain=_DOMAIN, key=end.key)
        if not end.listens:
            kind, guard = zmq.DEALER, Guard(key=end.key, listener_key=next(iter(end.peers), ""))
        socket, monitored = self._network.guarded(kind, endpoint, bind=end.listens, guard=guard)
        self._sockets += [socket, monitored]  # in the order in which they may be closed
        monitor = Monitor(monitored)
        self.descriptors.append(monitor.descriptor)
        return socket, monitor

    def _serve(self, handler: ZapHandler, notices: list[Notice]) -> bool:
        """Decide about the peers that wait; return whether more may wait."""
        for _ in range(EVENT_LIMIT):
            verdict = handler.serve_one()
            if verdict is None:
                return False
            if not verdict.is_allowed:
                notices.append(self._refusal(verdict))
        return True

    def _refusal(self, verdict: Verdict) -> Notice:
        address, key = verdict.address, verdict.key
        if not key:
            cause = "it uses another security than this end"
        else:
            names = "environment_keys" if self.end.role == "graph" else "graph_key"
            cause = (
                f"its key {key} is not in the list of allowed keys; to admit it, name it under "
                f"{names} in the launch file"
            )
        return Notice(
            "refused_here", f"refused {address}: {cause}", {"address": address, "key": key}
        )
