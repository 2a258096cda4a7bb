"""The authenticator of ZeroMQ (ZAP, RFC 27): decides which peers may connect; no thread.

libzmq asks it about each peer of a socket that has a ZAP domain, after the peer has proved that it
holds the secret of its key, and before any message passes. With ``ZAP_ENFORCE_DOMAIN=1``, a peer
about which nothing answers is refused, and so is every peer that is not explicitly allowed. Status
400 reaches the refused peer, whose monitor shows it; 300 would leave it waiting for its handshake
to time out.

Not ``zmq.auth.Authenticator``: its handler is a coroutine, it opens its own socket, and it reports
the address and key of a refused peer only to its log.
"""

from collections.abc import Mapping
from contextlib import suppress
from typing import NamedTuple

import zmq
from zmq.utils import z85

ENDPOINT = "inproc://zeromq.zap.01"


class Verdict(NamedTuple):
    """The decision about one peer."""

    address: str  # without its port
    key: str  # its public key in Z85; empty without CURVE
    is_allowed: bool


class ZapHandler:
    """Decides by a list of public keys (Z85), with names; ``socket`` is a REP at :data:`ENDPOINT`.

    An empty list allows every peer without CURVE, any other none.
    """

    def __init__(self, socket: "zmq.Socket[bytes]", allowed: Mapping[str, str]) -> None:
        self._socket = socket
        self._allowed = allowed
        self.descriptor = int(socket.FD)

    def close(self) -> None:
        """Give the endpoint back at once; closing the socket does so at some time."""
        with suppress(zmq.ZMQError):  # it may be closed already
            self._socket.unbind(ENDPOINT)

    def serve_one(self) -> Verdict | None:
        """Decide about one peer; None if no peer waits."""
        try:
            frames = self._socket.recv_multipart(zmq.DONTWAIT)
        except zmq.Again:
            return None
        version, request, _, address, _, mechanism, *credentials = frames
        key = z85.encode(credentials[0]).decode("ascii") if mechanism == b"CURVE" else ""
        is_allowed = key in self._allowed if self._allowed else mechanism == b"NULL"
        is_allowed = is_allowed and version == b"1.0"
        user = key.encode() if is_allowed else b""
        status = b"200" if is_allowed else b"400"
        self._socket.send_multipart([b"1.0", request, status, b"", user, b""], zmq.DONTWAIT)
        return Verdict(address.decode("ascii").removeprefix("::ffff:"), key, is_allowed)
