"""A guard around a device that can fail: its failures are DeviceErrors, its answers are checked."""

import math
from collections.abc import Sequence

from forcebound.devices import Device
from forcebound.devices.truth import Truth
from forcebound.errors import DeviceError
from forcebound.messages.packets import Vector
from forcebound.parts.user_module import describe_user_error


class GuardedDevice:
    """A device whose code may raise anything or answer nonsense.

    Args:
        device: Open.

    Raises:
        DeviceError: From every method but ``close``, if the device fails or does not answer with
            one finite number per axis.
    """

    def __init__(self, device: Device) -> None:
        self._device = device
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
            return self._checked(self._device.read(time_ns), "m")
        except Exception as error:
            raise _failure("read", error) from error

    def write(self, time_ns: int, force: Vector) -> Vector:
        """Hold a force; see :class:`forcebound.devices.Device`."""
        try:
            return self._checked(self._device.write(time_ns, force), "N")
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


def _failure(method: str, error: Exception) -> DeviceError:
    words = str(error) if isinstance(error, DeviceError) else describe_user_error(error)
    return DeviceError(f"the device failed in {method}: {words}")
