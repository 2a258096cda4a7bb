"""What a device states of its imperfections, for the bounder to rely on.

Every number has a default that switches it off. The mathematics stands in ``docs/theory.md``.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Annotated, Any, Literal, TypeAlias

from forcebound.bounding.dissipation import Watchdog
from forcebound.errors import ConfigError
from forcebound.messages.packets import Vector
from forcebound.quantities import (
    NOT_NEGATIVE,
    POSITIVE,
    Damping,
    Force,
    Length,
    Range,
    Ratio,
    Speed,
    Time,
    check_ranges,
)

Source: TypeAlias = Literal["measured", "data sheet", "assumed"]

# One number for all axes alike, or a list of one for each axis.
DampingOfAxes: TypeAlias = (
    Annotated[Damping, NOT_NEGATIVE] | tuple[Annotated[Damping, NOT_NEGATIVE], ...]
)
FrictionOfAxes: TypeAlias = (
    Annotated[Force, NOT_NEGATIVE] | tuple[Annotated[Force, NOT_NEGATIVE], ...]
)
LengthOfAxes: TypeAlias = (
    Annotated[Length, NOT_NEGATIVE] | tuple[Annotated[Length, NOT_NEGATIVE], ...]
)
ForceOfAxes: TypeAlias = Annotated[Force, Range()] | tuple[Annotated[Force, Range()], ...]


@dataclass(frozen=True, kw_only=True)
class StatedImperfections:
    """Imperfections that have the same unit on every device.

    Attributes:
        gain_error: The motor gives the commanded force to within this share, constant in time.
        lag: Time constant of the amplifier, first order.
        write_delay: Largest time from a read to the moment when the force of its write acts.
        largest_speed: A reading that implies more is refused; null: none is.
        watchdog: What drops a force that is older than the hold limit: a watchdog that guards it
            (it drops the force once a reading moves back, and reports it), one that drops it and
            reports when and where, one that does not report, or none.
        watchdog_tolerance: The watchdog drops the force within this share of the hold limit.
        watchdog_limit: Without a watchdog that keeps the hold limit: age at which the hardware
            drops a force after all; auto: never, or after 100 ms if it is guarded.
        guard_period: Of a guarding watchdog, from the last look that saw nothing to the force being
            gone after the next look. It looks first at the hold limit.
        sources: By name of a number: measured, data sheet or assumed; for reports.
    """

    gain_error: Annotated[Ratio, Range(at_least=0, below=1)] = 0.0
    lag: Annotated[Time, NOT_NEGATIVE] = 0.0
    write_delay: Annotated[Time, NOT_NEGATIVE] = 0.0
    largest_speed: Annotated[Speed, POSITIVE] | None = None
    watchdog: Watchdog = "guarding"
    watchdog_tolerance: Annotated[Ratio, Range(at_least=0, below=1)] = 0.0
    watchdog_limit: Annotated[Time, POSITIVE] | Literal["auto"] = "auto"
    guard_period: Annotated[Time, POSITIVE] = 50e-6
    sources: Mapping[str, Source] = field(default_factory=dict, hash=False)

    def __post_init__(self) -> None:
        check_ranges(self)
        known = {each.name for each in fields(self)}
        for name in self.sources:
            if name not in known:
                raise ConfigError(f"sources: the device has no number {name!r}", field="sources")


def per_axis(value: float | Vector, axes: int) -> Vector:
    """Return a number that is alike on every axis, or one of each, as one of each."""
    return tuple(value) if isinstance(value, tuple) else (value,) * axes


def check_count(value: Any, name: str, axes: int) -> None:
    """Check that a tuple has as many numbers as there are axes.

    Raises:
        ConfigError: If it has not.
    """
    if isinstance(value, tuple) and len(value) != axes:
        message = f"{name} must be one number, or {axes} (one per axis), got {len(value)}"
        raise ConfigError(message, field=name)
