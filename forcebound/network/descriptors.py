"""Connections of libzmq's sockets, held by their descriptors; how many there may be."""

import os
import resource
import socket
import struct
import weakref
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from forcebound.network.limits import MAX_CONNECTIONS

_BYTES_RECEIVED = struct.Struct("=128xQ")  # tcpi_bytes_received in struct tcp_info, <linux/tcp.h>


class Grip:
    """Holds on to one connection at a time, which libzmq may close at any time.

    It keeps two descriptors: a peer that makes connections until there are no more descriptors can
    then still be shut.
    """

    def __init__(self) -> None:
        self._nothing = os.open(os.devnull, os.O_RDONLY | os.O_CLOEXEC)
        self._held = os.dup(self._nothing)
        for descriptor in (self._nothing, self._held):
            weakref.finalize(self, os.close, descriptor)

    @contextmanager
    def hold(self, descriptor: int) -> Iterator[socket.socket]:
        """Give a duplicate of a connection.

        Raises:
            OSError: If it has gone.
        """
        os.dup2(descriptor, self._held, inheritable=False)
        try:
            connection = socket.socket(fileno=self._held)
            try:
                yield connection
            finally:
                connection.detach()
        finally:
            os.dup2(self._nothing, self._held, inheritable=False)

    def bytes_received(self, descriptor: int) -> int:
        """Return how many bytes have come on a TCP connection; 0 if it has gone."""
        try:
            with self.hold(descriptor) as connection:
                size = _BYTES_RECEIVED.size
                info = connection.getsockopt(socket.IPPROTO_TCP, socket.TCP_INFO, size)
                received: int = _BYTES_RECEIVED.unpack(info)[0]
                return received
        except (OSError, struct.error):  # an older kernel tells less
            return 0


def most_connections() -> int:
    """Return how many connections a port takes: half of the descriptors left, 64 at most."""
    limit, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    if limit == resource.RLIM_INFINITY:
        return MAX_CONNECTIONS
    in_use = sum(1 for _ in Path("/proc/self/fd").iterdir())
    return max(1, min(MAX_CONNECTIONS, (limit - in_use) // 2))
