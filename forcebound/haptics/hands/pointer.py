"""A hand whose target somebody moves while the graph runs."""

import math
from dataclasses import dataclass
from typing import Annotated, ClassVar

from forcebound.haptics.hands.hands import Coordinates, SoftGrip, coordinates
from forcebound.messages.packets import Vector
from forcebound.quantities import POSITIVE, Length, Speed, Time


@dataclass(frozen=True)
class PointerHand(SoftGrip):
    """Mass, spring and damper whose target follows a pointer, such as the mouse of a page.

    The target does not jump: it follows the pointer through a first-order low-pass, no faster than
    ``speed``. So whatever the pointer does, the hand is one that a person could have, and the
    account of its energy stays exact. Where nobody points, the target rests.

    Attributes:
        start: Where the target begins: on the first axis, or a list of one for each axis.
        reach: Farthest that it goes from there, on each axis.
        smoothing: Time constant of the low-pass.
        speed: Largest speed of the target.
    """

    places: ClassVar[tuple[str, ...]] = ("start",)

    start: Coordinates = 0.0
    reach: Annotated[Length, POSITIVE] = 0.1
    smoothing: Annotated[Time, POSITIVE] = 0.010
    speed: Annotated[Speed, POSITIVE] = 0.5

    def target(self, elapsed: float) -> Vector:
        return coordinates(self.start)

    def follow(self, axes: int) -> "PointerTarget":
        """Return the target of a hand that is on a device."""
        return PointerTarget(self, axes)


class PointerTarget:
    """The target of a pointer's hand, as it moves."""

    def __init__(self, hand: PointerHand, axes: int) -> None:
        start = coordinates(hand.start)
        self._start: Vector = (start + (0.0,) * axes)[:axes]
        self._hand = hand
        self._pointer = self._target = self._start

    def point(self, place: Vector) -> Vector:
        """Move the pointer; return where it is now, within the reach, in m.

        Entries that ``place`` does not have stay as they are.
        """
        pointed = (*place, *self._pointer[len(place) :])
        reach = self._hand.reach
        self._pointer = tuple(
            [
                min(max(x, middle - reach), middle + reach)
                for x, middle in zip(pointed, self._start, strict=True)
            ]
        )
        return self._pointer

    def advance(self, duration: float) -> Vector:
        """Return the target after ``duration`` s, in m."""
        share = -math.expm1(-duration / self._hand.smoothing)
        step = [share * (p - t) for p, t in zip(self._pointer, self._target, strict=True)]
        length = math.hypot(*step)
        most = self._hand.speed * duration
        scale = most / length if length > most else 1.0
        self._target = tuple([t + scale * w for t, w in zip(self._target, step, strict=True)])
        return self._target
