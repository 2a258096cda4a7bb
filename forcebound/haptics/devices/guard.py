"""A guard around a device of others' code, which may raise anything or answer nonsense."""

import math
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, cast

from forcebound.errors import DeviceError, GuardianError
from forcebound.haptics.devices import Device
from forcebound.haptics.parts.contract import is_unit
from forcebound.haptics.parts.user_module import describe_user_error
from forcebound.messages.packets import MAX_COUNT, Quaternion, Vector

_METHODS = [name for name, value in vars(Device).items() if callable(value) and name[0] != "_"]
_NEEDED = ("read", "write", "position", "torque")  # they never return None


def guarded(device: Device) -> Device:
    """Return the device; its failures are DeviceErrors that name the method, its answers checked.

    ``close`` alone passes on what it raises. DeviceError if it does not have its attributes.
    """
    try:
        kinematics, axes = device.kinematics, device.axes
        is_exchange = device.is_exchange
    except Exception as error:
        raise _failure("its attributes", error) from error
    place, effort = ("m", "N") if kinematics is None else ("rad", "N m")

    def cut(answer: Any) -> tuple[int, Vector]:
        time_ns, reading = answer
        return int(time_ns), _vector(reading, axes, place)

    checks: dict[str, Callable[[Any], Any]] = {
        "read": lambda answer: _vector(answer, axes, place),
        "write": lambda answer: _vector(answer, axes, effort),
        "fresh_reading": lambda answer: _vector(answer, axes, place),
        "cut": cut,
        "stamps": lambda answer: tuple(map(int, answer)),
        "latch_jitter": _jitter,
        "set_hold_limit": _seconds,
        "orientation": _orientation,
        "buttons": _buttons,
        "measured_force": lambda answer: _vector(answer, None, "N"),
    }
    methods = {name: _guarded(device, name, checks.get(name)) for name in _METHODS}
    if kinematics is not None:
        position = _guarded(kinematics, "position", lambda answer: _vector(answer, None, "m"))
        torque = _guarded(kinematics, "torque", lambda answer: _vector(answer, axes, "N m"))
        kinematics = cast(Any, SimpleNamespace(position=position, torque=torque))
    methods["close"] = device.close
    own = {"axes": axes, "kinematics": kinematics, "is_exchange": is_exchange}
    return cast(Device, SimpleNamespace(**own, published=device.published, **methods))


def _guarded(part: Any, name: str, check: Callable[[Any], Any] | None) -> Callable[..., Any]:
    method, needs_answer = getattr(part, name), name in _NEEDED

    def call(*arguments: Any) -> Any:
        try:
            answer = method(*arguments)
            if check is None or (answer is None and not needs_answer):
                return answer
            return check(answer)
        except Exception as error:
            raise _failure(name, error) from error

    return call


def _vector(answer: Any, axes: int | None, unit: str) -> Vector:
    vector = tuple([float(entry) for entry in answer])
    if (axes is not None and len(vector) != axes) or not all(map(math.isfinite, vector)):
        raise DeviceError(f"expected {axes or ''} finite numbers in {unit}, got {answer!r}")
    return vector


def _seconds(answer: Any) -> float:
    if not 0.0 < answer < math.inf:
        raise DeviceError(f"expected the hold limit that was set, > 0 s, got {answer!r}")
    return float(answer)


def _jitter(answer: Any) -> int:
    if not answer >= 0:
        raise DeviceError(f"expected how much later a reading may be, >= 0 ns, got {answer!r}")
    return int(answer)


def _orientation(answer: Any) -> Quaternion:
    w, x, y, z = map(float, answer)
    if not is_unit((w, x, y, z)):
        raise DeviceError(f"expected 4 numbers of length 1 (w x y z), got {answer!r}")
    return w, x, y, z


def _buttons(answer: Any) -> int:
    buttons = int(answer)
    if not 0 <= buttons <= MAX_COUNT:
        raise DeviceError(f"expected 0 to {MAX_COUNT}, a bit for each button, got {answer!r}")
    return buttons


def _failure(method: str, error: Exception) -> DeviceError:
    words = str(error) if isinstance(error, DeviceError) else describe_user_error(error)
    kind = GuardianError if isinstance(error, GuardianError) else DeviceError
    return kind(f"the device failed in {method}: {words}")
