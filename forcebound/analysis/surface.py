"""Surface of a run's environment, and how deep the readings lie behind it."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from forcebound.errors import ConfigError
from forcebound.telemetry import TelemetryColumns

Floats: TypeAlias = NDArray[np.float64]


@dataclass(frozen=True)
class Surface:
    """Surface of the environment of a run."""

    position: float  # m
    axis: int
    stiffness: float | None  # N/m; None where the environment has no constant one


def surface(config: Mapping[str, Any]) -> Surface | None:
    """Return the surface that the launch file describes; None for an environment without one.

    In a user's own environment (``kind: my_file.py``) a parameter of these names may mean
    something else, such as a centre: a value that is not a number is ignored there.

    Args:
        config: The launch file as resolved for the run; reads ``environment``.

    Raises:
        ConfigError: If position, stiffness or axis are not plain SI numbers.
    """
    environment = config.get("environment") or {}
    if ".py" in str(environment.get("kind")):
        environment = {k: v for k, v in environment.items() if isinstance(v, int | float)}
    position = _number(environment, "position", "m")
    if position is None:
        return None
    axis = _number(environment, "axis", "a whole number") or 0
    return Surface(position, int(axis), _number(environment, "stiffness", "N/m"))


def _number(environment: Mapping[str, Any], key: str, unit: str) -> float | None:
    value = environment.get(key)
    if value is not None and not isinstance(value, int | float):
        raise ConfigError(f"environment.{key} must be a number ({unit}), got {value!r}")
    return value


def penetration(columns: TelemetryColumns, wall: Surface) -> Floats:
    """Return the depth of the reading behind the surface, in m, shape ``(n,)``; outside: < 0.

    Raises:
        ConfigError: If the run has no such axis.
    """
    axes = columns.position.shape[1]
    if not 0 <= wall.axis < axes:
        raise ConfigError(f"environment.axis is {wall.axis}, but the run has {axes} axes, from 0")
    return columns.position[:, wall.axis] - wall.position
