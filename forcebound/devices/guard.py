"""A guard around a device that can fail: its failures are DeviceErrors, its answers are checked."""

import math
from collections.abc import Callable, Sequence
from typing import Any

from forcebound.devices import Device, Kinematics
from forcebound.devices.truth import Truth
from forcebound.errors import DeviceError, GuardianError
from forcebound.messages.packets import MAX_COUNT, Quaternion, Vector
from forcebound.parts.contract import is_unit
from forcebound.parts.user_module import describe_user_error


class GuardedDevice:
    """A device whose code may raise anything or answer nonsense.

    Args:
        device: Open.

    Attributes:
        set_hold_limit: Guarded, as are the next seven; None if the device does not have it; see
            :class:`forcebound.devices.DeviceExtras`.
        cut: When and where the watchdog has dropped a force.
        stamps: When the last reading was latched, and when the last write acts.
        latch_jitter: By how much the last reading may be later than its stamp.
        orientation: Of the tip at the last reading.
        buttons: Which were down at the last reading.
        fresh_reading: What came with the last write.
        kinematics: Geometry of an arm.

    Raises:
        DeviceError: From every method but ``close``, if the device fails or does not answer with
            one finite number per axis.
    """

    def __init__(self, device: Device) -> None:
        self._device = device
        self.set_hold_limit: Callable[[float], float] | None
        self.set_hold_limit = _guard(device, "set_hold_limit", _checked_limit)
        self.cut: Callable[[], tuple[int, Vector] | None] | None
        self.cut = _guard(device, "cut", self._checked_cut)
        self.stamps: Callable[[], tuple[int, int]] | None
        self.stamps = _guard(device, "stamps", _checked_stamps)
        self.latch_jitter: Callable[[], int] | None = _guard(device, "latch_jitter", int)
        self.orientation: Callable[[], Quaternion] | None
        self.orientation = _guard(device, "orientation", _checked_orientation)
        self.buttons: Callable[[], int] | None = _guard(device, "buttons", _checked_buttons)
        self.fresh_reading: Callable[[], Vector | None] | None
        self.fresh_reading = _guard(device, "fresh_reading", self._checked_fresh)
        geometry: Any = getattr(device, "kinematics", None)
        self._place, self._effort = ("m", "N") if geometry is None else ("rad", "N m")
        self.kinematics: Kinematics | None
        self.kinematics = None if geometry is None else _GuardedKinematics(geometry)
        try:
            self._axes = device.axes
        except Exception as error:
            raise _failure("axes", error) from error

    @property
    def axes(self) -> int:
        """Number of axes; see :class:`forcebound.devices.Device`."""
        return self._axes

    def engage(self, time_ns: int) -> None:
        """Engage the device; see :class:`forcebound.devices.Device`."""
        try:
            self._device.engage(time_ns)
        except Exception as error:
            raise _failure("engage", error) from error

    def read(self, time_ns: int) -> Vector:
        """Return the readings; see :class:`forcebound.devices.Device`."""
        try:
            return self._checked(self._device.read(time_ns), self._place)
        except Exception as error:
            raise _failure("read", error) from error

    def write(self, time_ns: int, force: Vector) -> Vector:
        """Hold a force; see :class:`forcebound.devices.Device`."""
        try:
            return self._checked(self._device.write(time_ns, force), self._effort)
        except Exception as error:
            raise _failure("write", error) from error

    def truth(self) -> Truth | None:
        """Return the ground truth; see :class:`forcebound.devices.Device`."""
        try:
            return self._device.truth()
        except Exception as error:
            raise _failure("truth", error) from error

    def close(self) -> None:
        """Close the device; see :class:`forcebound.devices.Device`."""
        self._device.close()

    def _checked(self, answer: Sequence[float], unit: str) -> Vector:
        vector = tuple([float(entry) for entry in answer])
        if len(vector) != self._axes or not all(map(math.isfinite, vector)):
            raise DeviceError(f"expected {self._axes} finite numbers in {unit}, got {answer!r}")
        return vector

    def _checked_fresh(self, answer: Any) -> Vector | None:
        return None if answer is None else self._checked(answer, self._place)

    def _checked_cut(self, answer: Any) -> tuple[int, Vector] | None:
        if answer is None:
            return None
        time_ns, reading = answer
        return int(time_ns), self._checked(reading, self._place)


class _GuardedKinematics:
    """Kinematics whose code may raise anything or answer nonsense."""

    def __init__(self, kinematics: Kinematics) -> None:
        self.position = _guard(kinematics, "position", _finite)
        self.torque = _guard(kinematics, "torque", _finite)


def _finite(answer: Sequence[float]) -> Vector:
    vector = tuple([float(entry) for entry in answer])
    if not all(map(math.isfinite, vector)):
        raise DeviceError(f"expected finite numbers, got {answer!r}")
    return vector


def _checked_limit(answer: Any) -> float:
    if not isinstance(answer, int | float) or not 0.0 < answer < math.inf:
        raise DeviceError(f"expected the hold limit that was set, > 0 s, got {answer!r}")
    return float(answer)


def _checked_orientation(answer: Any) -> Quaternion:
    w, x, y, z = map(float, answer)
    if not is_unit((w, x, y, z)):
        raise DeviceError(f"expected 4 numbers of length 1 (w x y z), got {answer!r}")
    return w, x, y, z


def _checked_buttons(answer: Any) -> int:
    buttons = int(answer)
    if not 0 <= buttons <= MAX_COUNT:
        raise DeviceError(f"expected 0 to {MAX_COUNT}, a bit for each button, got {answer!r}")
    return buttons


def _checked_stamps(answer: Any) -> tuple[int, int]:
    read_ns, write_ns = answer
    return int(read_ns), int(write_ns)


def _guard(part: Any, name: str, check: Callable[[Any], Any] = lambda answer: answer) -> Any:
    """Return a method whose failures are DeviceErrors; None if there is none."""
    method = getattr(part, name, None)
    if method is None:
        return None

    def guarded(*arguments: Any) -> Any:
        try:
            return check(method(*arguments))
        except Exception as error:
            raise _failure(name, error) from error

    return guarded


def _failure(method: str, error: Exception) -> DeviceError:
    words = str(error) if isinstance(error, DeviceError) else describe_user_error(error)
    kind = GuardianError if isinstance(error, GuardianError) else DeviceError
    return kind(f"the device failed in {method}: {words}")
