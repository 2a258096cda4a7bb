"""Places of a hand: on the first axis alone, or in space, and straight ways between them."""

import math
from itertools import zip_longest
from typing import Any, TypeAlias

from forcebound.errors import ConfigError
from forcebound.messages.packets import MAX_AXES, Vector
from forcebound.quantities import Length

# One number: on the first axis, 0 m on the others. Or a list of one for each axis.
Place: TypeAlias = Length | tuple[Length, ...]


def coordinates(place: Place) -> Vector:
    """Return a place as a vector, in m; its axes beyond the last are at 0."""
    return place if isinstance(place, tuple) else (place,)


def check_places(hand: Any, *names: str) -> None:
    """Check, in ``__post_init__`` of a hand, how many numbers its places have.

    Raises:
        ConfigError: If one has none, or more than there can be axes; names the field.
    """
    for name in names:
        count = len(coordinates(getattr(hand, name)))
        if not 1 <= count <= MAX_AXES:
            wanted = f"{name} must be one number, or 1 to {MAX_AXES} (one per axis)"
            raise ConfigError(f"{wanted}, got {count}", field=name)


def both(one: Vector, other: Vector) -> list[tuple[float, float]]:
    """Return the coordinates of two vectors side by side; 0 where only one of them has any."""
    return list(zip_longest(one, other, fillvalue=0.0))


def distance(one: Vector, other: Vector) -> float:
    """Return how far two places are apart, in m."""
    return math.hypot(*[b - a for a, b in both(one, other)])


def straight(elapsed: float, start: Vector, end: Vector, speed: float) -> Vector:
    """Return the place, in m, of a point that moves straight from ``start`` and stays at ``end``.

    Args:
        elapsed: Since it left, in s.
        start: In m.
        end: In m.
        speed: In m/s, > 0.
    """
    way, travel = distance(start, end), speed * elapsed
    if travel >= way:
        return tuple([b for _, b in both(start, end)])
    return tuple([a + travel * ((b - a) / way) for a, b in both(start, end)])


def shifted(place: Vector, shift: Vector) -> Vector:
    """Return a place, in m, moved by ``shift``."""
    return tuple([a + b for a, b in both(place, shift)])
