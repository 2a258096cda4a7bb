"""The connection to a port on another machine: causes of its end, and connecting again.

libzmq connects again by itself after a connection was lost, and does not after the peer has refused
it (ZAP), uses another security, or has broken the protocol (a message over MAXMSGSIZE). It then
emits no CONNECT_RETRIED; the socket stays silent for ever. After a wrong key of the listener it
tries again every 20 ms, for ever, which floods both logs. In all these cases ``disconnect`` and
``connect`` are called here, with a growing pause between.
"""

from collections.abc import Collection
from contextlib import suppress

import zmq

from forcebound.network.channel import Channel
from forcebound.network.descriptors import Grip
from forcebound.network.limits import MAX_UNFINISHED, NO_ANSWER_NS
from forcebound.network.monitor import Monitor, SocketEvent
from forcebound.network.notices import Notice
from forcebound.network.zap import FULL

FIRST_PAUSE_NS = 500_000_000
LONGEST_PAUSE_NS = 5_000_000_000
_FAILURES = (
    zmq.EVENT_HANDSHAKE_FAILED_AUTH,
    zmq.EVENT_HANDSHAKE_FAILED_NO_DETAIL,
    zmq.EVENT_HANDSHAKE_FAILED_PROTOCOL,
)


class Connector:
    """The connection of one socket.

    Args:
        socket: It has been connected to ``endpoint``.
        endpoint: ``tcp://HOST:PORT``, exactly as it was connected.
        monitor: Of the socket.
        own: Name and public key of this end, for notices; empty without keys.
        listener: Those of the other end, likewise.
    """

    def __init__(
        self,
        socket: "zmq.Socket[bytes]",
        endpoint: str,
        monitor: Monitor,
        own: tuple[str, str],
        listener: tuple[str, str],
    ) -> None:
        self._socket = socket
        self._endpoint = endpoint
        self._monitor = monitor
        self._own = own
        self._listener = listener
        self._address = endpoint.removeprefix("tcp://")
        self._is_up = False
        self._since_ns = 0  # of the present attempt
        self._alone_ns: int | None = None  # since when there is no connection; None: reported
        self._begun = False
        self._lost_ns: int | None = None  # lost, and libzmq has not reported that it tries again
        self._retry_ns: int | None = None  # disconnected by us until then
        self._pause_ns = FIRST_PAUSE_NS
        self._has_more = False
        self._grip = Grip()
        self._descriptor = -1  # of the present connection
        self._received = 0  # bytes on it, at the last look that found a whole message

    @property
    def established(self) -> int:
        """1 while packets can be exchanged, else 0."""
        return int(self._is_up)

    @property
    def connections(self) -> int:
        """Number of connections: here at most one."""
        return self.established

    @property
    def peers(self) -> list[str]:
        """Name or address of the other end while it is there."""
        return [self._listener[0] or self._address] if self._is_up else []

    @property
    def due_ns(self) -> int | None:
        """When :meth:`take` wants to be called, even if nothing happens; in ns."""
        if self._has_more:
            return 0
        waits = (
            (self._retry_ns, 0),
            (self._lost_ns, self._pause_ns),
            (self._alone_ns, NO_ANSWER_NS),
        )
        return min((since + pause for since, pause in waits if since is not None), default=None)

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
            notices.append(self._notice("broken"))
            self._leave(time_ns, 0)
        if self._retry_ns is not None and time_ns >= self._retry_ns:
            self._retry_ns = None
            self._socket.connect(self._endpoint)
        if self._alone_ns is not None and time_ns >= self._alone_ns + NO_ANSWER_NS:
            self._alone_ns = None
            notices.append(self._notice("no_answer"))
        return notices

    def look(self, time_ns: int, limit: int, heard: Collection[bytes]) -> list[Notice]:
        """Leave a listener that sends too much without the end of a message.

        Arguments are as of :meth:`forcebound.network.listener.Listener.look`.
        """
        received = self._grip.bytes_received(self._descriptor) if self._is_up else 0
        if heard:
            self._received = received
        elif received - self._received > MAX_UNFINISHED:
            self._is_up, self._received = False, received
            self._leave(time_ns, self._pause_ns)
            return [self._notice("broken")]
        return []

    def greet(self, channel: Channel) -> list[Notice]:
        """Greet the listener."""
        if self._is_up:
            channel.send(b"")
        return []

    def _handle(self, time_ns: int, event: SocketEvent) -> list[Notice]:
        if event.kind == zmq.EVENT_CONNECTED:
            self._descriptor, self._received = event.value, 0
            self._since_ns, self._lost_ns = time_ns, None
        elif event.kind in (zmq.EVENT_CONNECT_DELAYED, zmq.EVENT_CONNECT_RETRIED):
            self._lost_ns = None
        elif event.kind == zmq.EVENT_HANDSHAKE_SUCCEEDED:
            self._is_up, self._lost_ns, self._alone_ns = True, None, None
            self._pause_ns = FIRST_PAUSE_NS
            return [self._notice("met")]
        elif event.kind in _FAILURES and self._retry_ns is None:
            self._alone_ns = None
            self._leave(time_ns, self._pause_ns)
            return [self._notice(self._failure(time_ns, event))]
        elif event.kind == zmq.EVENT_DISCONNECTED:
            was_up, self._is_up = self._is_up, False
            if self._retry_ns is None:
                self._lost_ns = time_ns
            if was_up:
                self._alone_ns = time_ns
                return [self._notice("lost")]
        return []

    def _leave(self, time_ns: int, pause_ns: int) -> None:
        with suppress(zmq.ZMQError):  # the connection may be forgotten already
            self._socket.disconnect(self._endpoint)
        self._lost_ns = None
        self._retry_ns = time_ns + pause_ns
        self._pause_ns = min(2 * self._pause_ns, LONGEST_PAUSE_NS)

    def _failure(self, time_ns: int, event: SocketEvent) -> str:
        """Return the code of the notice of a handshake that failed."""
        if event.kind == zmq.EVENT_HANDSHAKE_FAILED_AUTH:
            return "there_full" if str(event.value) == FULL else "there_unknown"
        with_keys = bool(self._own[1])
        left = "there_wrong_key" if with_keys else "there_likely_keys"
        return event.failure(time_ns - self._since_ns, with_keys, left)

    def _notice(self, code: str) -> Notice:
        data = {"address": self._address}
        if self._listener[1]:
            data |= {"name": self._listener[0], "key": self._listener[1]}
        if code == "there_unknown":
            data["own"] = f"{self._own[0]} ({self._own[1]})"
        return Notice(code, data)
