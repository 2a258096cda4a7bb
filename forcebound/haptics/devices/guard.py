"""A guard around a device of others' code, which may raise anything or answer nonsense."""

import math
from collections.abc import Callable
from functools import partial
from typing import Any, TypeVar

from forcebound.errors import DeviceError, GuardianError
from forcebound.haptics.devices import Device, Kinematics
from forcebound.haptics.parts.contract import is_unit
from forcebound.haptics.parts.user_module import describe_user_error
from forcebound.messages.packets import MAX_COUNT, Quaternion, Vector

T = TypeVar("T", int, float)
_NEEDED = ("read", "write", "position", "torque")  # they never return None
_OTHERS = [
    name
    for name, value in vars(Device).items()
    if callable(value) and name[0] != "_" and name not in (*_NEEDED, "close")
]


class GuardedDevice(Device):
    """Another device, whose failures are DeviceErrors that name the method, its answers checked.

    ``close`` alone passes on what it raises. DeviceError if it does not have its attributes.
    """

    def __init__(self, device: Device) -> None:
        try:
            self.axes, kinematics = device.axes, device.kinematics
            self.is_exchange = device.is_exchange
        except Exception as error:
            raise _failure("its attributes", error) from error
        self.published = device.published
        place, effort = ("m", "N") if kinematics is None else ("rad", "N m")
        if kinematics is not None:
            self.kinematics = _GuardedKinematics(kinematics, self.axes)
        reading = partial(_vector, axes=self.axes, unit=place)
        checks: dict[str, Callable[[Any], Any]] = {
            "fresh_reading": reading,
            "cut": lambda answer: (int(answer[0]), reading(*answer[1:])),
            "stamps": lambda answer: tuple(map(int, answer)),
            "latch_jitter": partial(_number, int, 0, "how much later a reading may be, in ns"),
            "set_hold_limit": partial(_number, float, math.ulp(0.0), "the hold limit, in s"),
            "orientation": _orientation,
            "buttons": partial(_number, int, 0, "a bit for each button"),
            "measured_force": lambda answer: _vector(answer, None, "N"),
        }
        held = partial(_vector, axes=self.axes, unit=effort)
        self._read: Callable[[int], Vector] = _guarded(device, "read", reading)
        self._write: Callable[[int, Vector], Vector] = _guarded(device, "write", held)
        self.close = device.close  # type: ignore[method-assign]
        for name in _OTHERS:
            setattr(self, name, _guarded(device, name, checks.get(name)))

    def read(self, time_ns: int) -> Vector:
        """Return the checked readings."""
        return self._read(time_ns)

    def write(self, time_ns: int, force: Vector) -> Vector:
        """Return the checked force that is applied."""
        return self._write(time_ns, force)


class _GuardedKinematics(Kinematics):
    def __init__(self, kinematics: Kinematics, axes: int) -> None:
        place = partial(_vector, axes=None, unit="m")
        effort = partial(_vector, axes=axes, unit="N m")
        self._position: Callable[[Vector], Vector] = _guarded(kinematics, "position", place)
        self._torque: Callable[[Vector, Vector], Vector] = _guarded(kinematics, "torque", effort)

    def position(self, angles: Vector) -> Vector:
        return self._position(angles)

    def torque(self, angles: Vector, force: Vector) -> Vector:
        return self._torque(angles, force)


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


def _number(kind: type[T], least: float, what: str, answer: Any) -> T:
    number = kind(answer)
    if not least <= number <= MAX_COUNT:
        raise DeviceError(f"expected {what}, {least:.0f} to {MAX_COUNT}, got {answer!r}")
    return number


def _orientation(answer: Any) -> Quaternion:
    w, x, y, z = map(float, answer)
    if not is_unit((w, x, y, z)):
        raise DeviceError(f"expected 4 numbers of length 1 (w x y z), got {answer!r}")
    return w, x, y, z


def _failure(method: str, error: Exception) -> DeviceError:
    words = str(error) if isinstance(error, DeviceError) else describe_user_error(error)
    kind = GuardianError if isinstance(error, GuardianError) else DeviceError
    return kind(f"the device failed in {method}: {words}")
