"""A connection to a port on another machine: what ended it, and connecting again.

libzmq connects again by itself after a connection was lost, and does not after the peer has refused
it (ZAP), uses another security, or has broken the protocol (a message over MAXMSGSIZE). It then
emits no CONNECT_RETRIED; the socket stays silent for ever. After a wrong key of the listener it
tries again every 20 ms, for ever, which floods both logs. In all these cases ``disconnect`` and
``connect`` are called here, with a growing pause between.
"""

from contextlib import suppress

import zmq

from forcebound.network.monitor import MISMATCH, Monitor, SocketEvent
from forcebound.network.notices import Notice
from forcebound.network.sockets import (
    HANDSHAKE_MS,
    HANDSHAKE_TIMEOUT_NS,
    HEARTBEAT_TIMEOUT_MS,
    MAX_FRAME,
)
from forcebound.network.zap import FULL

FIRST_PAUSE_NS = 500_000_000
LONGEST_PAUSE_NS = 5_000_000_000
NO_ANSWER_NS = 3_000_000_000  # after this time without a connection it is said, once
_FAILURES = (
    zmq.EVENT_HANDSHAKE_FAILED_AUTH,
    zmq.EVENT_HANDSHAKE_FAILED_NO_DETAIL,
    zmq.EVENT_HANDSHAKE_FAILED_PROTOCOL,
)


class Connector:
    """The connection of one socket.

    Args:
        stream: What travels there: ``"queries"`` or ``"replies"``.
        socket: It has been connected to ``endpoint``.
        endpoint: ``tcp://HOST:PORT``, exactly as it was connected.
        monitor: Of the socket.
        own: Name and public key of this end, for messages; empty without keys.
        listener: Name and public key of the other end; empty without keys.
    """

    def __init__(
        self,
        stream: str,
        socket: "zmq.Socket[bytes]",
        endpoint: str,
        monitor: Monitor,
        own: tuple[str, str],
        listener: tuple[str, str],
    ) -> None:
        self.stream = stream
        self._socket = socket
        self._endpoint = endpoint
        self._monitor = monitor
        self._own = own
        self._listener = listener
        self._where = f"{endpoint.removeprefix('tcp://')} ({stream})"
        self._is_up = False
        self._since_ns: int | None = None  # of the present attempt
        self._alone_ns: int | None = None  # since when there is no connection; None: that was said
        self._begun = False
        self._lost_ns: int | None = None  # lost, and libzmq has not said that it tries again
        self._retry_ns: int | None = None  # disconnected by us until then
        self._pause_ns = FIRST_PAUSE_NS
        self._has_more = False

    @property
    def established(self) -> int:
        """1 while packets can be exchanged, else 0."""
        return int(self._is_up)

    @property
    def connections(self) -> int:
        """Do as :attr:`established`; a listener may have more of them."""
        return self.established

    @property
    def peers(self) -> list[str]:
        """Name or address of the other end while it is there."""
        return [self._listener[0] or self._where] if self._is_up else []

    @property
    def due_ns(self) -> int | None:
        """When :meth:`take` wants to be called, even if nothing happens; in ns."""
        if self._has_more:
            return 0
        times = [self._retry_ns]
        times.append(None if self._lost_ns is None else self._lost_ns + self._pause_ns)
        times.append(None if self._alone_ns is None else self._alone_ns + NO_ANSWER_NS)
        return min((time for time in times if time is not None), default=None)

    def take(self, time_ns: int, limit: int) -> list[Notice]:
        """Take up to ``limit`` events, and connect again if it is time."""
        if not self._begun:
            self._begun, self._alone_ns = True, time_ns
        notices: list[Notice] = []
        self._has_more = True
        for _ in range(limit):
            event = self._monitor.take()
            if event is None:
                self._has_more = False
                break
            notices += self._handle(time_ns, event)
        if self._has_more:
            return notices  # what is still to come may change the rest
        if self._lost_ns is not None and time_ns >= self._lost_ns + self._pause_ns:
            notices.append(self._protocol_error())
            self._leave(time_ns, 0)
        if self._retry_ns is not None and time_ns >= self._retry_ns:
            self._retry_ns = None
            self._socket.connect(self._endpoint)
        if self._alone_ns is not None and time_ns >= self._alone_ns + NO_ANSWER_NS:
            self._alone_ns = None
            message = (
                f"no connection to {self._where} for {NO_ANSWER_NS // 10**9} s: nothing listens "
                "there, or a firewall or a lost network is between; still trying"
            )
            notices.append(self._notice("no_answer", message))
        return notices

    def _handle(self, time_ns: int, event: SocketEvent) -> list[Notice]:
        if event.kind == zmq.EVENT_CONNECTED:
            self._since_ns, self._lost_ns = time_ns, None
        elif event.kind in (zmq.EVENT_CONNECT_DELAYED, zmq.EVENT_CONNECT_RETRIED):
            self._lost_ns = None
        elif event.kind == zmq.EVENT_HANDSHAKE_SUCCEEDED:
            self._is_up, self._lost_ns, self._alone_ns = True, None, None
            self._pause_ns = FIRST_PAUSE_NS
            return [self._notice("connected", f"connected to {self._peer} at {self._where}")]
        elif event.kind in _FAILURES and self._retry_ns is None:
            self._alone_ns = None
            notice = self._failed(time_ns, event)
            self._leave(time_ns, self._pause_ns)
            return [notice]
        elif event.kind == zmq.EVENT_DISCONNECTED:
            was_up, self._is_up = self._is_up, False
            if self._retry_ns is None:
                self._lost_ns = time_ns
            if was_up:
                self._alone_ns = time_ns
                message = (
                    f"{self._peer} at {self._where} has gone: it left, or was silent for "
                    f"{HEARTBEAT_TIMEOUT_MS} ms; connecting again"
                )
                return [self._notice("disconnected", message)]
        return []

    def _leave(self, time_ns: int, pause_ns: int) -> None:
        with suppress(zmq.ZMQError):  # the connection may be forgotten already
            self._socket.disconnect(self._endpoint)
        self._lost_ns = None
        self._retry_ns = time_ns + pause_ns
        self._pause_ns = min(2 * self._pause_ns, LONGEST_PAUSE_NS)

    def _failed(self, time_ns: int, event: SocketEvent) -> Notice:
        with_keys = bool(self._own[1])
        if event.kind == zmq.EVENT_HANDSHAKE_FAILED_AUTH:
            if str(event.value) == FULL:
                why = "it has as many connections as it takes"
            else:
                why = (
                    f"our key {self._own[0]} ({self._own[1]}) is not in its list of who may "
                    "connect; add it to the launch file there, or use the key that is in it"
                )
            return self._notice("refused_there", f"{self._where} refused us: {why}")
        if event.kind == zmq.EVENT_HANDSHAKE_FAILED_PROTOCOL and event.value == MISMATCH:
            why = (
                "it uses no keys (CURVE), and we do: start it with keys"
                if with_keys
                else "it uses keys (CURVE), and we do not: name the keys in the launch file"
            )
            return self._notice("other_security", f"cannot talk to {self._where}: {why}")
        if event.kind == zmq.EVENT_HANDSHAKE_FAILED_NO_DETAIL:
            if self._since_ns is not None and time_ns - self._since_ns >= HANDSHAKE_TIMEOUT_NS:
                why = f"it did not finish its handshake in {HANDSHAKE_MS / 1000:g} s"
                return self._notice("handshake_timeout", f"cannot talk to {self._where}: {why}")
            why = (
                f"most likely {self._listener[1]} ({self._listener[0]}) is not its public key: ask "
                "there with `forcebound keys show NAME`; it may also use no keys"
                if with_keys
                else "most likely it uses keys (CURVE), and we do not"
            )
            message = f"{self._where} ended the connection during the handshake: {why}"
            return self._notice("wrong_key_there" if with_keys else "other_security", message)
        message = f"cannot talk to {self._where}: what answers there breaks the protocol of ZeroMQ"
        return self._notice("handshake_failed", message)

    def _protocol_error(self) -> Notice:
        message = (
            f"{self._where} broke the protocol, as with a message of over {MAX_FRAME} bytes: the "
            "connection was ended; connecting again"
        )
        return self._notice("protocol_error", message)

    @property
    def _peer(self) -> str:
        name, key = self._listener
        return f"{name} (key {key})" if key else "a peer without keys"

    def _notice(self, kind: str, message: str) -> Notice:
        data = {"stream": self.stream, "address": self._endpoint.removeprefix("tcp://")}
        if self._listener[1]:
            data |= {"name": self._listener[0], "key": self._listener[1]}
        return Notice(kind, message, data)
