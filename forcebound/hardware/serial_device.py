"""An open device on a serial line: what drivers have in common."""

import time
from collections.abc import Callable

from forcebound.devices import Device
from forcebound.devices.kinematics import ArmKinematics
from forcebound.devices.truth import Truth
from forcebound.hardware.line import Line
from forcebound.hardware.ports import serial_number
from forcebound.hardware.replies import Replies
from forcebound.messages.packets import Vector


class SerialDevice(Device):
    """An open device on a line; its driver adds reading and writing.

    Args:
        line: To its board.
        reply_within: A reply later than this is late, in s; a reading is fresh for as long.
        clock: Monotonic, in ns.

    Attributes:
        replies: That have come since it was opened.
    """

    is_exchange = True
    kinematics: ArmKinematics  # pyright: ignore[reportIncompatibleVariableOverride]

    def __init__(
        self, line: Line, reply_within: float, clock: Callable[[], int] = time.monotonic_ns
    ) -> None:
        self._line, self._clock = line, clock
        self.replies = Replies(reply_within)
        self._fresh_ns = round(reply_within * 1e9)
        self._read_ns = self._effect_ns = self._jitter_ns = 0
        self._came_ns = 0  # when the last write's reply had come
        self._angles: Vector = ()  # newest, rad

    @property
    def serial_number(self) -> str:
        """Serial number of the USB device; empty if it has none."""
        return serial_number(self._line.port.path)

    def engage(self, time_ns: int) -> None:
        """Let an emulated hand begin to move; see :class:`forcebound.devices.Device`."""
        if self._line.truth is not None:
            self._line.truth.engage(time_ns)

    def stamps(self) -> tuple[int, int]:
        """Return when reading and force were; see :class:`forcebound.devices.Device`."""
        return self._read_ns, max(self._effect_ns, self._read_ns)

    def fresh_reading(self) -> Vector | None:
        """Return the angles of the last write; see :class:`forcebound.devices.Device`."""
        is_fresh = self._clock() - self._came_ns <= self._fresh_ns
        return self._angles if is_fresh else None

    def latch_jitter(self) -> int:
        """Return how late the reading may be; see :class:`forcebound.devices.Device`."""
        return self._jitter_ns

    def truth(self) -> Truth | None:
        """Return the ground truth of an emulated device; None for a real one."""
        return None if self._line.truth is None else self._line.truth.read()
