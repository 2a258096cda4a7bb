"""A hAPI board that answers as a test has it, in place of a line: no process, no waiting."""

import struct
from collections.abc import Callable

from forcebound.errors import DeviceError
from forcebound.hardware.hapi import EXCHANGE, exchange_message
from forcebound.messages.packets import Vector

HOME = (162, 2277)  # counts that the firmware says right after a set-up of version 3
FREE = (700, 1800)  # counts in which all of a torque is applied
ZERO = exchange_message(5, (0.0, 0.0))
Reply = Callable[["ScriptedBoard"], bytes]


def angles(board: "ScriptedBoard") -> bytes:
    """The reply of a board that is well."""
    return struct.pack("<Bff", 5, *(360.0 * counts / 4880 for counts in board.counts))


class ScriptedBoard:
    """A :class:`forcebound.hardware.line.Line` to a board, and the board; also its own port.

    Attributes:
        counts: Of its encoders.
        torques: That were written to it, in order.
        others: Other messages that were.
        reply: What it answers to an exchange.
        time_ns: A clock; it goes on by ``round_trip_ns`` for each reply that comes.
    """

    truth = None
    silence = 0.01  # s
    is_at_rest = False

    def __init__(self, reply: Reply = angles) -> None:
        self.port = self
        self.counts: tuple[int, int] = HOME
        self.torques: list[Vector] = []
        self.others: list[bytes] = []
        self.reply = reply
        self.time_ns = 1_000_000_000
        self.round_trip_ns = 80_000
        self.failures: list[DeviceError] = []
        self.is_closed = False
        self._sent = b""

    def clock(self) -> int:
        return self.time_ns

    def send(self, message: bytes, has_force: bool) -> None:
        if self.failures:
            raise self.failures[0]
        if foreign := self.drain():
            raise DeviceError(f"sends unexpected bytes: {foreign.hex()}")
        self._take(message)
        if message[0] == EXCHANGE:
            assert has_force == any(self.torques[-1])
            self._sent += self.reply(self)

    def drain(self) -> bytes:
        sent, self._sent = self._sent, b""
        return sent

    def read(self, count: int, deadline_ns: int) -> bytes:
        data, self._sent = self._sent[:count], self._sent[count:]
        self.time_ns = deadline_ns if len(data) < count else self.time_ns + self.round_trip_ns
        return data

    def fail(self, failure: DeviceError) -> None:
        self.failures.append(failure)
        self.is_at_rest = True
        self._take(ZERO)

    def close(self) -> None:
        self._take(ZERO)
        self.is_closed = True

    def _take(self, message: bytes) -> None:
        if message[0] == EXCHANGE:
            self.torques.append(struct.unpack("<ff", message[2:]))
        else:
            self.others.append(message)
