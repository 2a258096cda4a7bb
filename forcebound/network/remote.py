"""The link between a graph and an environment on another machine: one port, and who may use it.

::

    graph (controller)            environment
      ROUTER  ◀────── PORT ─────── DEALER      the graph listens
      DEALER  ─────── PORT ──────▶ ROUTER      the environment listens

The end that listens is the ROUTER, the one that connects the DEALER. With keys, they speak CURVE:
the listener proves that it holds the secret of the key that the other end expects, the other end
that it holds one of those that the listener allows. Without keys, only addresses that no other
machine can reach are accepted, unless ``insecure`` is set.

Everything runs in the loop of the process; no thread. The loop waits for
:attr:`RemoteLink.descriptors` too, and calls :meth:`RemoteLink.watch` when one is readable or
:attr:`RemoteLink.due_ns` has come.
"""

from typing import Any

import zmq

from forcebound.errors import ConfigError
from forcebound.network import limits
from forcebound.network.addresses import resolve
from forcebound.network.channel import Channel
from forcebound.network.connector import Connector
from forcebound.network.descriptors import most_connections
from forcebound.network.ends import RemoteEnd, refuse_exposure
from forcebound.network.listener import Listener
from forcebound.network.monitor import Monitor
from forcebound.network.notices import Notice, NoticeLimit
from forcebound.network.sockets import Guard, Network
from forcebound.network.zap import ALLOWED, ENDPOINT, FULL, Verdict, ZapHandler

EVENT_LIMIT = 200  # events handled in one call of watch; about 2 ms
LOOK_NS = 1_000_000_000  # watch is due this often: to greet, and in case a descriptor stayed silent
_DOMAIN = "remote"  # of the authenticator


class RemoteLink:
    """The socket of one end, and who is at the other.

    Args:
        network: Where it is opened and, at the latest, closed.
        end: Which end this is.
        newest_only: Whether only the newest packet of a peer counts; else all are given, as for a
            link with an impairment.

    Attributes:
        send: Sends a packet to who is there: queries of a graph, replies of an environment.
        channel: What comes, and from whom. To be asked whether something is pending before its
            descriptor is waited for.
        descriptors: To wait for, besides that of ``channel``; edge-triggered.

    Raises:
        ConfigError: If an address cannot be found, used or, without keys, left to others.
    """

    def __init__(self, network: Network, end: RemoteEnd, newest_only: bool = True) -> None:
        host = resolve(end.address)
        refuse_exposure(host, end.address, end.listens, end.key is None and not end.insecure)
        self.end = end
        self._due_ns = self._looked_ns = 0
        keys = "without keys" if end.key is None else f"with the key {end.key.name}"
        where = {"address": end.address, "port": str(end.port), "keys": keys}
        self._first = [Notice("listening" if end.listens else "connecting", where)]
        self._limit = NoticeLimit()
        self._network = network
        self._sockets: list[zmq.Socket[bytes]] = []
        self._handler: ZapHandler | None = None
        self.descriptors: list[int] = []
        endpoint = f"tcp://{host.numeric}:{end.port}"
        most = most_connections()  # before others may take all descriptors
        try:
            if end.listens:
                self._open_handler()
            socket, monitor = self._open(endpoint)
        except ConfigError:
            self.close()
            raise
        self._peer: Listener | Connector
        if end.listens:
            self._peer = Listener(monitor, end.peers, most)
        else:
            own = ("", "") if end.key is None else (end.key.name, end.key.public)
            key, name = next(iter(end.peers.items()), ("", ""))
            self._peer = Connector(socket, endpoint, monitor, own, (name, key))
        self.channel = Channel(socket, newest_only)
        self.send = self.channel.send

    @property
    def connected(self) -> bool:
        """Whether somebody is there."""
        return self._peer.established > 0

    @property
    def due_ns(self) -> int:
        """When :meth:`watch` wants to be called at the latest, on the clock that it is given."""
        return 0 if self.channel.greetings else self._due_ns

    def status(self) -> dict[str, Any]:
        """Return how the link is doing, as a map of plain values."""
        return {
            "listens": self.end.listens,
            "address": self.end.address,
            "port": self.end.port,
            "secure": self.end.key is not None,
            "connected": self.connected,
            "peers": self._peer.peers,
            "connections": self._peer.connections,
            "superseded": self.channel.superseded,
            "counts": dict(self._limit.counts),  # by kind, also of notices that were not reported
        }

    def watch(self, time_ns: int) -> list[Notice]:
        """Answer who asks to come in, connect again where it is needed, report what happened.

        Never waits and never raises. Of each kind of notice, the first few in ten seconds are
        returned, then how many more there were.

        Args:
            time_ns: Now, on the monotonic clock.
        """
        notices, self._first = self._first, []
        due = [time_ns + LOOK_NS]
        try:
            if self._handler is not None and self._serve(self._handler, notices):
                due.append(time_ns)
            notices += self._peer.take(time_ns, EVENT_LIMIT)
            notices += self._peer.greet(self.channel)
            if self._peer.connections:
                due.append(self._look(time_ns, notices))
            if self._peer.due_ns is not None:
                due.append(self._peer.due_ns)
        except (zmq.ZMQError, OSError) as error:  # none is known; the loop must go on in any case
            notices.append(Notice("socket_error", {"error": str(error)}))
        self._due_ns = min(due)
        return self._limit.admit(time_ns, notices)

    def _look(self, time_ns: int, notices: list[Notice]) -> int:
        """Look for messages without an end; return when to look again, in ns."""
        if time_ns - self._looked_ns >= limits.UNFINISHED_LOOK_NS:
            self._looked_ns = time_ns
            notices += self._peer.look(time_ns, EVENT_LIMIT, self.channel.heard)
            self.channel.heard.clear()
        return self._looked_ns + limits.UNFINISHED_LOOK_NS

    def close(self) -> None:
        """Close the sockets; the network closes them, too."""
        if self._handler is not None:
            self._handler.close()
        self._network.release(self._sockets)
        self._sockets.clear()

    def _open_handler(self) -> None:
        """Let nobody listen before the one who decides who comes in."""
        socket = self._network.reply_socket(ENDPOINT)
        self._sockets.append(socket)
        self._handler = ZapHandler(socket, self.end.peers, self._has_room)
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

    def _has_room(self) -> bool:
        return self._peer.established < limits.MAX_PEERS

    def _serve(self, handler: ZapHandler, notices: list[Notice]) -> bool:
        """Decide about those who wait; return whether more may wait."""
        for _ in range(EVENT_LIMIT):
            verdict = handler.serve_one()
            if verdict is None:
                return False
            if verdict.status != ALLOWED:
                notices.append(self._refusal(verdict))
        return True

    def _refusal(self, verdict: Verdict) -> Notice:
        data = {"address": verdict.address, "key": verdict.key, "name": verdict.name}
        if verdict.status == FULL:
            return Notice("full", data)
        data["list"] = "environment_keys" if self.end.role == "graph" else "graph_key"
        return Notice("unknown_key" if verdict.key else "no_key", data)
