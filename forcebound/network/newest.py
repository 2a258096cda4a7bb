"""The newest packet from a stranger: what CONFLATE does, without its traps."""

import zmq

from forcebound.network.sockets import DRAIN_LIMIT, receive_whole

_EVENTS, _POLLIN = int(zmq.EVENTS), int(zmq.POLLIN)


class NewestSubscriber:
    """One stream in, from another machine; the same methods as
    :class:`forcebound.network.sockets.Subscriber`.

    With CONFLATE, a message of several frames may abort the process (trap 9 of
    :mod:`forcebound.network.sockets`), and all but its last frame are lost without a word. So the
    socket keeps everything, and is emptied here.

    Args:
        socket: SUB, without CONFLATE.
        newest_only: Whether only the newest packet counts.

    Attributes:
        newest_only: Whether only the newest packet counts; may be changed.
        descriptor: Readable when something has happened; edge-triggered, so ask :meth:`pending`
            before it is waited for again.
        superseded: Packets for which a newer one was there already.
    """  # noqa: D205  # the name of the class it stands for does not fit into one line

    def __init__(self, socket: "zmq.Socket[bytes]", newest_only: bool) -> None:
        self._socket = socket
        self.newest_only = newest_only
        self._malformed = 0  # messages of several frames that are still to be returned as b""
        self.descriptor = int(socket.FD)
        self.superseded = 0

    def pending(self) -> bool:
        """Whether a packet is there."""
        return self._malformed > 0 or self._has_message()

    def take(self) -> bytes | None:
        """Return the newest packet, ``b""`` for a message of several frames, None for nothing."""
        if self._malformed:
            self._malformed -= 1
            return b""
        newest: bytes | None = None
        for _ in range(DRAIN_LIMIT if self.newest_only else 1):
            try:
                data = receive_whole(self._socket)
            except zmq.Again:
                break
            if not data:
                self._malformed += 1
            else:
                self.superseded += newest is not None
                newest = data
            if not self._has_message():
                break
        if newest is None and self._malformed:
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
            if not self._malformed and (self.newest_only or not self._has_message()):
                break
        return messages

    def receive(self) -> list[bytes]:
        """Do as :meth:`receive_ready`, when it is not known that there is anything."""
        return self.receive_ready() if self.pending() else []

    def _has_message(self) -> bool:
        events = self._socket.get(_EVENTS)
        assert isinstance(events, int)
        return bool(events & _POLLIN)
