"""A mass on a spring, which hands push; a box between two of them."""

import math
from dataclasses import dataclass
from typing import Annotated

from forcebound.errors import ConfigError
from forcebound.haptics.environments import (
    Environment,
    EnvironmentModel,
    SharedClock,
    within_reach,
)
from forcebound.haptics.environments.walls import on_first_axis
from forcebound.haptics.parts.signals import Signal
from forcebound.messages.packets import Contact, SceneObject, Vector
from forcebound.quantities import (
    NOT_NEGATIVE,
    POSITIVE,
    Damping,
    Length,
    Mass,
    Range,
    Stiffness,
    check_ranges,
)

STEP, SHORTEST = 1e-4, 1e-6  # s, longest and shortest step of the integration
ANGLE = 0.2  # rad, of the fastest oscillation that a step may be
LONGEST = 0.1  # s: a slab that is not asked for longer stands still
THICKNESS, WIDTH = 0.010, 0.060  # m, as drawn; a thickness that is stated is that of the box


@dataclass(frozen=True)
class MassSpring(EnvironmentModel):
    """A slab on a spring and a damper across the first axis; free motion before it.

    The hand touches its face with an elastic contact and can only push. With the deflection ``q``
    of the slab, the depth ``d = max(x - x_0 - q, 0)`` of the hand in its face and the force
    ``F = max(k_c d + b_c d', 0)`` that the hand feels,

    ``m q'' = F - k q - b q'``.

    All hands push the same slab, each with a separate ``F``. With a ``thickness`` it has a back,
    too, so that two hands can push it from both sides: a box on a floor, if ``spring`` is 0.

    Attributes:
        mass: Of the slab.
        spring: Stiffness between slab and ground.
        damping: Between slab and ground.
        stiffness: Of a contact.
        contact_damping: Of a contact, which does not pull.
        position: Of the face at rest.
        thickness: From the face to the back; null: it has no back.
    """

    signals = (
        Signal("face", "m", "place of the face"),
        Signal("face_velocity", "m/s", "velocity of the slab"),
    )

    mass: Annotated[Mass, Range(at_least=1e-3)] = 0.2
    spring: Annotated[Stiffness, NOT_NEGATIVE] = 200.0
    damping: Annotated[Damping, NOT_NEGATIVE] = 1.0
    stiffness: Annotated[Stiffness, NOT_NEGATIVE] = 2000.0
    contact_damping: Annotated[Damping, NOT_NEGATIVE] = 0.0
    position: Length = 0.010
    thickness: Annotated[Length, POSITIVE] | None = None

    def __post_init__(self) -> None:
        check_ranges(self)
        if (step := self.step()) < SHORTEST:
            raise ConfigError(
                f"mass: {self.mass:g} kg on such springs and dampers needs steps of {step:g} s, and"
                f" the shortest is {SHORTEST:g} s: take a larger mass, or a smaller stiffness",
                field="mass",
            )

    def step(self, hands: int = 1) -> float:
        """Return the longest step of the integration with so many hands at the slab, in s."""
        fastest = math.sqrt((self.spring + hands * self.stiffness) / self.mass)
        damping = self.damping + hands * self.contact_damping
        decay = self.mass / damping if damping > 0.0 else math.inf
        return min(STEP, ANGLE / fastest if fastest > 0.0 else STEP, 0.2 * decay)

    def open(self, axes: int) -> "_Slab":
        return _Slab(self, axes)


@dataclass
class _Hand:
    before: float  # m, on the first axis
    place: Vector  # m, as asked last
    speed: float = 0.0  # m/s, on the first axis
    side: float = 1.0  # 1: at the face; -1: at the back


class _Slab(Environment):
    """An open mass on a spring, integrated by the symplectic Euler rule."""

    def __init__(self, model: MassSpring, axes: int) -> None:
        self._model, self._axes = model, axes
        self._deflection = self._speed = 0.0
        self._hands: dict[str, _Hand] = {}
        self._clock, self._time = SharedClock(), 0.0

    def force(self, user: str, position: Vector, velocity: Vector, elapsed: float) -> Vector:
        x = within_reach(position[0])  # or one absurd reading would throw the slab for ever
        is_new = user not in self._hands
        hand = self._hands.setdefault(user, _Hand(x, (x, *position[1:])))
        hand.before, hand.place = hand.place[0], (x, *position[1:])
        hand.speed = within_reach(velocity[0])
        thickness = self._model.thickness
        if thickness is None:
            hand.side = 1.0
        elif is_new or self._depth(hand, hand.before) <= 0.0:  # it goes out where it came in
            hand.side = 1.0 if hand.before < self._face + 0.5 * thickness else -1.0
        now = self._clock.at(user, elapsed)
        self._advance(min(now - self._time, LONGEST))
        self._time = now
        self.signal("face", self._face)
        self.signal("face_velocity", self._speed)
        return on_first_axis(self._push(hand, x), self._axes)

    @property
    def _face(self) -> float:
        return self._model.position + self._deflection

    def _surface(self, hand: _Hand) -> float:
        return self._face if hand.side > 0.0 else self._face + (self._model.thickness or 0.0)

    def _depth(self, hand: _Hand, x: float) -> float:
        return max(hand.side * (x - self._surface(hand)), 0.0)

    def _push(self, hand: _Hand, x: float) -> float:
        """Return what a hand at ``x``, in m, pushes, in N; negative: back."""
        depth = self._depth(hand, x)
        if depth == 0.0:
            return 0.0
        rate = hand.side * (hand.speed - self._speed)
        model = self._model
        return hand.side * max(model.stiffness * depth + model.contact_damping * rate, 0.0)

    def _advance(self, duration: float) -> None:
        """Move the slab while each hand goes evenly from where it was to where it is."""
        model, hands = self._model, self._hands.values()
        steps = math.ceil(duration / model.step(len(hands)))
        moves = [(hand, hand.place[0] - hand.before) for hand in hands]
        for i in range(steps):
            h = duration / steps
            push = sum([self._push(hand, hand.before + w * (i + 0.5) / steps) for hand, w in moves])
            pull = model.spring * self._deflection + model.damping * self._speed
            self._speed += h * (push - pull) / model.mass
            self._deflection += h * self._speed
        if steps:
            for hand in hands:
                hand.before = hand.place[0]

    def leave(self, user: str) -> None:
        self._hands.pop(user, None)
        self._clock.leave(user)

    def contact(self, user: str) -> Contact | None:
        hand = self._hands.get(user)
        if hand is None or self._depth(hand, hand.place[0]) <= 0.0:
            return None
        place = (self._surface(hand), *hand.place[1:])
        return Contact(place, on_first_axis(-hand.side, self._axes))

    def scene(self) -> tuple[SceneObject, ...]:
        thickness = self._model.thickness
        size = (thickness or THICKNESS, WIDTH, WIDTH)
        centre = (self._face + 0.5 * size[0], 0.0, 0.0)
        slab = SceneObject("slab", "box", position=centre, size=size, is_fixed=False)
        if thickness is None:
            return (slab,)
        return slab, SceneObject("floor", "plane", position=(0.0, 0.0, -0.5 * WIDTH))

    def change(self, model: MassSpring) -> bool:
        self._model = model
        return True
