"""A hAPI board that answers as a test has it, on a line without process or waiting."""

import struct
from collections.abc import Callable

from forcebound.errors import DeviceError
from forcebound.hardware.hapi import EXCHANGE, exchange_message
from forcebound.messages.packets import Vector
from forcebound.testing import AnsweredLine

HOME = (162, 2277)  # counts that the firmware says right after a set-up of version 3
FREE = (700, 1800)  # counts in which all of a torque is applied
ZERO = exchange_message(5, (0.0, 0.0))
Reply = Callable[["ScriptedBoard"], bytes]


def angles(board: "ScriptedBoard") -> bytes:
    """The reply of a board that is well."""
    return struct.pack("<Bff", 5, *(360.0 * counts / 4880 for counts in board.counts))


class ScriptedBoard(AnsweredLine):
    """A line to a board, and the board.

    Attributes:
        counts: Of its encoders.
        torques: That were written to it, in order.
        others: Other messages that were.
        reply: What it answers to an exchange.
        time_ns: A clock; it goes on by ``round_trip_ns`` for each reply that comes.
    """

    def __init__(self, reply: Reply = angles) -> None:
        super().__init__(self._respond)
        self.counts: tuple[int, int] = HOME
        self.torques: list[Vector] = []
        self.others: list[bytes] = []
        self.reply = reply
        self.time_ns = 1_000_000_000
        self.round_trip_ns = 80_000

    def clock(self) -> int:
        return self.time_ns

    def send(self, message: bytes | str, has_force: bool = False) -> None:
        super().send(message, has_force)
        if message[0] == EXCHANGE:
            assert has_force == any(self.torques[-1])

    def read(self, count: int, deadline_ns: int = 0) -> bytes:
        data = super().read(count)
        self.time_ns = deadline_ns if len(data) < count else self.time_ns + self.round_trip_ns
        return data

    def fail(self, failure: DeviceError) -> None:
        super().fail(failure)
        self._respond(ZERO)

    def close(self) -> None:
        super().close()
        self._respond(ZERO)

    def _respond(self, message: bytes) -> bytes:
        if message[0] != EXCHANGE:
            self.others.append(message)
            return b""
        self.torques.append(struct.unpack("<ff", message[2:]))
        return self.reply(self)
