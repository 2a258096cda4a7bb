"""Requests to a process and their answers, of :mod:`forcebound.messages.control`, as msgpack."""

import math
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import reduce
from operator import or_
from typing import Any

import msgpack
import msgspec
import zmq
from zmq.backend import Socket as _CompiledSocket

from forcebound.messages.control import Answer, Refused, Request

_EVENTS, _POLLIN, _POLLOUT = int(zmq.EVENTS), int(zmq.POLLIN), int(zmq.POLLOUT)
OVERDUE = 1.0  # s without an answer, after which a request is sent again: its process has restarted
SERVE_LIMIT = 4  # requests answered at once; a node looks 100 times a second
_MAX_ITEMS = 256  # in a list or map of a request or its answer


class ControlServer:
    """Answers requests of some classes, from the launcher and other programs of the user."""

    def __init__(self, socket: "zmq.Socket[bytes]", requests: Sequence[type[Request]]) -> None:
        self._socket = socket
        self._requests: Any = reduce(or_, requests)
        self._known = ", ".join(str(one.__struct_config__.tag) for one in requests)
        self.descriptor = int(socket.FD)

    def pending(self) -> bool:
        """Return whether a request is there."""
        return _has(self._socket, _POLLIN)

    def serve(self, answer: Callable[[Any], Answer], limit: int = SERVE_LIMIT) -> bool:
        """Answer at most ``limit`` of the requests that are there; return whether more may be."""
        for _ in range(limit):
            data = _receive(self._socket) if self.pending() else None
            if data is None:
                return False
            with suppress(zmq.Again):
                self._socket.send(_encode(self._answered(data, answer)), zmq.DONTWAIT)
        return self.pending()

    def _answered(self, data: bytes, answer: Callable[[Any], Answer]) -> Answer:
        try:
            request = _decode(data, self._requests)
        except ValueError as error:
            return Refused(f"{error}; known requests: {self._known}")
        return answer(request)


class ControlClient:
    """Sends requests to a :class:`ControlServer`, without ever waiting."""

    def __init__(self, socket: "zmq.Socket[bytes]") -> None:
        self._socket = socket
        self._asked = -math.inf  # s, monotonic: when the request was sent that waits for its answer
        self.descriptor = int(socket.FD)

    def pending(self) -> bool:
        """Return whether an answer is there."""
        return _has(self._socket, _POLLIN)

    def ask(self, request: Request) -> bool:
        """Send a request in place of the one before; return False while no server is there."""
        if not _has(self._socket, _POLLOUT):
            return False
        with suppress(zmq.Again):
            self._socket.send(_encode(request), zmq.DONTWAIT)
            self._asked = time.monotonic()
            return True
        return False

    def poll(self, request: Request) -> None:
        """Send a request, unless one waits for its answer.

        A request that is replaced loses its answer. So a process that is slow, and is asked more
        often than it looks, would never be heard.
        """
        if time.monotonic() - self._asked > OVERDUE:
            self.ask(request)

    def answer(self) -> Answer | None:
        """Return the answer to the last request, or None while it has not come."""
        data = _receive(self._socket) if self.pending() else None
        if data is None:
            return None
        self._asked = -math.inf
        try:
            answer: Answer = _decode(data, Answer)
        except ValueError as error:
            return Refused(f"the answer is of another version of forcebound: {error}")
        return answer


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


def _encode(message: Request | Answer) -> bytes:
    data: bytes = msgpack.packb(msgspec.to_builtins(message))
    return data


def _decode(data: bytes, kind: Any) -> Any:
    """Return the message of a union of classes; ValueError if it is none of them."""
    try:
        plain = msgpack.unpackb(data, max_array_len=_MAX_ITEMS, max_map_len=_MAX_ITEMS)
        return msgspec.convert(plain, kind)
    except (msgspec.ValidationError, OverflowError, RecursionError) as error:
        raise ValueError(str(error)) from error
