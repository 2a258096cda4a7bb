"""ZeroMQ sockets, with every known trap handled in one place.

Only this room imports zmq, and only ``make_socket`` opens sockets. What was measured (pyzmq 27.3,
libzmq 4.3.5) and what is done:

1. Options work only if set before connect or bind: every one is set before.
2. The default LINGER hangs at exit, and IMMEDIATE 0 queues for a peer that is not there: LINGER 0,
   IMMEDIATE 1. Only a PUB lingers (the last telemetry), and for a bounded time; and at a SUB,
   IMMEDIATE 1 would drop messages that have arrived but were not received when the sender leaves.
3. IPv6 is off by default and then ``[::1]`` fails silently: on.
4. A peer may send a frame of any size: MAXMSGSIZE. libzmq then ends the connection, and an end that
   *connected* does not try again: on ipc the stream is silent until this process restarts, and the
   device's force is zero; on tcp :mod:`forcebound.network.remote` connects again.
5. A peer that connects and sends nothing holds the socket for 30 s: HANDSHAKE_IVL.
6. ``bind`` to an ``ipc`` path steals it from a live listener without an error: checked first.
7. An empty ``recv(DONTWAIT)`` raises, which costs more than asking for EVENTS first.
8. ``zmq_poll`` counts in milliseconds. ``select`` on the sockets' descriptors waits to the
   microsecond; but such a descriptor is edge-triggered, so a socket is emptied, until EVENTS shows
   it, before its descriptor is waited for. And asking EVENTS is a system call of 4 to 10 us in a
   cold loop, so only sockets whose descriptor is readable are read.
9. A message of several frames aborts a process whose CONFLATE socket reads it between two of them
   (``Assertion failed: !_more``, fq.cpp), on ipc too. So no socket has CONFLATE: it is read until
   it is empty, and the newest kept (:mod:`forcebound.network.streams`). Such a message counts
   as one malformed packet.
10. A monitor whose queue is full stops the input and output thread, so all sockets: no limit.
"""

import errno
import select
import socket as unix
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Self

import zmq

from forcebound.errors import ConfigError
from forcebound.messages.control import Request
from forcebound.network.control import ControlClient, ControlServer
from forcebound.network.limits import (
    HANDSHAKE_MS,
    HEARTBEAT_MS,
    HEARTBEAT_TIMEOUT_MS,
    MAX_FRAME,
    QUEUE_LIMIT,
    RECONNECT_MS,
    REQUEST_QUEUE,
    TCP_CONNECT_MS,
    TCP_RECEIVE_QUEUE,
    TCP_SEND_QUEUE,
)
from forcebound.network.streams import Publisher, Subscriber

MONITORED = (
    zmq.EVENT_CLOSED
    | zmq.EVENT_ACCEPTED  # not ACCEPT_FAILED: out of descriptors, it comes 100 000 times a second
    | zmq.EVENT_DISCONNECTED
    | zmq.EVENT_HANDSHAKE_SUCCEEDED
    | zmq.EVENT_HANDSHAKE_FAILED_NO_DETAIL
    | zmq.EVENT_HANDSHAKE_FAILED_PROTOCOL
    | zmq.EVENT_HANDSHAKE_FAILED_AUTH
)
IPC_PATH_LIMIT = 107  # characters, sun_path of <sys/un.h> without its final 0

ADVICE = {
    errno.EADDRINUSE: "the address is in use: stop the other run, or choose another port",
    errno.EADDRNOTAVAIL: "no network interface of this machine has this address",
    errno.ENODEV: "no network interface of this machine has this address",
    errno.EACCES: "no permission: choose a port above 1023, or a directory you may write to",
    errno.ENOENT: "the directory does not exist",
    errno.EINVAL: "write it like tcp://127.0.0.1:5555 or ipc:///run/user/1000/name",
    errno.EPROTONOSUPPORT: "use tcp:// or ipc://",
    errno.ENAMETOOLONG: f"an ipc path has at most {IPC_PATH_LIMIT} characters",
}


def library() -> tuple[str, bool]:
    """Return the version of libzmq, and whether it can encrypt (CURVE)."""
    return zmq.zmq_version(), bool(zmq.has("curve"))


def make_socket(
    context: "zmq.Context[zmq.Socket[bytes]]",
    kind: int,
    endpoint: str,
    *,
    bind: bool,
    security: Mapping[int, bytes | int] | None = None,
    monitor: str = "",
) -> "zmq.Socket[bytes]":
    """Return a socket that is bound or connected to ``endpoint``, with its options set before.

    A ``zmq.SUB`` gets everything. ``security`` has further options, of CURVE and ZAP. A ``monitor``
    is an ``inproc`` endpoint at which the socket reports its events; its reader must have no limit
    on its queue, and stop the monitor before it leaves.

    Raises:
        ConfigError: If the endpoint is malformed, in use or not permitted.
    """
    socket = context.socket(kind)
    try:
        for option, value in {**_options(kind, endpoint), **(security or {})}.items():
            socket.set(option, value)
        if kind == zmq.SUB:
            socket.set(zmq.SUBSCRIBE, b"")
        if monitor:
            socket.monitor(monitor, MONITORED)
        if bind:
            _refuse_to_steal(endpoint)
        socket.bind(endpoint) if bind else socket.connect(endpoint)
    except BaseException as error:
        socket.close()  # else the end of the context would wait for it for ever
        if not isinstance(error, zmq.ZMQError):
            raise
        advice = ADVICE.get(error.errno or 0, error.strerror)
        verb = "bind" if bind else "connect"
        raise ConfigError(f"cannot {verb} to {endpoint}: {advice}") from None
    return socket


def _options(kind: int, endpoint: str) -> dict[int, int]:
    """Return the options of a socket that are whole numbers."""
    options: dict[int, int] = {
        zmq.LINGER: 0,
        zmq.IMMEDIATE: int(kind != zmq.SUB),
        zmq.IPV6: 1,
        zmq.MAXMSGSIZE: MAX_FRAME,
        zmq.HANDSHAKE_IVL: HANDSHAKE_MS,
        zmq.RECONNECT_IVL: RECONNECT_MS,
        zmq.SNDHWM: QUEUE_LIMIT,
        zmq.RCVHWM: QUEUE_LIMIT,
    }
    if endpoint.startswith("tcp:"):
        options |= {
            zmq.HEARTBEAT_IVL: HEARTBEAT_MS,
            zmq.HEARTBEAT_TIMEOUT: HEARTBEAT_TIMEOUT_MS,
            zmq.CONNECT_TIMEOUT: TCP_CONNECT_MS,
            zmq.SNDHWM: TCP_SEND_QUEUE,
            zmq.RCVHWM: TCP_RECEIVE_QUEUE,
        }
    if kind == zmq.PUB:  # an onlooker may be late, however it is connected
        options[zmq.SNDHWM] = QUEUE_LIMIT
    if kind == zmq.REP:  # requests wait at their senders while the process has other work
        options[zmq.RCVHWM] = REQUEST_QUEUE
    if endpoint.startswith("inproc:"):
        options[zmq.RCVHWM] = 0  # its writer is the input and output thread: see 10
    if kind == zmq.REQ:  # a request without an answer may be followed by another one
        options |= {zmq.REQ_RELAXED: 1, zmq.REQ_CORRELATE: 1}
    return options


class Network:
    """The sockets of one process, closed by leaving the ``with`` block.

    The last packets may take ``linger_ms`` to leave then.
    """

    def __init__(self, linger_ms: int = 200) -> None:
        self._context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        self._linger_ms = linger_ms
        self._sockets: list[zmq.Socket[bytes]] = []
        self._monitored: list[zmq.Socket[bytes]] = []

    def publisher(self, endpoint: str) -> Publisher:
        """Open one stream out; see :func:`make_socket` for errors."""
        return Publisher(self._open(zmq.PUB, endpoint, bind=True))

    def subscriber(self, *endpoints: str) -> Subscriber:
        """Open one socket for one or more streams in; see :func:`make_socket` for errors."""
        first, *others = endpoints
        socket = self._open(zmq.SUB, first, bind=False)
        for endpoint in others:
            socket.connect(endpoint)
        return Subscriber(socket)

    def control_server(self, endpoint: str, requests: Sequence[type[Request]]) -> ControlServer:
        """Open the socket on which this process answers requests of these classes."""
        return ControlServer(self._open(zmq.REP, endpoint, bind=True), requests)

    def control_client(self, endpoint: str) -> ControlClient:
        """Open a socket that sends requests to another process's :meth:`control_server`."""
        return ControlClient(self._open(zmq.REQ, endpoint, bind=False))

    def monitored(
        self, kind: int, endpoint: str, *, bind: bool, security: Mapping[int, bytes | int]
    ) -> "tuple[zmq.Socket[bytes], zmq.Socket[bytes]]":
        """Open a socket and its monitor; see :func:`make_socket`."""
        where = f"inproc://monitor-{len(self._sockets)}"
        monitor = self._open(zmq.PAIR, where, bind=False)
        socket = self._open(kind, endpoint, bind=bind, security=security, monitor=where)
        self._monitored.append(socket)
        return socket, monitor

    def reply_socket(self, endpoint: str) -> "zmq.Socket[bytes]":
        """Open a bound REP socket."""
        return self._open(zmq.REP, endpoint, bind=True)

    def close(self) -> None:
        """Close all sockets; returns within ``linger_ms``."""
        for socket in self._monitored:
            socket.disable_monitor()  # without its reader, it would stop the thread of all sockets
        for socket in self._sockets:
            socket.close(linger=self._linger_ms if socket.type == zmq.PUB else 0)
        self._monitored.clear()
        self._sockets.clear()
        self._context.destroy(linger=0)  # term would wait for a socket that was left open

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _open(self, kind: int, endpoint: str, **options: Any) -> "zmq.Socket[bytes]":
        socket = make_socket(self._context, kind, endpoint, **options)
        self._sockets.append(socket)
        return socket


def wait(descriptors: Sequence[int], timeout_ns: int) -> list[int]:
    """Sleep until a descriptor is readable, or ``timeout_ns`` is over; return those that are.

    A ZeroMQ descriptor is edge-triggered: it shows that something *happened* on a socket. So it may
    be waited for only after everything on the socket was received, and it may have been nothing of
    interest.
    """
    return select.select(descriptors, (), (), timeout_ns * 1e-9 if timeout_ns > 0 else 0)[0]


def _refuse_to_steal(endpoint: str) -> None:
    """Raise if a process listens at this ipc path, or if it is too long."""
    if not endpoint.startswith("ipc://"):
        return
    path = endpoint.removeprefix("ipc://")
    if len(path.encode()) > IPC_PATH_LIMIT:
        raise ConfigError(f"cannot bind to {endpoint}: {ADVICE[errno.ENAMETOOLONG]}")
    if not Path(path).exists():
        return
    with unix.socket(unix.AF_UNIX, unix.SOCK_STREAM) as probe:
        probe.setblocking(False)
        if probe.connect_ex(path) in (0, errno.EAGAIN, errno.EINPROGRESS):
            raise ConfigError(f"cannot bind to {endpoint}: {ADVICE[errno.EADDRINUSE]}")
