"""The connection to a port on another machine: causes of its end, and connecting again.

libzmq connects again by itself after a connection was lost, and does not after the peer has refused
it (ZAP), uses another security, or has broken the protocol (a message over MAXMSGSIZE). It then
emits no CONNECT_RETRIED; the socket stays silent for ever. After a wrong key of the listener it
tries again every 20 ms, for ever, which floods both logs. In all these cases ``disconnect`` and
``connect`` are called here, with a growing pause between.
"""

from contextlib import suppress

import zmq

from forcebound.network import limits
from forcebound.network.ends import RemoteEnd
from forcebound.network.monitor import FAILURES, OTHER_SECURITY, MonitoredSocket, SocketEvent
from forcebound.network.notices import Notice, gone
from forcebound.network.sockets import Network

FIRST_PAUSE_NS = 500_000_000
LONGEST_PAUSE_NS = 5_000_000_000
_SLOW_NS = limits.HANDSHAKE_MS * 900_000  # a handshake that fails after this timed out


class Connector(MonitoredSocket):
    """A DEALER that connects to ``endpoint``, ``tcp://HOST:PORT``; ConfigError if it cannot."""

    def __init__(self, network: Network, endpoint: str, end: RemoteEnd) -> None:
        super().__init__(network, zmq.DEALER, endpoint, end)
        self._endpoint = endpoint
        self._own = end.key
        self._key, self._name = next(iter(end.peers.items()), ("", ""))  # of the listener
        self._address = endpoint.removeprefix("tcp://")
        self._is_up = False
        self._since_ns = 0  # start of the present attempt
        self._alone_ns: int | None = None  # since when there is no connection; None: reported
        self._has_begun = False
        self._lost_ns: int | None = None  # lost, and libzmq has not reported that it tries again
        self._retry_ns: int | None = None  # disconnected by us until then
        self._pause_ns = FIRST_PAUSE_NS

    @property
    def connections(self) -> int:
        """Number of connections: here at most one."""
        return int(self._is_up)

    @property
    def peers(self) -> list[str]:
        """Name or address of the other end while it is there."""
        return [self._name or self._address] if self._is_up else []

    def take(self, time_ns: int, limit: int) -> list[Notice]:
        """Take up to ``limit`` events, connect again if it is time, greet the listener."""
        if not self._has_begun:
            self._has_begun, self._alone_ns = True, time_ns
        notices: list[Notice] = []
        for _ in range(limit):
            event = self.next_event()
            if event is None:
                break
            notices += self._handle(time_ns, event)
        else:
            self.due_ns = time_ns  # the other events may change the rest
            return notices
        if self._is_up:
            self.channel.send(b"")
        if self._lost_ns is not None and time_ns >= self._lost_ns + self._pause_ns:
            self._leave(time_ns, 0)
        if self._retry_ns is not None and time_ns >= self._retry_ns:
            self._retry_ns = None
            self._socket.connect(self._endpoint)
        if self._alone_ns is not None and time_ns >= self._alone_ns + limits.NO_ANSWER_NS:
            self._alone_ns = None
            sentence = (
                f"no connection to {self._address} for {limits.NO_ANSWER_NS // 10**9} s: nothing "
                "listens there, or a firewall or a lost network is between; still trying"
            )
            notices.append(self._notice("no_answer", sentence))
        waits = (
            (self._retry_ns, 0),
            (self._lost_ns, self._pause_ns),
            (self._alone_ns, limits.NO_ANSWER_NS),
        )
        times = [since + pause for since, pause in waits if since is not None]
        self.due_ns = min(times, default=None)
        return notices

    def _handle(self, time_ns: int, event: SocketEvent) -> list[Notice]:
        listener = f"{self._name} (key {self._key})" if self._key else "a peer without keys"
        if event.kind == zmq.EVENT_CONNECTED:
            self._since_ns, self._lost_ns = time_ns, None
        elif event.kind in (zmq.EVENT_CONNECT_DELAYED, zmq.EVENT_CONNECT_RETRIED):
            self._lost_ns = None
        elif event.kind == zmq.EVENT_HANDSHAKE_SUCCEEDED:
            self._is_up, self._lost_ns, self._alone_ns = True, None, None
            self._pause_ns = FIRST_PAUSE_NS
            return [self._notice("connected", f"connected to {listener} at {self._address}")]
        elif event.kind in (*FAILURES, zmq.EVENT_HANDSHAKE_FAILED_AUTH) and self._retry_ns is None:
            self._alone_ns = None
            self._leave(time_ns, self._pause_ns)
            return [self._notice(*self._failure(time_ns, event))]
        elif event.kind == zmq.EVENT_DISCONNECTED:
            was_up, self._is_up = self._is_up, False
            if self._retry_ns is None:
                self._lost_ns = time_ns
            if was_up:
                self._alone_ns = time_ns
                sentence = f"{gone(listener, self._address)}; connecting again"
                return [self._notice("disconnected", sentence)]
        return []

    def _leave(self, time_ns: int, pause_ns: int) -> None:
        with suppress(zmq.ZMQError):  # libzmq may have given up the connection already
            self._socket.disconnect(self._endpoint)
        self._lost_ns = None
        self._retry_ns = time_ns + pause_ns
        self._pause_ns = min(2 * self._pause_ns, LONGEST_PAUSE_NS)

    def _failure(self, time_ns: int, event: SocketEvent) -> tuple[str, str]:
        """Return kind and sentence of the notice of a handshake that failed."""
        there, own = self._address, self._own
        ours, theirs = ("no keys", "keys") if own is None else ("keys", "no keys")
        if event.kind == zmq.EVENT_HANDSHAKE_FAILED_AUTH:
            key = "" if own is None else f" {own.name} ({own.public})"
            return "refused_there", (
                f"{there} refused us: our key{key} is not in its list of allowed keys; add it "
                "to the launch file there, or use a key that is in it"
            )
        has_left = event.kind == zmq.EVENT_HANDSHAKE_FAILED_NO_DETAIL
        has_left = has_left and time_ns - self._since_ns < _SLOW_NS
        if has_left and own is not None:
            return "wrong_key", (
                f"{there} ended the connection during the handshake: most likely {self._key} "
                f"({self._name}) is not its public key: ask there with `forcebound keys show NAME`;"
                " it may also use no keys"
            )
        if has_left or event == OTHER_SECURITY:
            likely = "most likely it" if has_left else "it"
            return "other_security", (
                f"no connection with {there}: {likely} uses {theirs} (CURVE), and we use {ours}"
            )
        return "handshake_failed", (
            f"no connection with {there}: it did not finish its handshake in "
            f"{limits.HANDSHAKE_MS / 1000:g} s, or does not speak ZMTP, the protocol of ZeroMQ"
        )

    def _notice(self, kind: str, sentence: str) -> Notice:
        data = {"address": self._address}
        if self._key:
            data |= {"name": self._name, "key": self._key}
        return Notice(kind, sentence, data)
