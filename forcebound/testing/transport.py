"""Lines to a device that is no device: a script of messages, or a function that answers.

Both stand where a driver has its :class:`~forcebound.hardware.line.Line`, the
:class:`~forcebound.hardware.port.Port` of one, or a connection of text messages (``send`` and
``recv``, as a WebSocket has them). There is no process, guardian or waiting: silence is what a
driver sees at once when nothing is there to read. The line's own message of zero force, which its
guardian and its end write, is no part of a script.
"""

import json
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from itertools import takewhile
from typing import Any, TypeAlias

from forcebound.errors import DeviceError
from forcebound.hardware.line import Line
from forcebound.hardware.port import Port

#: Bytes, a text, or a document (dict or list), which travels as JSON text; None: no message.
Message: TypeAlias = bytes | str | dict[str, Any] | list[Any] | None


class AnsweredLine(Line, Port):
    """A line to a function, such as an emulated board: what it returns is there to be read.

    Attributes:
        is_closed: Whether the driver has closed it.
    """

    truth = None
    path = "scripted"

    # A line is opened with a port and a guardian, which there are not here.
    def __init__(self, answer: Callable[[Any], Message]) -> None:
        self.port = self
        self.silence = 0.01
        self.is_at_rest = self.is_closed = False
        self._failure: DeviceError | None = None
        self._answer = answer
        self._bytes = b""
        self._texts: list[str] = []

    def send(self, message: bytes | str, has_force: bool = False) -> None:
        """Send a message; DeviceError if the line has failed, or bytes came that nobody reads."""
        if self._failure is not None:
            raise self._failure
        if isinstance(message, bytes) and (foreign := self.drain()):
            raise DeviceError(f"the device sends unexpected bytes: {foreign.hex(' ')}")
        self.write(message)

    def write(self, message: bytes | str) -> None:
        """Write a message, whatever has come."""
        self.receive(self._answer(message))

    def read(self, count: int, deadline_ns: int = 0) -> bytes:
        """Return ``count`` bytes, or those that there are; of texts the next, whole."""
        if self._texts and not self._bytes:
            return self._texts.pop(0).encode()
        data, self._bytes = self._bytes[:count], self._bytes[count:]
        return data

    def read_lines(self, count: int, deadline_ns: int = 0) -> bytes:
        """Return all bytes that have come, or else all texts."""
        return self.read_until() or self.drain()

    def read_until(
        self, missing: Callable[[bytes], int] | None = None, deadline_ns: int = 0
    ) -> bytes:
        """Return all bytes that have come."""
        data, self._bytes = self._bytes, b""
        return data

    def drain(self, quiet: float = 0.0) -> bytes:
        """Return all that has come."""
        data, self._bytes, self._texts = self._bytes + "".join(self._texts).encode(), b"", []
        return data

    def recv(self, timeout: float | None = None) -> str:
        """Return the next text; TimeoutError if there is none."""
        if not self._texts:
            raise TimeoutError("no message has come")
        return self._texts.pop(0)

    def fail(self, failure: DeviceError) -> None:
        """Refuse every message from now on."""
        self._failure = self._failure or failure
        self.is_at_rest = True

    def close(self) -> None:
        """Note that the line is closed."""
        self.is_closed = True

    def receive(self, message: Message) -> None:
        """Let a message of the device come, asked for or not."""
        if isinstance(message, bytes):
            self._bytes += message
        elif message is not None:
            self._texts.append(message if isinstance(message, str) else json.dumps(message))


class Scripted(AnsweredLine):
    """A line that expects the messages of a script; :func:`scripted` makes it."""

    def __init__(
        self, exchanges: Sequence[tuple[Message, Message]], decode: Callable[[Any], Message]
    ) -> None:
        super().__init__(self._next)
        self._exchanges, self._decode, self._done = exchanges, decode, 0
        self.difference: AssertionError | None = None
        self._hear()

    def _next(self, sent: bytes | str) -> Message:
        """Return the reply to a message if it is the expected one."""
        message = self._decode(sent)
        left, self._done = self._exchanges[self._done :], self._done + 1
        expected, reply = left[0] if left else (None, None)
        if self.difference is None and not _is_same(expected, message):
            place = f"exchange {self._done} of {len(self._exchanges)}"
            words = f"{place}: expected {_shown(expected)}, but the driver sent {_shown(message)}"
            self.difference = AssertionError(words)
        if self.difference is not None:
            raise self.difference
        self.receive(reply)
        self._hear()
        return None

    def _hear(self) -> None:
        """Receive what comes without a message of the driver."""
        for _, unasked in takewhile(lambda one: one[0] is None, self._exchanges[self._done :]):
            self.receive(unasked)
            self._done += 1

    def end(self) -> None:
        """Check that all was sent as expected, and that all that came was read."""
        if self.difference is not None:
            raise self.difference
        if missing := self._exchanges[self._done :]:
            place = f"{len(missing)} of {len(self._exchanges)} exchanges are left over"
            raise AssertionError(f"{place}: the driver did not send {_shown(missing[0][0])}")
        if unread := self._bytes or "".join(self._texts):
            raise AssertionError(f"the driver did not read {_shown(unread)}")


@contextmanager
def scripted(
    *exchanges: tuple[Message, Message], decode: Callable[[Any], Message] = lambda sent: sent
) -> Iterator[Scripted]:
    """Stand in for the line to a device in a test of a driver's messages.

    Each exchange is what the driver must send, as one message, and what it then receives; None in
    place of the first: it comes unasked, as what a service sends when a client connects. A document
    (dict or list) is a JSON text, whatever its spaces and the order of its keys. ``decode`` takes a
    message of the driver out of its frame, before it is compared::

        with scripted((bytes.fromhex("02 05 00 00"), bytes.fromhex("05 8f 36 3f"))) as line:
            assert OpenMotor(Motor(), line).read(0) == (0.012,)

    Raises:
        AssertionError: At the first message that is another one, with the number of the exchange;
            at the end, too, if the driver has caught it, has sent too little, or has not read all.
    """
    line = Scripted(exchanges, decode)
    try:
        yield line
    except Exception as error:
        if line.difference is not None and error is not line.difference:
            raise line.difference from error  # it is the cause, whatever came of it
        raise
    line.end()


def _is_same(expected: Message, sent: Message) -> bool:
    if isinstance(expected, dict | list) and isinstance(sent, bytes | str):
        with suppress(ValueError):
            return bool(json.loads(sent) == expected)
    return expected == sent


def _shown(message: Message) -> str:
    """Return a message for a reader: bytes in hex, and as text if they are one."""
    if message is None:
        return "no further message"
    if not isinstance(message, bytes):
        return message if isinstance(message, str) else json.dumps(message)
    is_text = message.decode("latin-1").strip().isprintable() and message.isascii()
    return (message.hex(" ") or "no bytes") + (f" ({message!r})" if is_text else "")
