"""Axes of a device: what graph, environment, coupling and results see, and the units of each.

An axis is a length, in m and N, or an angle, in rad and N m. A device that names none has lengths.
Whatever shows a number of an axis asks here for its unit; so does the reader of launch files: a
type that says ``N/m`` stands for N m/rad where the axis is an angle.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal, TypeAlias, TypeVar

from forcebound.errors import ConfigError
from forcebound.units import N_M, N_M_RAD, RAD, RAD_S, Everyday

T = TypeVar("T")
#: A number for every axis alike, or one for each axis.
OfAxes: TypeAlias = T | tuple[T, ...]
PerAxis: TypeAlias = OfAxes[float]
AxisKind: TypeAlias = Literal["length", "angle"]

#: m; what a hand, a threshold or a default is for lengths, it is for angles at this lever.
LEVER = 0.1

NAMES = ("x", "y", "z", "axis 4", "axis 5", "axis 6", "axis 7", "axis 8")
# SI unit of a length, that of the angle in its place, and the power of the lever between them.
_TURNED = (
    ("m", "rad", -1),
    ("m/s", "rad/s", -1),
    ("m/s^2", "rad/s^2", -1),
    ("N", "N m", 1),
    ("N/m", "N m/rad", 2),
    ("N s/m", "N m s", 2),
    ("N/m/s", "N m/rad/s", 2),
    ("kg", "kg m^2", 2),
)
_ON = {(linear, "angle"): (turned, power) for linear, turned, power in _TURNED} | {
    (turned, "length"): (linear, -power) for linear, turned, power in _TURNED
}
_SHOWN = {"m": RAD, "m/s": RAD_S, "N": N_M, "N/m": N_M_RAD}


@dataclass(frozen=True)
class Axis:
    """One axis of a device.

    Attributes:
        name: Such as x or elbow; no other axis of the device has it.
        kind: length (m, N) or angle (rad, N m).
    """

    name: str
    kind: AxisKind = "length"

    def unit(self, symbol: str) -> str:
        """Return the SI unit on this axis of what has the unit ``symbol`` on a length or angle."""
        return _ON.get((symbol, self.kind), (symbol, 0))[0]


def lengths(count: int) -> tuple[Axis, ...]:
    """Return so many axes of a device that names none: x, y, z, axis 4."""
    return tuple(map(Axis, NAMES[:count]))


def common_kind(axes: Iterable[Axis]) -> AxisKind | None:
    """Return the kind that all axes have; None if they differ. Without axes: length."""
    kinds: list[AxisKind] = list(dict.fromkeys(axis.kind for axis in axes)) or ["length"]
    return kinds[0] if len(kinds) == 1 else None


def units_on(axes: Iterable[Axis], symbol: str) -> str:
    """Return the units on these axes of what has the unit ``symbol`` on a length: rad, or m or rad.

    Without axes: that unit.
    """
    return " or ".join(dict.fromkeys(axis.unit(symbol) for axis in axes)) or symbol


def at_lever(value: float, symbol: str, kind: AxisKind) -> float:
    """Return on an axis of a kind what is ``value``, in ``symbol``, on the other at ``LEVER``."""
    return value * LEVER ** _ON.get((symbol, kind), (symbol, 0))[1]


def shown_on(kind: AxisKind | None, unit: Everyday) -> Everyday:
    """Return the unit in which people read on an axis of a kind what ``unit`` is for lengths."""
    return _SHOWN.get(unit.si, unit) if kind == "angle" else unit


def per_axis(name: str, value: PerAxis, axes: int) -> tuple[float, ...]:
    """Return a number that is alike on every axis, or one of each, as one of each.

    Raises:
        ConfigError: If there are others; it names the field.
    """
    numbers = entries(value)
    if len(numbers) not in (1, axes):
        message = f"{name} must be one number, or {axes} (one per axis), got {len(numbers)}"
        raise ConfigError(message, field=name)
    return numbers if len(numbers) == axes else numbers * axes


def entries(value: PerAxis) -> tuple[float, ...]:
    """Return the numbers of each axis; of all alike the one."""
    return value if isinstance(value, tuple) else (value,)
