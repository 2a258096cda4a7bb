"""Events of the connections of a socket, from libzmq."""

import struct
from typing import NamedTuple

import zmq

# Not zmq.utils.monitor.parse_monitor_message: it makes an enum member of every value, which takes
# 54 us for each new descriptor and then 5 us, and a turn of a loop handles up to 200 events.
_HEADER = struct.Struct("=Hi")  # event, value: zmq_socket_monitor(3)


class SocketEvent(NamedTuple):
    """One event: ``kind`` is one of zmq's ``EVENT_...``, ``value`` depends on it."""

    kind: int
    value: int


FAILURES = (zmq.EVENT_HANDSHAKE_FAILED_NO_DETAIL, zmq.EVENT_HANDSHAKE_FAILED_PROTOCOL)
_PROTOCOL = int(zmq.EVENT_HANDSHAKE_FAILED_PROTOCOL)
WRONG_KEY = SocketEvent(_PROTOCOL, int(zmq.PROTOCOL_ERROR_ZMTP_CRYPTOGRAPHIC))
OTHER_SECURITY = SocketEvent(_PROTOCOL, int(zmq.PROTOCOL_ERROR_ZMTP_MECHANISM_MISMATCH))


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
