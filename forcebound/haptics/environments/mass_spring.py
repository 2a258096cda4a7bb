"""A mass on a spring, which the hand pushes."""

import math
from dataclasses import dataclass
from typing import Annotated

from forcebound.haptics.environments import Environment, EnvironmentModel, within_reach
from forcebound.haptics.environments.walls import on_first_axis
from forcebound.messages.packets import Contact, SceneObject, Vector
from forcebound.quantities import (
    NOT_NEGATIVE,
    Damping,
    Length,
    Mass,
    Range,
    Stiffness,
    check_ranges,
)

STEP = 1e-4  # s, longest step of the integration
ANGLE = 0.2  # rad, of the fastest oscillation that a step may be
LONGEST = 0.1  # s: a slab that is not asked for longer stands still
THICKNESS = 0.010  # m, as drawn
WIDTH = 0.060  # m, as drawn


@dataclass(frozen=True)
class MassSpring(EnvironmentModel):
    """A slab on a spring and a damper across the first axis; free motion before it.

    The hand touches its face with an elastic contact and can only push. With the deflection ``q``
    of the slab and the depth ``d = max(x - x_0 - q, 0)`` of the hand in its face,

    ``m q'' = k_c d - k q - b q'``, and the hand feels ``F = k_c d``.

    Attributes:
        mass: Of the slab.
        spring: Stiffness between slab and ground.
        damping: Between slab and ground.
        stiffness: Of the contact.
        position: Of the face at rest.
    """

    mass: Annotated[Mass, Range(at_least=1e-3)] = 0.2
    spring: Annotated[Stiffness, NOT_NEGATIVE] = 200.0
    damping: Annotated[Damping, NOT_NEGATIVE] = 1.0
    stiffness: Annotated[Stiffness, NOT_NEGATIVE] = 2000.0
    position: Length = 0.010

    def __post_init__(self) -> None:
        check_ranges(self)

    @property
    def step(self) -> float:
        """The longest step of the integration, in s."""
        fastest = math.sqrt((self.spring + self.stiffness) / self.mass)
        decay = self.mass / self.damping if self.damping > 0.0 else math.inf
        return min(STEP, ANGLE / fastest if fastest > 0.0 else STEP, 0.2 * decay)

    def open(self, axes: int) -> "_Slab":
        return _Slab(self, axes)


class _Slab(Environment):
    """An open mass on a spring, integrated by the symplectic Euler rule."""

    def __init__(self, model: MassSpring, axes: int) -> None:
        self._model, self._axes = model, axes
        self._deflection = self._speed = self._depth = 0.0
        self._hand: Vector | None = None  # m, as asked last
        self._elapsed = 0.0

    def force(self, user: str, position: Vector, velocity: Vector, elapsed: float) -> Vector:
        hand = within_reach(position[0])  # or one absurd reading would throw the slab for ever
        before = hand if self._hand is None else self._hand[0]
        self._advance(before, hand, min(max(elapsed - self._elapsed, 0.0), LONGEST))
        self._hand, self._elapsed = (hand, *position[1:]), elapsed
        self._depth = max(hand - self._face, 0.0)
        return on_first_axis(self._model.stiffness * self._depth, self._axes)

    @property
    def _face(self) -> float:
        return self._model.position + self._deflection

    def _advance(self, start: float, end: float, duration: float) -> None:
        """Move the slab while the hand goes evenly from ``start`` to ``end``."""
        model = self._model
        steps = math.ceil(duration / model.step)
        for i in range(steps):
            h = duration / steps
            hand = start + (end - start) * (i + 0.5) / steps
            push = model.stiffness * max(hand - self._face, 0.0)
            pull = model.spring * self._deflection + model.damping * self._speed
            self._speed += h * (push - pull) / model.mass
            self._deflection += h * self._speed

    def contact(self, user: str) -> Contact | None:
        if self._hand is None or self._depth <= 0.0:
            return None
        return Contact((self._face, *self._hand[1:]), on_first_axis(-1.0, self._axes))

    def scene(self) -> tuple[SceneObject, ...]:
        centre = (self._face + 0.5 * THICKNESS, 0.0, 0.0)
        size = (THICKNESS, WIDTH, WIDTH)
        return (SceneObject("slab", "box", position=centre, size=size, is_fixed=False),)

    def change(self, model: MassSpring) -> bool:
        self._model = model
        return True
