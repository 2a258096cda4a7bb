"""Requests to an ODrive: timed, checked, and the end of the line where one fails."""

import time
from collections.abc import Callable
from typing import Generic, NamedTuple, NoReturn, TypeVar

from forcebound.errors import DeviceError
from forcebound.hardware.line import Line
from forcebound.hardware.odrive_lines import answer, number, request
from forcebound.hardware.replies import Replies

PATIENCE = 0.5  # s, with a board that has not been given a force yet

Said = TypeVar("Said")


class Exchange(NamedTuple, Generic[Said]):
    """A message and its replies."""

    sent_ns: int
    quickest_ns: int  # that one of its kind took so far
    excess_ns: int  # that this one took longer
    said: list[Said]


class Requests:
    """Requests to the board on a line.

    Args:
        line: To the board.
        replies: Counts those to the messages.

    Attributes:
        patience: A board that is silent for longer is lost, in s.
    """

    def __init__(self, line: Line, replies: Replies) -> None:
        self._line = line
        self._quickest_ns: dict[str, int] = {}
        self.patience = max(PATIENCE, line.silence)
        self._replies = replies

    def exchange(
        self,
        kind: str,
        message: bytes,
        count: int,
        parse: Callable[[str], Said],
        has_force: bool = False,
    ) -> Exchange[Said]:
        """Send a message and wait for its replies.

        Args:
            kind: Of the message; those of a kind should take equally long.
            message: Lines.
            count: Of replies.
            parse: Reads a reply.
            has_force: Whether the board gives a force after the message.

        Raises:
            DeviceError: If the replies are not what is expected: zero torque was written.
        """
        line = self._line
        try:
            sent_ns = time.monotonic_ns()
            line.send(message, has_force)
            data = line.port.read_lines(count, sent_ns + round(self.patience * 1e9))
            took_ns = time.monotonic_ns() - sent_ns
            said = [parse(answer(one)) for one in self._lines(data, count)]
        except DeviceError as failure:
            self.end(failure)
        self._replies.note(took_ns)
        quickest_ns = min(self._quickest_ns.get(kind, took_ns), took_ns)
        self._quickest_ns[kind] = quickest_ns
        return Exchange(sent_ns, quickest_ns, took_ns - quickest_ns, said)

    def _lines(self, data: bytes, count: int) -> list[bytes]:
        """Return the replies in ``data``, as many as were asked for."""
        if not data:
            raise DeviceError(
                f"no reply within {1e3 * self.patience:g} ms: is this the port of an ODrive, does"
                " it have power, is this machine too busy to hear it (`forcebound doctor`)?"
            )
        *lines, rest = data.split(b"\r\n")
        if len(lines) != count or rest:
            raise DeviceError(
                f"expected a reply to each request, {count} in all, got {data[:40]!r}: is this the"
                " port of an ODrive with firmware 0.5?"
            )
        return lines

    def value(self, name: str) -> float | None:
        """Return the value of a property; None if the board does not have it."""

        def parse(text: str) -> float | None:
            return None if text == "invalid property" else number(text, name)

        return self.exchange("property", request(f"r {name}"), 1, parse).said[0]

    def begin(self, message: bytes) -> None:
        """Send lines without force, and pass over what comes until the board has processed all.

        A board answers an empty line, or the end of one that a former user has begun; when it does
        so is up to the machine. Nothing but a request with a checksum gets a reply with one.

        Raises:
            DeviceError: If there is no such reply.
        """
        line, data = self._line, b""
        try:
            line.send(message + request("r fw_version_major"), has_force=False)
            deadline_ns = time.monotonic_ns() + round(self.patience * 1e9)
            while not (b"*" in data and data.endswith(b"\n")):
                more = line.port.read_lines(1, deadline_ns)
                data += more
                if not more:
                    answer(self._lines(data, 1)[0])
        except DeviceError as failure:
            self.end(failure)

    def tell(self, message: bytes) -> None:
        """Send lines without replies, and without force."""
        self._line.send(message, has_force=False)

    def end(self, failure: DeviceError) -> NoReturn:
        """Write zero torque, refuse all further messages, raise the failure."""
        self._line.fail(failure)
        raise failure
