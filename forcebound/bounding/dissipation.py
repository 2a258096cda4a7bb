"""What is known of a device: the description that every bounding law relies on.

Fill it in from an identification of the device. Every number is a promise about the device: a
minimum of what it dissipates, a maximum of what it errs. ``docs/theory.md``, section 3, says how
the certified laws use each; ``docs/assumptions.md`` what a wrong one costs. Numbers that are 0 (or
have no limit) by default describe an effect that the device does not have.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal, TypeAlias, get_args

from forcebound.errors import ConfigError

#: A number for every axis alike, or one for each axis.
PerAxis: TypeAlias = float | tuple[float, ...]

#: ``guarding``: looks at the readings, first at the hold limit, drops the force when one of them
#: has moved back from where it was when that force began to act, and says when and where; see
#: ``guard_period``. ``reporting``: drops it at the hold limit, and says so.
#: ``silent``: drops it and says nothing. ``none``: the force stays on until the next write, or
#: until ``watchdog_limit``.
Watchdog: TypeAlias = Literal["guarding", "reporting", "silent", "none"]
WATCHDOGS: tuple[str, ...] = get_args(Watchdog)

#: Where a number comes from.
SOURCES = ("measured", "data sheet", "assumed")


@dataclass(frozen=True)
class Dissipation:
    """What a law may rely on about a device: the least that it dissipates, and its sampling.

    Coordinates are axes at the tip, in m and N, or joints, in rad and N m; then read "m" as rad and
    "N" as N m. Where a number for each axis is allowed, one number means all axes alike.

    Attributes:
        damping: Minimum viscous damping b, in N s/m; alike or for each axis.
        friction: Minimum Coulomb friction f_c, in N. One number: along the path of the tip. One for
            each axis: on each axis by itself.
        resolution: Step of the position reading Δ, in m; 0: exact readings; alike or for each axis.
        period: Nominal sampling period T, in s.
        hold_limit: Longest time T_max that the device holds a force, in s; it then drops it to 0.
            Without a watchdog: longest time for which a punctual force is planned.
        saturation: Largest force F_sat, in N.
        presliding: Way z_m over which friction yields elastically before it slides, in m: the
            friction divided by the bristle's stiffness; alike or for each axis.
        gain_error: Largest relative error x of a motor's force, constant in a run: it gives between
            1 - x and 1 + x of what it should. The motors of several axes may differ within that.
        lag: Time constant τ of the amplifier, first order, in s.
        write_delay: Longest time from latching a reading to the effect of the force written
            thereafter, in s; what it is in each sample is measured.
        largest_speed: Largest speed, in m/s. A reading that implies more is refused.
        watchdog: What happens to a force older than the hold limit; see :data:`Watchdog`.
        watchdog_tolerance: The watchdog drops the force, a guarding one looks first, somewhere
            between ``1 - tolerance`` and ``1 + tolerance`` hold limits.
        watchdog_limit: Without a watchdog: longest time that a force can stay on when no other
            comes, in s; then the hardware drops it, or something else that you vouch for. A
            guarding watchdog drops it then at the latest.
        guard_period: δ of a guarding watchdog, in s, less than the period: longest time from the
            last look that saw nothing to the force being gone after the next look. A force that
            has moved back before the hold limit is gone at the hold limit.
        allowance: Most that the hand may get out of holds longer than the hold limit, ε, in J.
        energy_cap: Most energy that a ledger keeps, in J; None: the most that the saturation can
            use.
        weight: Weight on each axis that the device carries by itself, in N, positive against
            positive motion; alike or for each axis. It acts when the force is dropped.
        weight_error: Largest error of that, constant in a run, in N, less than the friction, which
            must hold it; alike or for each axis.
        sources: Where numbers come from, by name: ``measured``, ``data sheet`` or ``assumed``. For
            reports alone.

    Raises:
        ConfigError: If a value is out of range, or the numbers do not go together.
    """

    damping: PerAxis
    friction: PerAxis
    resolution: PerAxis
    period: float
    hold_limit: float
    saturation: float
    presliding: PerAxis = 0.0
    gain_error: float = 0.0
    lag: float = 0.0
    write_delay: float = 0.0
    largest_speed: float = math.inf
    watchdog: Watchdog = "silent"
    watchdog_tolerance: float = 0.0
    watchdog_limit: float = math.inf
    guard_period: float = 0.0
    allowance: float = 0.0
    energy_cap: float | None = None
    weight: PerAxis = 0.0
    weight_error: PerAxis = 0.0
    sources: Mapping[str, str] = field(default_factory=dict, hash=False)

    def __post_init__(self) -> None:
        for name, unit in _POSITIVE.items():
            for value in _values(getattr(self, name)):
                if not 0.0 < value < math.inf:
                    raise ConfigError(f"{name} must be > 0 {unit} and finite, got {value} {unit}")
        for name, unit in _NOT_NEGATIVE.items():
            for value in _values(getattr(self, name)):
                if not 0.0 <= value < math.inf:
                    raise ConfigError(f"{name} must be >= 0 {unit} and finite, got {value} {unit}")
        for name in ("gain_error", "watchdog_tolerance"):
            value = getattr(self, name)
            if not 0.0 <= value < 1.0:
                raise ConfigError(f"{name} must be from 0 to below 1, got {value}")
        if not self.largest_speed > 0.0:
            raise ConfigError(f"largest_speed must be > 0 m/s, got {self.largest_speed} m/s")
        if self.energy_cap is not None and not 0.0 < self.energy_cap < math.inf:
            raise ConfigError(f"energy_cap must be > 0 J and finite, got {self.energy_cap} J")
        if not all(math.isfinite(value) for value in _values(self.weight)):
            raise ConfigError(f"weight must be finite, got {self.weight} N")
        self._check_hold()
        self._check_axes()
        for name, source in self.sources.items():
            if source not in SOURCES:
                raise ConfigError(f"source of {name} must be one of {SOURCES}, got {source!r}")

    def _check_hold(self) -> None:
        if self.hold_limit < self.period:
            raise ConfigError(
                f"hold_limit must be at least the period, {self.period} s, or every force is cut; "
                f"got {self.hold_limit} s"
            )
        if self.watchdog not in WATCHDOGS:
            raise ConfigError(f"watchdog must be one of {WATCHDOGS}, got {self.watchdog!r}")
        if self.watchdog == "none" and not self.hold_limit <= self.watchdog_limit < math.inf:
            raise ConfigError(
                "watchdog 'none' needs a watchdog_limit of at least the hold limit, "
                f"{self.hold_limit} s, and finite, got {self.watchdog_limit} s: state after which "
                "time the hardware drops the force at last, or the longest stall that you vouch for"
            )
        if self.watchdog == "guarding":
            self._check_guard()

    def _check_guard(self) -> None:
        if not 0.0 < self.guard_period < self.period:
            raise ConfigError(
                "watchdog 'guarding' needs a guard_period above 0 s and below the period, "
                f"{self.period} s, got {self.guard_period} s"
            )
        if self.lag > 0.0 or self.write_delay > 0.0:
            raise ConfigError(
                f"watchdog 'guarding' with a lag of {self.lag} s and a write_delay of "
                f"{self.write_delay} s: what a late force costs is known only without both; "
                "use watchdog 'reporting'"
            )

    def _check_axes(self) -> None:
        lengths = {len(_values(getattr(self, name))) for name in PER_AXIS} - {1}
        if len(lengths) > 1:
            raise ConfigError(f"numbers of each axis must be equally many, got {sorted(lengths)}")
        if self.friction == 0.0 or isinstance(self.friction, tuple):
            return
        for name in ("damping", "presliding", "weight_error"):
            if isinstance(getattr(self, name), tuple):
                raise ConfigError(
                    f"{name} of each axis needs the friction of each axis too: "
                    "one number means friction along the path"
                )

    @property
    def least_damping(self) -> float:
        """Minimum damping of the worst axis, in N s/m."""
        return min(_values(self.damping))

    @property
    def least_friction(self) -> float:
        """Minimum friction of the worst axis, in N."""
        return min(_values(self.friction))

    @property
    def coarsest_resolution(self) -> float:
        """Resolution of the worst axis, in m."""
        return max(_values(self.resolution))

    def of_axes(self, name: str, axes: int) -> tuple[float, ...]:
        """Return the numbers of one of :data:`PER_AXIS` for each of ``axes``.

        Raises:
            ConfigError: If there are as many numbers, but not ``axes``.
        """
        values = _values(getattr(self, name))
        if len(values) == 1:
            return values * axes
        if len(values) != axes:
            raise ConfigError(f"{name} has {len(values)} numbers for {axes} axes")
        return values


_POSITIVE = {"damping": "N s/m", "period": "s", "hold_limit": "s", "saturation": "N"}
_NOT_NEGATIVE = {
    "friction": "N",
    "resolution": "m",
    "presliding": "m",
    "lag": "s",
    "write_delay": "s",
    "guard_period": "s",
    "allowance": "J",
    "weight_error": "N",
}

#: Numbers that may differ between axes.
PER_AXIS = ("damping", "friction", "resolution", "presliding", "weight", "weight_error")


def _values(value: PerAxis) -> tuple[float, ...]:
    return value if isinstance(value, tuple) else (value,)
