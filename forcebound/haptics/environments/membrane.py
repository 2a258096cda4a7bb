"""A membrane that a needle stretches until it breaks."""

from dataclasses import dataclass
from typing import Annotated

from forcebound.haptics.environments import Environment, EnvironmentModel
from forcebound.haptics.environments.walls import on_first_axis
from forcebound.haptics.parts.signals import Signal
from forcebound.messages.packets import SceneObject, Vector
from forcebound.quantities import (
    NOT_NEGATIVE,
    POSITIVE,
    Damping,
    Force,
    Length,
    Ranged,
    Stiffness,
)

WIDTH, THICKNESS, GAP = 0.040, 0.001, 0.006  # m, as a display draws the skin; it breaks at the gap


@dataclass(frozen=True)
class Membrane(Ranged, EnvironmentModel):
    """A skin across the first axis, a spring until it breaks, and viscous tissue behind it.

    ``F = k (x - x_0)`` until that is ``strength``; from then on ``F = b v`` behind ``x_0``.
    What the spring held at the break is lost, so the membrane never gives more than it took. Hands
    stretch it at different places, each with the full stiffness; it breaks for all.

    Source: A. M. Okamura, C. Simone, M. D. O'Leary, Force modeling for needle insertion into soft
    tissue, IEEE Transactions on Biomedical Engineering 51(10), 2004: stiffness before the puncture,
    friction and cutting after it; here both are one damping.

    Attributes:
        stiffness: Of the skin.
        strength: Force at which it breaks.
        damping: Of the tissue behind it.
        skin: Position of the skin at rest.
    """

    signals = (Signal("damage", "1", "damage, largest load over strength"),)

    stiffness: Annotated[Stiffness, NOT_NEGATIVE] = 500.0
    strength: Annotated[Force, POSITIVE] = 2.0
    damping: Annotated[Damping, NOT_NEGATIVE] = 5.0
    skin: Length = 0.010

    def open(self, axes: int) -> Environment:
        """Return a skin without damage."""
        return _Skin(self)


class _Skin(Environment):
    def __init__(self, model: Membrane) -> None:
        self._model = model
        self._damage = 0.0  # the skin is broken at 1
        self._stretches: dict[str, float] = {}  # m, by each hand, of a skin that is whole

    def force(self, user: str, position: Vector, velocity: Vector, elapsed: float) -> Vector:
        model, depth = self._model, position[0] - self._model.skin
        stretch = self._stretches[user] = max(depth, 0.0)
        load = model.stiffness * stretch
        if self._damage < 1.0 and load > 0.0:
            self._damage = min(max(self._damage, load / model.strength), 1.0)
            if self._damage == 1.0:
                self.event("skin_broke", f"the skin broke, {1e3 * depth:.2f} mm stretched")
        self.signal("damage", self._damage)
        if self._damage == 1.0:
            load = model.damping * velocity[0] if depth > 0.0 else 0.0
        return on_first_axis(load, len(position))

    def leave(self, user: str) -> None:
        self._stretches.pop(user, None)

    def scene(self) -> tuple[SceneObject, ...]:
        furthest = max(self._stretches.values(), default=0.0)
        gap, stretch = (0.0, furthest) if self._damage < 1.0 else (GAP, 0.0)
        x, y = self._model.skin + stretch + 0.5 * THICKNESS, 0.25 * (WIDTH + gap)
        size = (THICKNESS, 0.5 * (WIDTH - gap), WIDTH)
        halves = {"above": (x, y, 0.0), "below": (x, -y, 0.0)}
        return tuple(SceneObject(n, "box", position=at, size=size) for n, at in halves.items())
