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

import zmq

from forcebound.messages.control import RemoteStatus
from forcebound.network.addresses import resolve
from forcebound.network.connector import Connector
from forcebound.network.ends import RemoteEnd, refuse_exposure
from forcebound.network.listener import Listener
from forcebound.network.notices import Notice, NoticeLimit
from forcebound.network.sockets import Network

LOOK_NS = 1_000_000_000  # watch is due this often: to greet, and in case a descriptor stayed silent


class RemoteLink:
    """The socket of one end, and its peers; the network closes it.

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
        peer = Listener if end.listens else Connector
        self._peer = peer(network, f"tcp://{host.numeric}:{end.port}", end)
        self.descriptors = self._peer.descriptors  # besides that of the channel; edge-triggered
        self.channel = self._peer.channel
        self.send = self.channel.send  # to every peer

    @property
    def connected(self) -> bool:
        """True if a peer is connected."""
        return bool(self._peer.peers)

    @property
    def due_ns(self) -> int:
        """Latest time to call :meth:`watch`, on the clock that it is given."""
        return 0 if self.channel.greetings else self._due_ns

    def status(self) -> RemoteStatus:
        """Return the state of the link."""
        return RemoteStatus(
            listens=self.end.listens,
            address=self.end.address,
            port=self.end.port,
            secure=self.end.key is not None,
            connected=self.connected,
            peers=self._peer.peers,
            counts=dict(self._limit.counts),
        )

    def watch(self, time_ns: int) -> list[Notice]:
        """Admit or refuse peers, connect again where it is needed, report what happened.

        Never waits and never raises. Of each kind of notice, the first few in ten seconds are
        returned, then how many more there were.
        """
        notices, self._first = self._first, []
        try:
            notices += self._peer.take(time_ns)
        except (zmq.ZMQError, OSError) as error:  # none is known; the loop must go on in any case
            notices.append(Notice("handshake_failed", f"a socket of the remote link: {error}"))
        due_ns, longest_ns = self._peer.due_ns, time_ns + LOOK_NS
        self._due_ns = longest_ns if due_ns is None else min(due_ns, longest_ns)
        return self._limit.admit(time_ns, notices)
