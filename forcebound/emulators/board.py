"""Contract of an emulated board."""

from typing import Protocol

from forcebound.messages.packets import Vector


class Board(Protocol):
    """The firmware of a board: bytes and angles in, bytes and torques out.

    It has no clock: it is told the time, which never runs backwards.

    Attributes:
        angles: Of the motors' shafts now, in rad; set before each :meth:`receive`.
        torque: What the motors give now, in N m, positive towards larger angles.
        wake_ns: When it has something to do by itself, in ns, such as to end a wait; None: never.
    """

    angles: Vector
    torque: Vector
    wake_ns: int | None

    def receive(self, data: bytes, time_ns: int) -> bytes:
        """Take bytes that have come together; return what the board sends now.

        It is called without bytes when ``wake_ns`` has come, and every millisecond or so.
        """
        ...

    def reset(self) -> None:
        """Forget what was set up: a fault on demand."""
        ...

    def with_nan(self, reply: bytes) -> bytes:
        """Return a reply in which every reading is not a number: a fault on demand."""
        ...
