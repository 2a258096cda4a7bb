"""Lines of the ODrive's ASCII protocol, and requests; firmware 0.5.

Every request has a checksum. The board ignores a request whose checksum is wrong, and adds one to
each reply.
"""

import math
import re
import time
from collections.abc import Callable, Sequence
from enum import IntFlag
from functools import reduce
from operator import xor
from typing import NoReturn, TypeVar

from forcebound.errors import DeviceError
from forcebound.hardware.line import Line
from forcebound.hardware.port import CHUNK
from forcebound.hardware.serial_device import LONGEST_WAIT, Exchange, Exchanges

Value = TypeVar("Value")

IDLE, CLOSED_LOOP_CONTROL = 1, 8  # states of an axis
PASSED_THROUGH = 1  # input mode: a torque is given as it comes
DECIMALS = 6  # of a torque, in N m
WATCHDOG_EXPIRED = 0x800


class AxisError(IntFlag):
    """Errors of an axis; the firmware's odrive-interface.yaml."""

    INVALID_STATE = 0x1
    MOTOR_FAILED = 0x40
    SENSORLESS_ESTIMATOR_FAILED = 0x80
    ENCODER_FAILED = 0x100
    CONTROLLER_FAILED = 0x200
    WATCHDOG_TIMER_EXPIRED = WATCHDOG_EXPIRED
    MIN_ENDSTOP_PRESSED = 0x1000
    MAX_ENDSTOP_PRESSED = 0x2000
    ESTOP_REQUESTED = 0x4000
    HOMING_WITHOUT_ENDSTOP = 0x20000
    OVER_TEMP = 0x40000
    UNKNOWN_POSITION = 0x80000


def exclusive_or(text: bytes) -> int:
    """Return the checksum of a line: of all that comes before the asterisk."""
    return reduce(xor, text, 0)


def request(command: str) -> bytes:
    """Return a command as a line, with its checksum."""
    text = command.encode("ascii") + b" "
    return b"%s*%d\n" % (text, exclusive_or(text))


def on_wire(torque: float) -> float:
    """Return the torque, in N m, that the wire has for ``torque`` or less of it."""
    step = 10.0**-DECIMALS
    nearest = round(torque, DECIMALS)
    if abs(nearest) <= abs(torque):
        return nearest
    return round(nearest - math.copysign(step, torque), DECIMALS)


def torque_request(axis: int, torque: float) -> bytes:
    """Return the line that sets a torque, in N m, positive towards larger angles; finite."""
    if not math.isfinite(torque):
        raise ValueError(f"a torque must be finite, got {torque} N m")
    return request(f"c {axis} {torque:.{DECIMALS}f}")


def answer(line: bytes) -> str:
    """Return the text of a reply without its checksum; DeviceError if that is wrong or missing."""
    text, star, checksum = line.rpartition(b"*")
    if not star or checksum != b"%d" % exclusive_or(text):
        raise DeviceError(f"the board's reply {line[:40]!r} is spoiled: its checksum is wrong")
    return text.decode("latin-1")


def position(text: str) -> float:
    """Return the position in a reply to ``f``, in turns; DeviceError if it has none."""
    words = text.split()
    try:
        turns, velocity = map(float, words)
    except ValueError:
        turns = velocity = math.nan
    if not (math.isfinite(turns) and math.isfinite(velocity)):
        raise DeviceError(f"expected position and velocity from the board, got {text[:40]!r}")
    return turns


def positions(texts: Sequence[str]) -> list[float]:
    """Return the positions in replies to ``f``, in turns; DeviceError if one has none."""
    return [position(text) for text in texts]


def number(text: str, name: str) -> float:
    """Return the value of a property, which may be infinite; DeviceError if it is no number."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if math.isnan(value):
        raise DeviceError(f"expected the number {name} from the board, got {text[:40]!r}")
    return value


def whole_number(text: str, name: str) -> int:
    """Return the value of a property that counts or has bits; DeviceError if it has no digits."""
    if not re.fullmatch("[0-9]{1,10}", text):
        raise DeviceError(f"expected the whole number {name} from the board, got {text[:40]!r}")
    return int(text)


def error_words(error: int) -> str:
    """Return an axis's error as its number and the names of its bits."""
    return f"0x{error:x} ({AxisError(error).name})"


class Requests(Exchanges):
    """Requests to the board on a line, each a line with a checksum."""

    def __init__(self, line: Line, within: float) -> None:
        super().__init__(line, within, time.monotonic_ns)
        self.longest_wait = max(LONGEST_WAIT, line.silence)

    def ask(
        self,
        kind: str,
        message: bytes,
        count: int,
        parse: Callable[[list[str]], Value],
        has_force: bool = False,
    ) -> Exchange[Value]:
        """Send lines to which the board has ``count`` replies; as :meth:`exchange`."""
        return self.exchange(
            kind,
            message,
            lambda until_ns: self._line.port.read_lines(count, until_ns),
            lambda data: parse([answer(line) for line in _lines(data, count)]),
            has_force,
        )

    def value(
        self, name: str, parse: Callable[[str, str], float] = number, before: bytes = b""
    ) -> float | None:
        """Return the value of a property after some lines; None if the board does not have it.

        DeviceError if the reply is another one.
        """

        def value(texts: list[str]) -> float | None:
            return None if texts[0] == "invalid property" else parse(texts[0], name)

        return self.ask("property", before + request(f"r {name}"), 1, value).reply

    def begin(self, message: bytes) -> None:
        """Send lines without force, and pass over what comes until the board has processed all.

        A board answers an empty line, or the end of one that a former user has begun; when it does
        so is up to the machine. Nothing but a request with a checksum gets a reply with one, and a
        DeviceError says what came instead.
        """

        def is_whole(data: bytes) -> bool:
            return b"*" in data and data.endswith(b"\n")

        def receive(until_ns: int) -> bytes:
            data = b""
            while not is_whole(data) and len(data) < CHUNK:
                more = self._line.port.read_lines(1, until_ns)
                if not more:
                    break
                data += more
            return data

        def check(data: bytes) -> None:
            if not is_whole(data):
                raise _unexpected("a reply with a checksum", data)

        self.exchange("begin", message + request("r fw_version_major"), receive, check)

    def send(self, message: bytes) -> None:
        """Send lines without replies, and without force."""
        self._line.send(message, has_force=False)

    def end(self, failure: DeviceError) -> NoReturn:
        """Write zero torque, refuse all further messages, raise the failure."""
        self._line.fail(failure)
        raise failure


def _lines(data: bytes, count: int) -> list[bytes]:
    """Return the replies in ``data``, as many as expected, else DeviceError."""
    *lines, rest = data.split(b"\r\n")
    if len(lines) != count or rest:
        raise _unexpected(f"a reply to each request, {count} in all", data)
    return lines


def _unexpected(expected: str, data: bytes) -> DeviceError:
    return DeviceError(
        f"expected {expected}, got {data[:40]!r}: is this the port of an ODrive with firmware 0.5?"
    )
