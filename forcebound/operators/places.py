"""Places of a hand: on the first axis alone, or in space, and straight ways between them."""

import math
from itertools import zip_longest
from typing import Any, NamedTuple, TypeAlias

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


class StraightWay(NamedTuple):
    """Straight way from one place to another."""

    start: Vector  # m
    end: Vector  # m, same shape
    direction: Vector  # unit vector; zeros if there is no way to go
    length: float  # m

    def at(self, travel: float) -> Vector:
        """Return the place after ``travel``, in m, from the start on; then the end."""
        if travel >= self.length:
            return self.end
        return tuple([a + travel * u for a, u in zip(self.start, self.direction, strict=True)])


def straight_way(start: Place, end: Place) -> StraightWay:
    """Return the straight way from one place to another."""
    pairs = list(zip_longest(coordinates(start), coordinates(end), fillvalue=0.0))
    length = math.hypot(*[b - a for a, b in pairs])
    direction = tuple([(b - a) / length if length > 0.0 else 0.0 for a, b in pairs])
    return StraightWay(
        tuple([a for a, _ in pairs]), tuple([b for _, b in pairs]), direction, length
    )


def shifted(place: Vector, shift: Vector) -> Vector:
    """Return a place, in m, moved by ``shift``."""
    return tuple([a + b for a, b in zip_longest(place, shift, fillvalue=0.0)])
