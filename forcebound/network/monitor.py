"""Events of the connections of a socket, from libzmq, and why a handshake failed."""

import struct
from typing import NamedTuple

import zmq

from forcebound.network.limits import HANDSHAKE_MS

_HEADER = struct.Struct("=Hi")  # event, value: zmq_socket_monitor(3)
_SLOW_NS = HANDSHAKE_MS * 900_000  # a failure after this was that limit


class SocketEvent(NamedTuple):
    """One event: ``kind`` is one of zmq's ``EVENT_...``, ``value`` depends on it."""

    kind: int
    value: int

    def failure(self, took_ns: int, with_keys: bool, if_it_left: str) -> str:
        """Return the code of the notice of a handshake that failed after ``took_ns`` ns.

        Args:
            took_ns: How long the connection lasted.
            with_keys: Whether this end uses keys.
            if_it_left: The code for a peer that just left.
        """
        if self == _OTHER_SECURITY:
            return "uses_no_keys" if with_keys else "uses_keys"
        if took_ns >= _SLOW_NS:
            return "too_slow"
        return if_it_left if self.kind == zmq.EVENT_HANDSHAKE_FAILED_NO_DETAIL else "no_zmtp"


_PROTOCOL = int(zmq.EVENT_HANDSHAKE_FAILED_PROTOCOL)
WRONG_KEY = SocketEvent(_PROTOCOL, int(zmq.PROTOCOL_ERROR_ZMTP_CRYPTOGRAPHIC))
_OTHER_SECURITY = SocketEvent(_PROTOCOL, int(zmq.PROTOCOL_ERROR_ZMTP_MECHANISM_MISMATCH))


class Monitor:
    """Reads the events of one socket, from a PAIR connected to the monitor's endpoint."""

    def __init__(self, socket: "zmq.Socket[bytes]") -> None:
        self._socket = socket
        self.descriptor = int(socket.FD)

    def take(self) -> SocketEvent | None:
        """Return the next event, None if there is none."""
        try:
            frames = self._socket.recv_multipart(zmq.DONTWAIT)
        except zmq.Again:
            return None
        return SocketEvent(*_HEADER.unpack(frames[0]))
