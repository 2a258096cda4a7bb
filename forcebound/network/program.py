"""The socket to a program that drives a device; ``examples/cpp/forcebound_device.hpp`` is its end.

A request and its reply: 4 bytes of magic, 4 of the kind, then doubles, as this machine has them, or
the text of an error.
"""

import struct
from collections.abc import Sequence

import zmq

from forcebound.errors import DeviceError
from forcebound.messages.packets import Vector
from forcebound.network.sockets import make_socket

MAGIC = b"FBD1"
KINDS = {"hello": b"helo", "read": b"read", "write": b"writ", "stop": b"stop"}
OKAY, FAILED = b"okay", b"fail"


class ProgramLink:
    """Exchanges with a program at an endpoint; ConfigError for one that cannot be."""

    def __init__(self, endpoint: str) -> None:
        self._endpoint = endpoint
        self._context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        try:
            self._socket = make_socket(self._context, zmq.REQ, endpoint, bind=False)
        except BaseException:
            self._context.destroy(linger=0)
            raise

    def waits_for(self, seconds: float) -> bool:
        """Return whether there is a program at the endpoint, after so long at most."""
        return bool(self._socket.poll(round(1e3 * seconds), zmq.POLLOUT))

    def ask(self, kind: str, numbers: Sequence[float], timeout: float) -> Vector:
        """Return the numbers of the reply; DeviceError if it fails, or is not there in time (s)."""
        message = MAGIC + KINDS[kind] + struct.pack(f"={len(numbers)}d", *numbers)
        if not self.waits_for(timeout):
            raise DeviceError(f"no program of a device answers at {self._endpoint}")
        self._socket.send(message, zmq.DONTWAIT)
        if not self._socket.poll(round(1e3 * timeout)):
            raise DeviceError(f"no answer to {kind} for {1e3 * timeout:g} ms (device.timeout)")
        reply = self._socket.recv(zmq.DONTWAIT)
        head, body = reply[:8], reply[8:]
        if head == MAGIC + FAILED:
            raise DeviceError(f"{kind}: {body.decode('utf-8', 'replace')}")
        if head != MAGIC + OKAY or len(body) % 8:
            raise DeviceError(f"{self._endpoint} answers, but is no program of a device")
        return struct.unpack(f"={len(body) // 8}d", body)

    def close(self) -> None:
        """Close the socket."""
        self._context.destroy(linger=0)
