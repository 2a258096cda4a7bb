"""Events of the connections of a socket, from libzmq."""

import struct
from dataclasses import dataclass

import zmq

_HEADER = struct.Struct("=Hi")  # event, value: zmq_socket_monitor(3)
CRYPTOGRAPHIC = int(zmq.PROTOCOL_ERROR_ZMTP_CRYPTOGRAPHIC)
MISMATCH = int(zmq.PROTOCOL_ERROR_ZMTP_MECHANISM_MISMATCH)


@dataclass(frozen=True)
class SocketEvent:
    """One event: ``kind`` is one of zmq's ``EVENT_...``, ``value`` depends on it."""

    kind: int
    value: int


class Monitor:
    """Reads the events of one socket.

    Args:
        socket: PAIR, connected to the monitor's endpoint.
    """

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
