"""One stream in.

CONFLATE would keep the newest packet with less work, but a message of several frames may abort the
process that reads such a socket (trap 9 of :mod:`forcebound.network.sockets`). So the socket keeps
every packet, and the reader takes the newest one.
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
    """One stream in, of a SUB without CONFLATE.

    Its descriptor is edge-triggered: wait for it only after :meth:`pending` has found nothing.
    """

    def __init__(self, socket: "zmq.Socket[bytes]") -> None:
        self._socket = socket
        socket.set(zmq.RCVTIMEO, WAIT_MS)
        self._recv = partial(_CompiledSocket.recv, socket)
        # The compiled method: pyzmq's Python one makes an enum member of the name first.
        self._get = _CompiledSocket.get
        self.descriptor = int(socket.FD)

    def pending(self) -> bool:
        """Whether a packet is there."""
        return bool(int(self._get(self._socket, _EVENTS)) & _POLLIN)

    def wait(self) -> bytes | None:
        """Sleep in the receiving call for at most ``WAIT_MS``; return one packet, or None.

        The packet is ``b""`` for a message of several frames. A newer one may be there already.
        """
        try:
            return self._receive(0)
        except zmq.Again:
            return None

    def receive(self) -> list[bytes]:
        """Return the packets that have arrived, ``b""`` for a message of several frames.

        At most ``DRAIN_LIMIT`` at once: a peer that floods must not hold the loop.
        """
        packets: list[bytes] = []
        try:
            while len(packets) < DRAIN_LIMIT and self.pending():
                packets.append(self._receive(_DONTWAIT))
        except zmq.Again:  # EVENTS also counts the message of a peer that has just left
            pass
        return packets

    def _receive(self, flags: int) -> bytes:
        data = self._recv(flags)
        if not self._get(self._socket, _RCVMORE):
            return data
        while self._get(self._socket, _RCVMORE):
            self._recv(_DONTWAIT)  # the frames of a message arrive together
        return b""
