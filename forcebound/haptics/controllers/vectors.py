"""Vectors of as many numbers as the device has axes."""

from forcebound.messages.packets import Vector


def dot(a: Vector, b: Vector) -> float:
    """Return the scalar product."""
    return sum([x * y for x, y in zip(a, b, strict=True)])


def along(a: Vector, direction: Vector, distance: float) -> Vector:
    """Return ``a + distance direction``."""
    return tuple([x + distance * d for x, d in zip(a, direction, strict=True)])


def across(a: Vector, direction: Vector) -> Vector:
    """Return the part of ``a`` at right angles to a unit vector."""
    return along(a, direction, -dot(a, direction))
