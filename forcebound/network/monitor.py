"""A socket of the link to another machine, and the events of its connections from libzmq."""

import struct
from typing import NamedTuple

import zmq

from forcebound.network.ends import RemoteEnd
from forcebound.network.sockets import Network
from forcebound.network.streams import Channel

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


class MonitoredSocket:
    """The socket of an end with its CURVE keys; the events come from a PAIR at its monitor.

    Attributes:
        channel: Sends and receives packets.
        descriptors: Besides that of the channel; edge-triggered.
        due_ns: When there is something to do even if no descriptor is readable; None: never.
    """

    def __init__(self, network: Network, kind: int, endpoint: str, end: RemoteEnd) -> None:
        security: dict[int, bytes | int] = {}
        if end.listens:
            security = {zmq.ZAP_DOMAIN: b"remote", zmq.ZAP_ENFORCE_DOMAIN: 1}
        if end.key is not None:
            security[zmq.CURVE_PUBLICKEY] = end.key.public.encode("ascii")
            security[zmq.CURVE_SECRETKEY] = end.key.secret.encode("ascii")
            if end.listens:
                security[zmq.CURVE_SERVER] = 1
            else:
                security[zmq.CURVE_SERVERKEY] = next(iter(end.peers)).encode("ascii")
        self._socket, self._monitor = network.monitored(
            kind, endpoint, bind=end.listens, security=security
        )
        self.channel = Channel(self._socket)
        self.descriptors = [int(self._monitor.FD)]
        self.due_ns: int | None = None

    def next_event(self) -> SocketEvent | None:
        """Return the next event, None if there is none."""
        try:
            frames = self._monitor.recv_multipart(zmq.DONTWAIT)
        except zmq.Again:
            return None
        return SocketEvent(*_HEADER.unpack(frames[0]))
