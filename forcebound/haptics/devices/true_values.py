"""What a simulated device really has, where that differs from what it states.

Without it, a simulated device is the least favourable one that its statements permit: exactly the
minimum damping and friction, the motor at the upper end of its gain error, the full write delay,
the watchdog as late as it may be. So a law that relies on the statements has no hidden reserve, and
an experiment that asks what a wrong statement costs changes one number here.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any, TypeAlias

from forcebound.errors import ConfigError
from forcebound.haptics.laws.dissipation import (
    DampingOfAxes,
    ForceOfAxes,
    FrictionOfAxes,
    LengthOfAxes,
)
from forcebound.messages.packets import Vector
from forcebound.quantities import (
    NOT_NEGATIVE,
    POSITIVE,
    PROBABILITY,
    Range,
    Ratio,
    Time,
    check_ranges,
)

RatioOfMotors: TypeAlias = (
    Annotated[Ratio, NOT_NEGATIVE] | tuple[Annotated[Ratio, NOT_NEGATIVE], ...]
)


@dataclass(frozen=True, kw_only=True)
class WeakSpot:
    """A part of the workspace with less friction than elsewhere.

    Attributes:
        centre: In the coordinates of the readings: m, or rad of the joints.
        radius: In the same unit.
        share: Of the friction, and of the way over which it yields, that is left there.
    """

    centre: tuple[float, ...]
    radius: Annotated[float, POSITIVE]
    share: Annotated[Ratio, PROBABILITY]

    def __post_init__(self) -> None:
        check_ranges(self)

    def share_at(self, place: Sequence[float]) -> float:
        """Return the share of the friction that is left at a place."""
        return self.share if math.dist(place, self.centre) < self.radius else 1.0


@dataclass(frozen=True, kw_only=True)
class TrueMotor:
    """True values of the motor and its watchdog; null: as stated.

    Attributes:
        gain: The motor gives so many times the commanded force; one number, or one of each motor.
        lag: Time constant of the amplifier, first order.
        write_delay: From a write to the moment when its force acts.
        watchdog: The watchdog drops a force after so many hold limits.
        random: Draw each write delay and each time of the watchdog evenly from what the device
            states: from none to all of the write delay, and within the tolerance.
        seed: Of these draws.
        weak_spot: Less friction in a part of the workspace: its ``centre`` and ``radius``, in m (of
            joints: rad), and the ``share`` of the friction that is left there; null: nowhere.
    """

    gain: RatioOfMotors | None = None
    lag: Annotated[Time, NOT_NEGATIVE] | None = None
    write_delay: Annotated[Time, NOT_NEGATIVE] | None = None
    watchdog: Annotated[Ratio, POSITIVE] | None = None
    random: bool = False
    seed: Annotated[int, Range(at_least=0)] = 1
    weak_spot: WeakSpot | None = None

    def __post_init__(self) -> None:
        check_ranges(self)


@dataclass(frozen=True, kw_only=True)
class TrueAxes(TrueMotor):
    """True values of a device with independent axes; null: as stated.

    Attributes:
        damping: Viscous damping; one for all axes, or one of each, as are the next four.
        friction: Coulomb friction of each axis by itself.
        presliding: Way over which friction yields elastically.
        resolution: Resolution of the encoder.
        weight: Of the tip, positive against positive motion.
    """

    damping: DampingOfAxes | None = None
    friction: FrictionOfAxes | None = None
    presliding: LengthOfAxes | None = None
    resolution: LengthOfAxes | None = None
    weight: ForceOfAxes | None = None


def true_value(model: Any, name: str) -> Any:
    """Return the true value of a number that a model states under ``name``."""
    value = vars(model.truth or TrueMotor()).get(name)
    return getattr(model, name) if value is None else value


def true_axes(model: Any, name: str) -> Vector:
    """Return the true values of a number of each axis."""
    return per_axis(true_value(model, name), model.axes)


def check_counts(model: Any, names: Sequence[str]) -> None:
    """Check that what a model states, and what is true of it, has a number for each axis, or one.

    Raises:
        ConfigError: If not; it names the field.
    """
    true = vars(model.truth or TrueMotor())
    numbers = {name: getattr(model, name) for name in names}
    numbers |= {f"truth: {name}": true.get(name) for name in (*names, "gain")}
    for name, value in numbers.items():
        if isinstance(value, tuple) and len(value) != model.axes:
            axes = model.axes
            message = f"{name} must be one number, or {axes} (one per axis), got {len(value)}"
            raise ConfigError(message, field=name)


def per_axis(value: float | Vector, axes: int) -> Vector:
    """Return a number that is alike on every axis, or one of each, as one of each."""
    return tuple(value) if isinstance(value, tuple) else (value,) * axes
