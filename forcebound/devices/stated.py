"""What a device states of its imperfections, for the bounder to rely on.

Every number has a default that switches it off. The mathematics stands in ``docs/theory.md``.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Annotated, Any, Literal, TypeAlias

from forcebound.errors import ConfigError
from forcebound.messages.packets import Vector
from forcebound.quantities import NOT_NEGATIVE, POSITIVE, Range, Ratio, Speed, Time, check_ranges

Watchdog: TypeAlias = Literal["reporting", "silent", "none"]
Source: TypeAlias = Literal["measured", "data sheet", "assumed"]


@dataclass(frozen=True, kw_only=True)
class StatedImperfections:
    """Imperfections that have the same unit on every device.

    Attributes:
        gain_error: The motor gives the commanded force to within this share, constant in time.
        lag: Time constant of the amplifier, first order.
        write_delay: Largest time from a read to the moment when the force of its write acts.
        largest_speed: A reading that implies more is refused; null: none is.
        watchdog: What drops a force that is older than the hold limit: a watchdog that reports
            where it did, one that does not, or none.
        watchdog_tolerance: The watchdog drops the force within this share of the hold limit.
        watchdog_limit: Without a watchdog that keeps the hold limit: age at which the hardware
            drops a force after all; null: never.
        sources: By name of a number: measured, data sheet or assumed; for reports.
    """

    gain_error: Annotated[Ratio, Range(at_least=0, below=1)] = 0.0
    lag: Annotated[Time, NOT_NEGATIVE] = 0.0
    write_delay: Annotated[Time, NOT_NEGATIVE] = 0.0
    largest_speed: Annotated[Speed, POSITIVE] | None = None
    watchdog: Watchdog = "reporting"
    watchdog_tolerance: Annotated[Ratio, Range(at_least=0, below=1)] = 0.0
    watchdog_limit: Annotated[Time, POSITIVE] | None = None
    sources: Mapping[str, Source] = field(default_factory=dict, hash=False)

    def __post_init__(self) -> None:
        check_ranges(self)
        for name, symbol in (("largest_speed", "m/s"), ("watchdog_limit", "s")):
            if getattr(self, name) is not None:
                check_per_axis(self, name, POSITIVE, symbol)
        known = {each.name for each in fields(self)}
        for name in self.sources:
            if name not in known:
                raise ConfigError(f"sources: the device has no number {name!r}", field="sources")


def per_axis(value: float | Vector, axes: int) -> Vector:
    """Return a number that is alike on every axis, or one of each, as one of each."""
    return tuple(value) if isinstance(value, tuple) else (value,) * axes


def check_per_axis(model: Any, name: str, permitted: Range, symbol: str) -> None:
    """Check a field that is one number, or a tuple of one per axis.

    Raises:
        ConfigError: If a number is outside of ``permitted``, or there are not ``axes`` of them.
    """
    value = getattr(model, name)
    if isinstance(value, tuple) and len(value) != model.axes:
        message = f"{name} must be one number, or {model.axes} (one per axis), got {len(value)}"
        raise ConfigError(message, field=name)
    for number in per_axis(value, model.axes):
        try:
            permitted.check(number, symbol)
        except ConfigError as error:
            raise ConfigError(f"{name} {error}", field=name) from None
