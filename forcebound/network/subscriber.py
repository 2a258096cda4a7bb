"""One stream in, of which all packets count or only the newest.

CONFLATE would keep the newest with less work, but a message of several frames may abort the process
that reads such a socket, and all but its last frame are lost without a word (traps 1 and 9 of
:mod:`forcebound.network.sockets`). So the socket keeps everything, and is emptied here.
"""

from functools import partial

import zmq
from zmq.backend import Socket as _CompiledSocket

WAIT_MS = 10  # longest sleep in a receiving call
DRAIN_LIMIT = 1_000  # messages taken at once from a peer that floods; about 3 ms

# Plain integers: arithmetic on Python's enum members costs more than the call that it is for.
_EVENTS, _POLLIN, _RCVMORE = int(zmq.EVENTS), int(zmq.POLLIN), int(zmq.RCVMORE)
_DONTWAIT = int(zmq.DONTWAIT)


class Subscriber:
    """One stream in.

    Args:
        socket: SUB without CONFLATE.
        newest_only: Whether only the newest packet counts.

    Attributes:
        newest_only: Whether only the newest packet counts; may be changed.
        descriptor: Readable when something has happened; edge-triggered, so it may be waited for
            only while :attr:`emptied`, or after :meth:`pending` has found nothing.
        emptied: Whether the last :meth:`take` or :meth:`receive_ready` has left nothing.
        superseded: Packets for which a newer one was there already.
    """

    def __init__(self, socket: "zmq.Socket[bytes]", newest_only: bool) -> None:
        self._socket = socket
        socket.set(zmq.RCVTIMEO, WAIT_MS)
        self._recv = partial(_CompiledSocket.recv, socket)
        # The compiled method: pyzmq's Python one makes an enum member of the name first.
        self._get = _CompiledSocket.get
        self.newest_only = newest_only
        self._malformed = 0  # messages of several frames that are still to be returned as b""
        self.descriptor = int(socket.FD)
        self.emptied = False
        self.superseded = 0

    def pending(self) -> bool:
        """Whether a packet is there."""
        return self._malformed > 0 or self._has_message()

    def wait(self) -> bytes | None:
        """Sleep in the receiving call, for ``WAIT_MS`` at most; return one packet as :meth:`take`.

        Whatever the settings, it may be one for which a newer one is there already.
        """
        try:
            data = self._recv()
        except zmq.Again:
            return None
        if not self._get(self._socket, _RCVMORE):
            return data
        return self._receive_rest()

    def take(self) -> bytes | None:
        """Return one packet, ``b""`` for a message of several frames, None for nothing.

        If only the newest counts it is that; at most ``DRAIN_LIMIT`` are looked at.
        """
        self.emptied = False
        if self._malformed:
            self._malformed -= 1
            return b""
        newest: bytes | None = None
        for _ in range(DRAIN_LIMIT if self.newest_only else 1):
            try:
                data = self._receive_whole()
            except zmq.Again:
                self.emptied = True
                break
            if data == b"":
                self._malformed += 1
            else:
                self.superseded += newest is not None
                newest = data
            if not self._has_message():
                self.emptied = True
                break
        if self._malformed:
            self.emptied = False
            if newest is None:
                self._malformed -= 1
                return b""
        return newest

    def receive_ready(self) -> list[bytes]:
        """Return what has arrived: the newest packet, or all of them; ``b""`` as in :meth:`take`.

        At most ``DRAIN_LIMIT`` at once: a peer that floods must not hold the loop.
        """
        messages: list[bytes] = []
        while len(messages) < DRAIN_LIMIT:
            data = self.take()
            if data is None:
                break
            messages.append(data)
            if self.emptied or (self.newest_only and not self._malformed):
                break
        return messages

    def receive(self) -> list[bytes]:
        """Do as :meth:`receive_ready`, when it is not known that there is anything."""
        return self.receive_ready() if self.pending() else []

    def _receive_whole(self) -> bytes:
        """Return a message; ``b""`` in place of one that has several frames."""
        data = self._recv(_DONTWAIT)
        return data if not self._get(self._socket, _RCVMORE) else self._receive_rest()

    def _receive_rest(self) -> bytes:
        while self._get(self._socket, _RCVMORE):
            self._recv(_DONTWAIT)  # the frames of a message arrive together
        return b""

    def _has_message(self) -> bool:
        return bool(int(self._get(self._socket, _EVENTS)) & _POLLIN)
