"""The connection to a port on another machine: causes of its end, and connecting again.

libzmq would connect again by itself after a connection was lost, but not after the peer has refused
it (ZAP), uses another security, or has broken the protocol (a message over MAXMSGSIZE): the socket
then stays silent for ever. After a wrong key of the listener it would try again every 20 ms, which
floods both logs. So it never does (RECONNECT_IVL -1): every attempt that has ended is followed by
``disconnect`` and ``connect`` here, after a pause, which grows while handshakes fail.
"""

from contextlib import suppress

import zmq

from forcebound.network import limits
from forcebound.network.ends import RemoteEnd
from forcebound.network.monitor import FAILURES, MonitoredSocket, SocketEvent, gone
from forcebound.network.notices import Notice
from forcebound.network.sockets import Network

PAUSE_NS = 100_000_000  # after a connection was lost, or nobody listens
FIRST_PAUSE_NS = 500_000_000  # after a handshake that failed
LONGEST_PAUSE_NS = 5_000_000_000
_SLOW_NS = limits.HANDSHAKE_MS * 900_000  # a handshake that fails after this timed out


class Connector(MonitoredSocket):
    """A DEALER that connects to ``endpoint``, ``tcp://HOST:PORT``; ConfigError if it cannot."""

    def __init__(self, network: Network, endpoint: str, end: RemoteEnd) -> None:
        super().__init__(network, zmq.DEALER, endpoint, end)
        self._endpoint = endpoint
        self._key = next(iter(end.peers), "")  # of the listener
        self._address = endpoint.removeprefix("tcp://")
        self._is_up = False
        self._since_ns = 0  # start of the present attempt; 0: before the first look
        self._alone_ns: int | None = None  # since when there is no connection; None: reported
        self._retry_ns: int | None = None  # when to connect again; None: an attempt is under way
        self._pause_ns = FIRST_PAUSE_NS

    @property
    def peers(self) -> list[str]:
        """Name or address of the other end while it is there."""
        return [self._end.peers.get(self._key, self._address)] if self._is_up else []

    def _look(self, time_ns: int) -> list[Notice]:
        notices = []
        if not self._since_ns:
            self._since_ns = self._alone_ns = time_ns
        if self._is_up:
            self.channel.send(b"")
        if self._retry_ns is not None and time_ns >= self._retry_ns:
            self._retry_ns, self._since_ns = None, time_ns
            with suppress(zmq.ZMQError):  # libzmq may have given up the connection already
                self._socket.disconnect(self._endpoint)
            self._socket.connect(self._endpoint)
        if self._alone_ns is not None and time_ns >= self._alone_ns + limits.NO_ANSWER_NS:
            self._alone_ns = None
            sentence = f"no connection to {self._address} for {limits.NO_ANSWER_NS // 10**9} s"
            notices.append(self._notice("no_answer", sentence, self._address, self._key))
        alone_ns = self._alone_ns
        no_answer_ns = None if alone_ns is None else alone_ns + limits.NO_ANSWER_NS
        times = (self.due_ns, self._retry_ns, no_answer_ns)
        self.due_ns = min((each for each in times if each is not None), default=None)
        return notices

    def _handle(self, time_ns: int, event: SocketEvent) -> list[Notice]:
        kind, sentence = "", ""
        if event.kind == zmq.EVENT_HANDSHAKE_SUCCEEDED:
            self._is_up, self._alone_ns, self._pause_ns = True, None, FIRST_PAUSE_NS
            kind = "connected"
            sentence = f"connected to {self._named(self._key)} at {self._address}"
        elif event.kind in (*FAILURES, zmq.EVENT_HANDSHAKE_FAILED_AUTH):
            if self._retry_ns is None:
                self._alone_ns, self._retry_ns = None, time_ns + self._pause_ns
                self._pause_ns = min(2 * self._pause_ns, LONGEST_PAUSE_NS)
                kind, sentence = self._failure(time_ns, event)
        elif event.kind in (zmq.EVENT_DISCONNECTED, zmq.EVENT_CLOSED):
            self._retry_ns = self._retry_ns or time_ns + PAUSE_NS
            if self._is_up:
                self._is_up, self._alone_ns = False, time_ns
                kind = "disconnected"
                sentence = f"{gone(self._named(self._key), self._address)}; connecting again"
        return [self._notice(kind, sentence, self._address, self._key)] if kind else []

    def _failure(self, time_ns: int, event: SocketEvent) -> tuple[str, str]:
        """Return kind and sentence of the notice of a handshake that failed."""
        own = self._end.key
        if event.kind == zmq.EVENT_HANDSHAKE_FAILED_AUTH:
            key = "" if own is None else f", key {own.name} ({own.public})"
            return "refused_there", f"{self._address}{key}"
        cause = self._cause(event)
        left_ns = time_ns - self._since_ns
        if event.kind == zmq.EVENT_HANDSHAKE_FAILED_NO_DETAIL and left_ns < _SLOW_NS:
            cause = "it ended the connection; most likely it uses keys (CURVE), and we use no keys"
            if own is not None:
                cause = (
                    f"it ended the connection; most likely {self._key} "
                    f"({self._end.peers[self._key]}) is not its public key, or it uses no keys"
                )
        return "handshake_failed", f"{self._address}: {cause}"
