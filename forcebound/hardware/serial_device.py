"""Devices of joints on a serial line: what their drivers have in common."""

import logging
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Any, Literal

from forcebound.devices.stated_joints import StatedJoints
from forcebound.devices.truth import Truth
from forcebound.hardware.line import EMULATED, Line
from forcebound.messages.packets import Vector
from forcebound.quantities import POSITIVE, Time

SIMULATED = (
    *("inertia", "damping", "friction", "resolution", "presliding"),
    *("gain_error", "lag", "substep", "truth"),
)

_logger = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class SerialJoints(StatedJoints):
    """What a model of such a device states, beside its joints.

    Attributes:
        port: Path of the serial port, auto, the serial number of its USB device, or emulated.
        on_loss: Of the device, while the force is on: end ends the graph; wait keeps it, without
            force, until the device is in order and the user says so (`forcebound device resume`).
        reply_within: A reply later than this is counted as late.
    """

    port: str = EMULATED
    on_loss: Literal["end", "wait"] = "end"
    reply_within: Annotated[Time, POSITIVE] = 3e-4

    def simulated_joints(self) -> dict[str, Any]:
        """Return the numbers that a simulated arm takes for the same joints, by name."""
        return {name: getattr(self, name) for name in SIMULATED}


class Replies:
    """A count of the replies of a board.

    Args:
        within: A reply later than this is late, in s.

    Attributes:
        count: Of all.
        late: Of those that were late.
    """

    def __init__(self, within: float) -> None:
        self._within = within
        self._within_ns = round(within * 1e9)
        self.count = self.late = 0

    def add(self, took_ns: int, count: int = 1) -> None:
        """Count replies that came together, so long after the request, in ns."""
        self.count += count
        self.late += took_ns > self._within_ns

    def forget_late(self) -> None:
        """Count late ones from now on: those of the start are no ticks."""
        self.late = 0

    def log(self) -> None:
        """Write the counts to the log, if there are any."""
        if self.count:
            share, limit = 100.0 * self.late / self.count, 1e3 * self._within
            message = "%d replies of the board, %.2f %% of them later than %.2g ms"
            _logger.info(message, self.count, share, limit)


class SerialDevice:
    """An open device on a line; its driver adds reading and writing.

    Args:
        line: To its board.
        clock: Monotonic, in ns.
    """

    def __init__(self, line: Line, clock: Callable[[], int] = time.monotonic_ns) -> None:
        self._line, self._clock = line, clock
        self._read_ns = self._effect_ns = self._jitter_ns = 0
        self._came_ns = 0  # when the last write's reply had come
        self._quickest_ns = 0  # of all readings so far
        self._angles: Vector = ()  # newest, rad

    def engage(self, time_ns: int) -> None:
        """Let an emulated hand begin to move; see :class:`forcebound.devices.Device`."""
        if self._line.truth is not None:
            self._line.truth.engage(time_ns)

    def stamps(self) -> tuple[int, int]:
        """Return when reading and force were; see :class:`forcebound.devices.DeviceExtras`."""
        return self._read_ns, max(self._effect_ns, self._read_ns)

    def fresh_reading(self) -> Vector | None:
        """Return the angles of the last write; see :class:`forcebound.devices.DeviceExtras`."""
        is_fresh = self._clock() - self._came_ns <= self._quickest_ns
        return self._angles if is_fresh else None

    def latch_jitter(self) -> int:
        """Return how late the reading may be; see :class:`forcebound.devices.DeviceExtras`."""
        return self._jitter_ns

    def truth(self) -> Truth | None:
        """Return the ground truth of an emulated device; None for a real one."""
        return None if self._line.truth is None else self._line.truth.read()
