"""What figures and delays read of a launch file as resolved for a run, in SI units.

A document of before, or with code that is not ours, may lack any of it: then None, or empty.
"""

import math
from typing import Literal, TypeAlias

import msgspec
from msgspec import Struct

from forcebound.axes import Axis, AxisKind, common_kind, lengths, shown_on
from forcebound.errors import ConfigError
from forcebound.messages.topology import Document
from forcebound.units import Everyday

Auto: TypeAlias = Literal["auto"]


class DeviceSection(Struct, frozen=True):
    """Kind, law, clock and stated numbers of a device; of an arm they are those of its joints."""

    kind: str = ""
    law: str | None = None
    rate: float | None = None  # Hz
    reply_wait: float = 0.0  # periods
    hold_limit: float | Auto | None = None  # periods
    mass: float | None = None  # kg
    saturation: float | None = None  # N
    resolution: float | list[float] = 0.0  # m
    lag: float = 0.0  # s
    write_delay: float = math.inf  # s
    largest_speed: float | None = None  # m/s
    hand_speed: float | None = None  # m/s
    watchdog: str | None = None
    watchdog_tolerance: float | None = None
    watchdog_limit: float | Auto | None = "auto"  # s
    allowance: float = 0.0  # J
    energy_cap: float | Auto | None = "auto"  # J
    energy_partner: str = ""  # a hand
    sources: dict[str, str] | None = None  # of the stated numbers, by their names

    @property
    def cap(self) -> float | None:
        """The energy cap, in J; None: what the saturation can use."""
        return None if self.energy_cap == "auto" else self.energy_cap


class OperatorSection(Struct, frozen=True):
    """What holds a device."""

    kind: str = ""
    mass: float | None = None  # kg
    stiffness: float | None = None  # N/m
    damping: float | None = None  # N s/m


class HandSections(Struct, frozen=True):
    """The sections of a hand."""

    device: DeviceSection = DeviceSection()
    operator: OperatorSection = OperatorSection()
    controller: Document = {}
    axes: tuple[Axis, ...] = ()  # of a device that names them

    @property
    def axis_kind(self) -> AxisKind | None:
        """The kind of all axes; None if they differ."""
        return common_kind(self.axes)

    def named_axes(self, count: int) -> tuple[Axis, ...]:
        """Return the axes, of which there are so many."""
        return self.axes or lengths(count)

    def shown(self, unit: Everyday) -> Everyday:
        """Return the unit for people on its axes of what ``unit`` is for lengths."""
        return shown_on(self.axis_kind, unit)


class Launched(HandSections, frozen=True):
    """A launch file: of one hand alone, with its sections on top, or with hands by their names."""

    hands: dict[str, HandSections] = {}
    here: list[str] | None = None
    environment: Document = {}
    phases: list[Document] = []
    units: dict[str, str] = {}  # in which parameters were written, by their names


def launched(document: Document) -> Launched:
    """Return a resolved launch file as these records; ConfigError if a value is of another type."""
    try:
        return msgspec.convert(document, Launched)
    except msgspec.ValidationError as error:
        raise ConfigError(f"no figures of such a launch file: {error}") from error
