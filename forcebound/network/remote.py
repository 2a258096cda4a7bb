"""The link between a graph and an environment on another machine: two ports, and who may use them.

::

    graph (controller)                         environment
      queries  PUB ──── PORT ─────────────────▶ SUB
      replies  SUB ◀─── PORT + 1 ────────────── PUB

Either end listens, at both ports; the other connects to both. With keys, both sockets speak CURVE:
the listener proves that it holds the secret of the key that the other end expects, the other end
that it holds one of those that the listener allows. Without keys, only addresses that no other
machine can reach are accepted, unless ``insecure`` says otherwise.

Everything runs in the loop of the process; no thread. The loop waits for
:attr:`RemoteStreams.descriptors` too, and calls :meth:`RemoteStreams.watch` when one is readable or
:attr:`RemoteStreams.due_ns` has come.
"""

from typing import Any

import zmq

from forcebound.errors import ConfigError
from forcebound.network.addresses import Host, resolve
from forcebound.network.connector import Connector
from forcebound.network.ends import RemoteEnd, refuse_exposure
from forcebound.network.listener import Listener
from forcebound.network.monitor import Monitor
from forcebound.network.notices import Notice, NoticeLimit, StreamPairs
from forcebound.network.sockets import Guard, Network, Publisher
from forcebound.network.subscriber import Subscriber
from forcebound.network.zap import ALLOWED, ENDPOINT, REFUSED, Verdict, ZapHandler

EVENT_LIMIT = 200  # events handled in one call of watch, per socket; about 2 ms
LOOK_NS = 1_000_000_000  # watch is due this often, in case a descriptor kept something to itself

KINDS = {
    "listening": "this end waits for the other one",
    "connecting": "this end looks for the other one",
    "connected": "a peer may exchange packets on this stream from now on",
    "disconnected": "such a peer has gone",
    "refused_here": "we refused a peer: its key is not in our list",
    "refused_there": "we were refused: our key is not in the list there, or it is full",
    "wrong_key_of_ours": "a peer expects another public key of ours",
    "wrong_key_there": "the listener ended the handshake, most likely for another key of its own",
    "other_security": "one end uses keys and the other does not",
    "handshake_timeout": "a peer was silent, or too slow, in its handshake",
    "handshake_failed": "what came is not the protocol of ZeroMQ, or ended in its midst",
    "too_many_connections": "a port has as many connections as it takes",
    "protocol_error": "a peer sent a message that is too large, or broke the protocol",
    "no_answer": "no connection for some seconds",
}


class RemoteStreams:
    """The sockets of one end, and who is at the other.

    Args:
        network: Where they are opened and, at the latest, closed.
        end: Which end this is.
        newest_only: Whether only the newest packet counts; else all are given, as for a link with
            an impairment.

    Attributes:
        publisher: What we send goes here: queries of a graph, replies of an environment.
        subscriber: What comes; see :class:`forcebound.network.subscriber.Subscriber`.
        descriptors: To wait for, besides that of ``subscriber``; edge-triggered.
        due_ns: When :meth:`watch` wants to be called at the latest, on the clock it is told.

    Raises:
        ConfigError: If an address cannot be found, used or, without keys, left to others.
    """

    def __init__(self, network: Network, end: RemoteEnd, newest_only: bool = True) -> None:
        host = resolve(end.address)
        refuse_exposure(host, end.address, end.listens, end.key is None and not end.insecure)
        self.end = end
        self.due_ns = 0
        self._first = [_beginning(end)]
        self._pairs = StreamPairs()
        self._limit = NoticeLimit()
        self._network = network
        self._sockets: list[zmq.Socket[bytes]] = []
        self._handler: ZapHandler | None = None
        self._streams: dict[str, Listener | Connector] = {}
        self.descriptors: list[int] = []
        try:
            if end.listens:
                self._open_handler()
            sends = "queries" if end.role == "graph" else "replies"
            opened = {
                stream: self._open(stream, zmq.PUB if stream == sends else zmq.SUB, host, port)
                for stream, port in (("queries", end.port), ("replies", end.port + 1))
            }
        except ConfigError:
            self.close()
            raise
        self.publisher = Publisher(opened.pop(sends))
        self.subscriber = Subscriber(next(iter(opened.values())), newest_only)

    @property
    def connected(self) -> bool:
        """Whether somebody is there on both streams."""
        return all(stream.established > 0 for stream in self._streams.values())

    @property
    def counts(self) -> dict[str, int]:
        """How often each kind of notice has come, also of those that were not said.

        What happened to both streams at once counts once.
        """
        return dict(self._limit.counts)

    def status(self) -> dict[str, Any]:
        """Return how the link is doing, as a map of plain values."""
        return {
            "listens": self.end.listens,
            "address": self.end.address,
            "port": self.end.port,
            "secure": self.end.key is not None,
            "connected": self.connected,
            "peers": {name: stream.peers for name, stream in self._streams.items()},
            "connections": {name: stream.connections for name, stream in self._streams.items()},
            "superseded": self.subscriber.superseded,
            "counts": self.counts,
        }

    def watch(self, time_ns: int) -> list[Notice]:
        """Answer who asks to come in, connect again where it is needed, say what happened.

        Never waits and never raises. What happens to both streams is one notice. Of each kind, the
        first few in ten seconds are returned, then how many more there were.

        Args:
            time_ns: Now, on the monotonic clock.
        """
        notices, self._first = self._first, []
        due = [time_ns + LOOK_NS]
        try:
            if self._handler is not None and self._serve(time_ns, self._handler, notices):
                due.append(time_ns)
            for stream in self._streams.values():
                notices += stream.take(time_ns, EVENT_LIMIT)
                if stream.due_ns is not None:
                    due.append(stream.due_ns)
        except (zmq.ZMQError, OSError) as error:  # none is known; the loop must go on in any case
            notices.append(Notice("handshake_failed", f"a socket of the remote link: {error}"))
        said = self._pairs.pair(time_ns, notices)
        if self._pairs.due_ns is not None:
            due.append(self._pairs.due_ns)
        self.due_ns = min(due)
        return self._limit.admit(time_ns, said)

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
        without_keys = self.end.key is None
        self._handler = ZapHandler(socket, self.end.peers, without_keys, self._has_room)
        self.descriptors.append(self._handler.descriptor)

    def _open(self, stream: str, kind: int, host: Host, port: int) -> "zmq.Socket[bytes]":
        end = self.end
        peer_key, peer_name = next(iter(end.peers.items()), ("", ""))
        guard = (
            Guard(domain=stream, key=end.key)
            if end.listens
            else Guard(key=end.key, listener_key=peer_key)
        )
        endpoint = f"tcp://{host.numeric}:{port}"
        socket, monitored = self._network.guarded(kind, endpoint, bind=end.listens, guard=guard)
        self._sockets += [socket, monitored]  # in the order in which they may be closed
        monitor = Monitor(monitored)
        self.descriptors.append(monitor.descriptor)
        if end.listens:
            self._streams[stream] = Listener(stream, monitor, end.key is not None)
        else:
            own = ("", "") if end.key is None else (end.key.name, end.key.public)
            listener = (peer_name, peer_key)
            self._streams[stream] = Connector(stream, socket, endpoint, monitor, own, listener)
        return socket

    def _has_room(self, stream: str) -> bool:
        listener = self._streams.get(stream)
        return isinstance(listener, Listener) and listener.has_room()

    def _serve(self, time_ns: int, handler: ZapHandler, notices: list[Notice]) -> bool:
        """Decide about those who wait; return whether more may wait."""
        for _ in range(EVENT_LIMIT):
            verdict = handler.serve_one()
            if verdict is None:
                return False
            listener = self._streams.get(verdict.stream)
            if verdict.status == ALLOWED and isinstance(listener, Listener):
                listener.admit(time_ns, verdict)
            else:
                notices.append(self._refusal(verdict))
        return True

    def _refusal(self, verdict: Verdict) -> Notice:
        kind, who = "refused_here", f"{verdict.address} ({verdict.stream})"
        data = {"stream": verdict.stream, "address": verdict.address, "key": verdict.key}
        if verdict.status != REFUSED:
            kind = "too_many_connections"
            why = f"{verdict.name or 'it'} may connect, but this port has as many peers as it takes"
        elif verdict.key:
            where = "environment_keys" if self.end.role == "graph" else "graph_key"
            why = (
                f"its key {verdict.key} is not in the list of who may connect; if it should be, "
                f"name it under {where} in the launch file"
            )
        else:
            why = "it uses another security than this end"
        return Notice(kind, f"refused {who}: {why}", data)


def _beginning(end: RemoteEnd) -> Notice:
    """Return the first notice of an end."""
    keys = "without keys" if end.key is None else f"with the key {end.key.name}"
    ports = f"ports {end.port} (queries) and {end.port + 1} (replies)"
    data = {"address": end.address}
    if end.listens:
        message = f"listening at {end.address}, {ports}, {keys}; no peer yet"
        return Notice("listening", message, data)
    return Notice("connecting", f"connecting to {end.address}, {ports}, {keys}", data)
