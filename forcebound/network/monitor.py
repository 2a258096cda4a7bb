"""A socket of the link to another machine, and the events of its connections from libzmq."""

import struct
from abc import ABC, abstractmethod
from typing import NamedTuple

import zmq

from forcebound.network.ends import RemoteEnd
from forcebound.network.limits import HANDSHAKE_MS, HEARTBEAT_TIMEOUT_MS, MAX_FRAME
from forcebound.network.notices import Notice
from forcebound.network.sockets import Network
from forcebound.network.streams import Channel

EVENT_LIMIT = 200  # events handled in one turn of the loop; about 2 ms

# Not zmq.utils.monitor.parse_monitor_message: it makes an enum member of every value, which takes
# 54 us for each new descriptor and then 5 us.
_HEADER = struct.Struct("=Hi")  # event, value: zmq_socket_monitor(3)


class SocketEvent(NamedTuple):
    """One event: ``kind`` is one of zmq's ``EVENT_...``, ``value`` depends on it."""

    kind: int
    value: int


FAILURES = (zmq.EVENT_HANDSHAKE_FAILED_NO_DETAIL, zmq.EVENT_HANDSHAKE_FAILED_PROTOCOL)
_PROTOCOL = int(zmq.EVENT_HANDSHAKE_FAILED_PROTOCOL)
_WRONG_KEY = SocketEvent(_PROTOCOL, int(zmq.PROTOCOL_ERROR_ZMTP_CRYPTOGRAPHIC))
_OTHER_SECURITY = SocketEvent(_PROTOCOL, int(zmq.PROTOCOL_ERROR_ZMTP_MECHANISM_MISMATCH))


class MonitoredSocket(ABC):
    """The socket of an end with its CURVE keys; the events come from a PAIR at its monitor.

    Attributes:
        channel: Sends and receives packets.
        descriptors: Besides that of the channel; edge-triggered.
        due_ns: When there is something to do even if no descriptor is readable; None: never.
    """

    def __init__(self, network: Network, kind: int, endpoint: str, end: RemoteEnd) -> None:
        security: dict[int, bytes | int] = {zmq.RECONNECT_IVL: -1}
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
        self._end = end
        self.channel = Channel(self._socket)
        self.descriptors = [int(self._monitor.FD)]
        self.due_ns: int | None = None

    @property
    @abstractmethod
    def peers(self) -> list[str]:
        """Names and keys, or addresses, of the established peers."""

    def take(self, time_ns: int) -> list[Notice]:
        """Handle events, at most ``EVENT_LIMIT``, and what is due."""
        notices: list[Notice] = []
        self.due_ns = time_ns
        for _ in range(EVENT_LIMIT):
            try:
                frames = self._monitor.recv_multipart(zmq.DONTWAIT)
            except zmq.Again:
                self.due_ns = None
                break
            notices += self._handle(time_ns, SocketEvent(*_HEADER.unpack(frames[0])))
        return notices + self._look(time_ns)

    @abstractmethod
    def _handle(self, time_ns: int, event: SocketEvent) -> list[Notice]:
        """Handle one event."""

    @abstractmethod
    def _look(self, time_ns: int) -> list[Notice]:
        """Do what is due after the events."""

    def _notice(self, kind: str, sentence: str, address: str = "", key: str = "") -> Notice:
        peer = {"address": address, "key": key, "name": self._end.peers.get(key, "")}
        return Notice(kind, sentence, {name: text for name, text in peer.items() if text})

    def _named(self, key: str) -> str:
        return f"{self._end.peers.get(key, '')} (key {key})" if key else "a peer without keys"

    def _cause(self, failure: SocketEvent | None) -> str:
        """Return why a handshake failed, as far as libzmq shows it."""
        ours, theirs = ("keys", "no keys") if self._end.peers else ("no keys", "keys")
        if failure == _WRONG_KEY:
            return "one end expects another public key than the other one has"
        if failure == _OTHER_SECURITY:
            return f"the peer uses {theirs} (CURVE), and we use {ours}"
        return (
            f"the peer left, was silent for {HANDSHAKE_MS / 1000:g} s, uses {theirs} (CURVE), or"
            " does not speak ZMTP, the protocol of ZeroMQ"
        )


def gone(peer: str, address: str) -> str:
    """Return the sentence for a peer that has gone."""
    return (
        f"{peer} at {address} has gone: it left, was silent for {HEARTBEAT_TIMEOUT_MS} ms, or sent "
        f"a message of over {MAX_FRAME} bytes"
    )
