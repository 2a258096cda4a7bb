"""Lines of the ODrive's ASCII protocol, with checksums both ways; firmware 0.5.

Every request has a checksum: the board passes a spoiled one over in silence, and puts one on its
reply.
"""

import math
from functools import reduce
from operator import xor

from forcebound.errors import DeviceError

IDLE, CLOSED_LOOP_CONTROL = 1, 8  # states of an axis
PASSED_THROUGH = 1  # input mode: a torque is given as it comes
DECIMALS = 6  # of a torque, in N m
WATCHDOG_EXPIRED = 0x800
#: Errors of an axis by their bit; the firmware's odrive-interface.yaml.
ERRORS = {
    0x1: "INVALID_STATE",
    0x40: "MOTOR_FAILED",
    0x80: "SENSORLESS_ESTIMATOR_FAILED",
    0x100: "ENCODER_FAILED",
    0x200: "CONTROLLER_FAILED",
    WATCHDOG_EXPIRED: "WATCHDOG_TIMER_EXPIRED",
    0x1000: "MIN_ENDSTOP_PRESSED",
    0x2000: "MAX_ENDSTOP_PRESSED",
    0x4000: "ESTOP_REQUESTED",
    0x20000: "HOMING_WITHOUT_ENDSTOP",
    0x40000: "OVER_TEMP",
    0x80000: "UNKNOWN_POSITION",
}


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
    """Return the line that sets a torque, in N m, positive towards larger angles.

    Raises:
        ValueError: If it is not finite: the board would take it.
    """
    if not math.isfinite(torque):
        raise ValueError(f"a torque must be finite, got {torque} N m")
    return request(f"c {axis} {torque:.{DECIMALS}f}")


def answer(line: bytes) -> str:
    """Return what a line of the board says, without its checksum.

    Raises:
        DeviceError: If it has none, or a wrong one.
    """
    text, star, checksum = line.rpartition(b"*")
    if not (star and checksum.isdigit() and int(checksum) == exclusive_or(text)):
        raise DeviceError(f"the board's reply {line[:40]!r} is spoiled: its checksum is wrong")
    return text.decode("latin-1")


def position(text: str) -> float:
    """Return the position in a reply to ``f``, in turns.

    Raises:
        DeviceError: If it is not two finite numbers.
    """
    words = text.split()
    try:
        turns, velocity = map(float, words)
    except ValueError:
        turns = velocity = math.nan
    if not (math.isfinite(turns) and math.isfinite(velocity)):
        raise DeviceError(f"expected position and velocity from the board, got {text[:40]!r}")
    return turns


def number(text: str, what: str) -> float:
    """Return the value of a property.

    Raises:
        DeviceError: If it is no number, as where the board has no such property.
    """
    try:
        return float(text)
    except ValueError:
        raise DeviceError(f"expected the number {what} from the board, got {text[:40]!r}") from None


def error_words(error: int) -> str:
    """Return an axis's error as its number and the names of its bits."""
    names = [name for bit, name in ERRORS.items() if error & bit]
    return f"0x{error:x}" + (f" ({', '.join(names)})" if names else "")
