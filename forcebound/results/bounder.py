"""The bounder in a run: what it met, and where it made the force smaller."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from forcebound.messages.control import BounderReport
from forcebound.messages.events import BOUNDER_REPORTED
from forcebound.messages.packets import Event
from forcebound.recordings.launched import DeviceSection
from forcebound.recordings.telemetry import TelemetryColumns
from forcebound.results.surface import Floats, Mask

LIMITED_SHARE = 0.5  # of the ticks with a force in which the law makes it smaller
UNBOUNDED = 1.0 - 1e-9  # of the saturated force; below, it was made smaller, not merely rounded


class Cause(NamedTuple):
    """A likely cause of something, and what to do about it."""

    code: str
    advice: str
    command: str = ""  # of a shell, which helps
    data: Mapping[str, float | str] = {}  # SI units

    @property
    def remedy(self) -> str:
        """What to do, with the command."""
        return f"{self.advice}: {self.command}" if self.command else self.advice


def bounder_report(events: Sequence[Event]) -> BounderReport | None:
    """Return the last report of the bounder among the events; None: there is none."""
    for event in reversed(events):
        if event.event == BOUNDER_REPORTED:
            return BounderReport.from_texts(event.data)
    return None


def saturated(columns: TelemetryColumns, device: DeviceSection) -> Floats:
    """Return the commanded force after saturation, which the law gets, in N, shape (n, axes).

    Args:
        columns: Telemetry of a run.
        device: Of its launch file; without ``saturation`` nothing is saturated.

    An arm saturates its torques. They have the direction of those of the commanded force, so the
    force at the tip is saturated in the ratio in which torques and saturation are.
    """
    commanded = columns.commanded_force
    if device.saturation is None:
        return commanded
    size = np.linalg.norm(commanded, axis=1)
    largest = device.saturation * columns.engagement
    torque = np.linalg.norm(columns.torques, axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        if np.isfinite(torque).any():
            given = np.linalg.norm(columns.applied_force, axis=1)
            largest = np.where(torque > 0.0, largest / torque * given, np.inf)
        share = np.where(size > largest, largest / size, 1.0)
    return np.asarray(share[:, np.newaxis] * commanded)


class Limited:
    """Where a law made the force of a run smaller.

    Attributes:
        wanted: Size of the commanded force after saturation, in N, shape ``(n,)``.
        applied: Size of the applied force, in N, likewise.
        pushing: Which ticks have a force.
        limited: In which of them the law reduced it.
    """

    def __init__(self, columns: TelemetryColumns, device: DeviceSection) -> None:
        """Compare the forces of a run with the device of its launch file."""
        self.wanted: Floats = np.linalg.norm(saturated(columns, device), axis=1)
        self.applied: Floats = np.linalg.norm(columns.applied_force, axis=1)
        self.pushing: Mask = self.wanted > 0.0
        self.limited: Mask = (self.applied < UNBOUNDED * self.wanted) & self.pushing

    def __bool__(self) -> bool:
        """Whether the law makes the force smaller in most ticks that have one."""
        return bool(self.limited.sum() > LIMITED_SHARE * self.pushing.sum())
