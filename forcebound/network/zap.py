"""The authenticator of ZeroMQ (ZAP, RFC 27), which decides who may connect; no thread.

libzmq asks it about each peer of a socket that has a ZAP domain, after the peer has proved that it
holds the secret of its key, and before any message passes. Nobody answers for it: with
``ZAP_ENFORCE_DOMAIN=1``, no handler means that nobody comes in. Everything that is not explicitly
allowed is refused. Status 400 and 500 reach the refused peer, whose monitor shows them; 300 would
leave it waiting for its handshake to time out.
"""

from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import NamedTuple

import zmq
from zmq.utils import z85

ENDPOINT = "inproc://zeromq.zap.01"
ALLOWED, REFUSED, FULL = "200", "400", "500"


class Verdict(NamedTuple):
    """What was decided about one peer."""

    address: str  # without its port
    key: str  # its public key in Z85; empty without CURVE
    name: str  # of the key, if it is known
    status: str  # ALLOWED, REFUSED or FULL


class ZapHandler:
    """Decides by a list of public keys.

    Args:
        socket: REP, bound to :data:`ENDPOINT`.
        allowed: Names by public key (Z85), and peers without CURVE are refused; empty: everybody
            may come who uses no CURVE.
        has_room: Whether the port takes one more peer.
    """

    def __init__(
        self,
        socket: "zmq.Socket[bytes]",
        allowed: Mapping[str, str],
        has_room: Callable[[], bool],
    ) -> None:
        self._socket = socket
        self._allowed = dict(allowed)
        self._has_room = has_room
        self.descriptor = int(socket.FD)

    def close(self) -> None:
        """Give the endpoint back at once; closing the socket does so at some time."""
        with suppress(zmq.ZMQError):  # it may be closed already
            self._socket.unbind(ENDPOINT)

    def serve_one(self) -> Verdict | None:
        """Decide about one peer; None if nobody waits."""
        try:
            frames = self._socket.recv_multipart(zmq.DONTWAIT)
        except zmq.Again:
            return None
        version, request, _, address, _, mechanism, *credentials = (*frames, *[b""] * 6)[
            : max(len(frames), 6)
        ]
        key = ""
        if mechanism == b"CURVE" and len(credentials) == 1 and len(credentials[0]) == 32:
            key = z85.encode(credentials[0]).decode("ascii")
        may = key in self._allowed if self._allowed else mechanism == b"NULL"
        may = may and version == b"1.0"
        status = REFUSED if not may else ALLOWED if self._has_room() else FULL
        reply = [b"1.0", request, status.encode(), b"", key.encode() if may else b"", b""]
        self._socket.send_multipart(reply, zmq.DONTWAIT)
        peer = address.decode("ascii", "replace").removeprefix("::ffff:")
        return Verdict(peer, key, self._allowed.get(key, ""), status)
