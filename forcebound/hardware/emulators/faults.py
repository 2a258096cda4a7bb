"""Faults on demand: what an emulated board does wrong, and when."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from random import Random

from forcebound.errors import ConfigError
from forcebound.units import parse_quantity

KINDS = {
    "short": "a reply lacks its last byte",
    "noise": "one byte of a reply is another",
    "nan": "the readings of a reply are no numbers",
    "lost": "one byte of what is written to the board is lost",
    "reset": "the firmware is reset and forgets its set-up; a hAPI board keeps its torque",
    "stall": "the board neither reads nor answers; its torque stays",
    "unplug": "the port is gone",
    "reversed": "the motors turn the wrong way",
}
#: Of the emulated service of an Inverse3; docs/devices.md says what each does.
SERVICE_KINDS: tuple[str, ...] = (
    "stall",
    "restart",
    "late",
    "doubled",
    "malformed",
    "foreign",
    "unplug",
    "busy",
)
SERVICE_KINDS += ("ebrake", "motor_stall", "uncalibrated", "old", "new")
#: Of an emulated bus of servos, beside those above but nan; of one servo where it names one.
SERVO_KINDS = {kind: words for kind, words in KINDS.items() if kind != "nan"} | {
    "silent": "a servo does as it is ordered, and answers nothing",
    "checksum": "the checksum of a servo's answer is wrong",
    "overload": "a servo is overloaded: its torque goes off, and each of its answers says so",
    "voltage": "the supply has less than half of its voltage",
    "watchdog": "the bus watchdog of a servo (Dynamixel) has fired",
    "cut": "the cable before a servo breaks within its answer: it and those behind have no power",
}
#: By the kind of device, where they are others than :data:`KINDS`.
KINDS_OF: dict[str, Iterable[str]] = {
    "dynamixel": SERVO_KINDS,
    "feetech": [kind for kind in SERVO_KINDS if kind != "watchdog"],
    "haply_inverse3": SERVICE_KINDS,
}
OF_SERVO = ("silent", "checksum", "overload", "watchdog", "cut")
#: Kinds of every emulator that go on for ever without an end; the others happen once.
LASTING: tuple[str, ...] = ("stall", "unplug", "reversed", "busy", "ebrake", "motor_stall")
LASTING += ("silent", "voltage", "cut")
DURATIONS = {"restart": 0.5}  # s, of kinds that have one by default
FORM = "KIND[:at=TIME][,for=TIME], such as stall:at=2s,for=50ms"
SERVO_FORM = "KIND[:at=TIME][,for=TIME][,servo=ID], such as silent:at=2s,servo=3"


@dataclass(frozen=True)
class Fault:
    """One fault.

    Attributes:
        kind: A key of :data:`KINDS`, or one of another emulator's.
        at: Begin, in s after the first reply.
        duration: In s; None: for ever, or, if it is not :data:`LASTING`, once.
        servo: Id of the servo that it is of, on a bus; None: of whichever it can be.
    """

    kind: str
    at: float = 1.0
    duration: float | None = None
    servo: int | None = None


def parse_fault(text: str, kinds: Iterable[str] = KINDS) -> Fault:
    """Return the fault of some ``kinds`` that a text describes, as in :data:`FORM`."""
    kind, _, rest = text.partition(":")
    if kind not in kinds:
        raise ConfigError(f"no kind of fault is {kind!r}: use one of {', '.join(kinds)}")
    times: dict[str, float] = {}
    servo = None
    for part in rest.split(",") if rest else ():
        name, _, value = part.partition("=")
        if name == "servo" and kind in OF_SERVO and value.isdecimal() and servo is None:
            servo = int(value)
            continue
        if name not in ("at", "for") or name in times:
            form = SERVO_FORM if kind in OF_SERVO else FORM
            raise ConfigError(f"a fault has the form {form}; got {text!r}")
        times[name] = parse_quantity(value, "s")
        if not times[name] >= 0.0:
            raise ConfigError(f"a time of a fault must be >= 0 s, got {value}")
    return Fault(kind, times.get("at", 1.0), times.get("for", DURATIONS.get(kind)), servo)


class Faults:
    """The faults of one board over time, which counts from its first reply.

    Attributes:
        servos: Ids of those that they name.
    """

    def __init__(self, faults: Sequence[Fault]) -> None:
        self._faults = tuple(faults)
        self._random = Random(1)
        self._start_ns: int | None = None
        self._done: set[Fault] = set()
        self.servos = {one.servo for one in self._faults if one.servo is not None}

    def begin(self, time_ns: int) -> None:
        """Count from now on, if it does not count yet."""
        if self._start_ns is None:
            self._start_ns = time_ns

    def is_planned(self, kind: str) -> bool:
        """Return whether a kind is among them, at any time."""
        return any(one.kind == kind for one in self._faults)

    def is_on(self, kind: str, time_ns: int, servo: int | None = None) -> bool:
        """Return whether a fault of a kind is on; one that happens once is over then.

        ``servo``: on a bus, one of this servo, or of none by name.
        """
        if self._start_ns is None or not self._faults:
            return False
        elapsed = (time_ns - self._start_ns) * 1e-9
        found = [
            one
            for one in self._faults
            if one.kind == kind
            and one.servo in (None, servo)
            and one not in self._done
            and one.at <= elapsed < one.at + (math.inf if one.duration is None else one.duration)
        ]
        if kind not in LASTING:
            self._done.update(fault for fault in found if fault.duration is None)
        return bool(found)

    def lose(self, data: bytes, time_ns: int) -> bytes:
        """Return what comes to the board of bytes that were written."""
        if not self.is_on("lost", time_ns):
            return data
        place = self._random.randrange(len(data))
        return data[:place] + data[place + 1 :]

    def spoil(self, reply: bytes, time_ns: int) -> bytes:
        """Return what becomes of a reply."""
        if self.is_on("noise", time_ns):
            spoiled = bytearray(reply)
            spoiled[self._random.randrange(len(reply))] ^= self._random.randrange(1, 256)
            reply = bytes(spoiled)
        return reply[:-1] if self.is_on("short", time_ns) else reply
