"""Numbers of axes: one for all alike, or one for each."""

from typing import Any

from forcebound.errors import ConfigError
from forcebound.messages.packets import Vector


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
