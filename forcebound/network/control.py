"""Requests to a process and their answers: a msgpack map for a msgpack map."""

from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import Any

import msgpack
import zmq
from zmq.backend import Socket as _CompiledSocket

_EVENTS, _POLLIN, _POLLOUT = int(zmq.EVENTS), int(zmq.POLLIN), int(zmq.POLLOUT)
SERVE_LIMIT = 4  # requests answered at once; a node looks 100 times a second
_MAX_ITEMS = 256  # in a list or map of a request or its answer


class ControlServer:
    """Answers requests, msgpack maps, from the launcher and other programs of the user."""

    def __init__(self, socket: "zmq.Socket[bytes]") -> None:
        self._socket = socket
        self.descriptor = int(socket.FD)

    def pending(self) -> bool:
        """Whether a request is there."""
        return _has(self._socket, _POLLIN)

    def serve(
        self, answer: Callable[[Mapping[str, Any]], Mapping[str, Any]], limit: int = SERVE_LIMIT
    ) -> bool:
        """Answer the requests that are there; one that is not a map gets an ``error``.

        Returns:
            Whether more may be there: at most ``limit`` are answered in one turn of a loop, so that
            a flood does not hold it.
        """
        for _ in range(limit):
            data = _receive(self._socket) if self.pending() else None
            if data is None:
                return False
            request = _unpack_map(data)
            reply = {"error": "a request is a msgpack map"} if request is None else answer(request)
            with suppress(zmq.Again):
                self._socket.send(msgpack.packb(dict(reply)), zmq.DONTWAIT)
        return self.pending()


class ControlClient:
    """Sends requests to a :class:`ControlServer`, without ever waiting."""

    def __init__(self, socket: "zmq.Socket[bytes]") -> None:
        self._socket = socket
        self.descriptor = int(socket.FD)

    def pending(self) -> bool:
        """Whether an answer is there."""
        return _has(self._socket, _POLLIN)

    def ask(self, request: Mapping[str, Any]) -> bool:
        """Send a request in place of the one before; return False while no server is there."""
        if not _has(self._socket, _POLLOUT):
            return False
        with suppress(zmq.Again):
            self._socket.send(msgpack.packb(dict(request)), zmq.DONTWAIT)
            return True
        return False

    def answer(self) -> dict[str, Any] | None:
        """Return the answer to the last request, or None while it has not come."""
        data = _receive(self._socket) if self.pending() else None
        return None if data is None else _unpack_map(data)


def _has(socket: "zmq.Socket[bytes]", event: int) -> bool:
    # The compiled method: a servo asks at 1 kHz, and pyzmq's Python one takes twice as long.
    return bool(int(_CompiledSocket.get(socket, _EVENTS)) & event)


def _receive(socket: "zmq.Socket[bytes]") -> bytes | None:
    """Return the message that EVENTS announced; None if there is none.

    EVENTS also counts an answer to a request that was given up, and a peer that has left since.
    """
    try:
        return b"".join(socket.recv_multipart(zmq.DONTWAIT))
    except zmq.Again:
        return None


def _unpack_map(data: bytes) -> dict[str, Any] | None:
    try:
        value = msgpack.unpackb(data, max_array_len=_MAX_ITEMS, max_map_len=_MAX_ITEMS)
    except (ValueError, OverflowError, RecursionError):
        return None
    return value if isinstance(value, dict) else None
