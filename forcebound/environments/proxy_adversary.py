"""Adversaries with a proxy: worlds whose god-object, mesh or engine has gone wrong.

They serve audits (``forcebound.audit``): each fails as such worlds do fail, and gives energy.
"""

import math
from dataclasses import dataclass
from typing import Annotated

from forcebound.environments import Environment, EnvironmentModel
from forcebound.environments.adversary import uniform
from forcebound.messages.packets import Contact, Vector
from forcebound.quantities import (
    NOT_NEGATIVE,
    POSITIVE,
    PROBABILITY,
    Length,
    Mass,
    Ratio,
    Stiffness,
    Time,
    check_ranges,
)

LONGEST = 0.1  # s, of a step of the exploding body
NEAREST = 1e-12  # m; a proxy that is nearer to the hand has no direction


class _Touching(Environment):
    """What the open worlds of this file have in common: a spring to their proxy."""

    def __init__(self, stiffness: float) -> None:
        self._stiffness = stiffness
        self._touched: Contact | None = None

    def contact(self, user: str) -> Contact | None:
        """Return what the last question touched; None: free motion."""
        return self._touched

    def _pull(self, position: Vector, proxy: Vector | None) -> Vector:
        """Return the force of the spring to a proxy; None: free motion."""
        self._touched = None
        if proxy is None:
            return (0.0,) * len(position)
        way = [p - x for p, x in zip(proxy, position, strict=True)]
        length = math.hypot(*way)
        if NEAREST < length < math.inf:
            self._touched = Contact(proxy, tuple([one / length for one in way]))
        return tuple([-self._stiffness * one for one in way])


@dataclass(frozen=True)
class JumpingProxy(EnvironmentModel):
    """A wall across the first axis whose proxy jumps to another place every ``interval``.

    Attributes:
        stiffness: Of the spring to the proxy.
        position: Of the wall.
        reach: Of a jump, along each axis, from the place where the proxy should be.
        interval: Between two jumps.
        seed: Of the jumps, which are a function of time.
    """

    stiffness: Annotated[Stiffness, NOT_NEGATIVE] = 2000.0
    position: Length = 0.010
    reach: Annotated[Length, NOT_NEGATIVE] = 0.005
    interval: Annotated[Time, POSITIVE] = 0.01
    seed: int = 1

    def __post_init__(self) -> None:
        check_ranges(self)

    def open(self, axes: int) -> "_OpenJumpingProxy":
        """Return an instance; see :class:`forcebound.environments.EnvironmentModel`."""
        return _OpenJumpingProxy(self)


class _OpenJumpingProxy(_Touching):
    def __init__(self, model: JumpingProxy) -> None:
        super().__init__(model.stiffness)
        self._model = model

    def force(self, user: str, position: Vector, velocity: Vector, elapsed: float) -> Vector:
        """Return the spring's force; see :class:`forcebound.environments.Environment`."""
        model = self._model
        step = int(elapsed / model.interval)
        should = (min(position[0], model.position), *position[1:])
        proxy = tuple(
            [
                place + model.reach * (2.0 * uniform(model.seed, step, axis) - 1.0)
                for axis, place in enumerate(should)
            ]
        )
        return self._pull(position, proxy)


@dataclass(frozen=True)
class HoledWall(EnvironmentModel):
    """A wall across the first axis, made of square tiles, some of which are missing.

    Through a hole the hand gets behind the wall without a force; beside the hole the wall then
    pushes it out from the depth where it is. So does a mesh that is not closed.

    Attributes:
        stiffness: Of the wall.
        position: Of the wall.
        tile: Edge of a tile.
        holes: Share of the tiles that are missing.
        seed: Decides which.
    """

    stiffness: Annotated[Stiffness, NOT_NEGATIVE] = 10_000.0
    position: Length = 0.010
    tile: Annotated[Length, POSITIVE] = 0.002
    holes: Annotated[Ratio, PROBABILITY] = 0.5
    seed: int = 1

    def __post_init__(self) -> None:
        check_ranges(self)

    def open(self, axes: int) -> "_OpenHoledWall":
        """Return an instance; see :class:`forcebound.environments.EnvironmentModel`."""
        return _OpenHoledWall(self)


class _OpenHoledWall(_Touching):
    def __init__(self, model: HoledWall) -> None:
        super().__init__(model.stiffness)
        self._model = model

    def force(self, user: str, position: Vector, velocity: Vector, elapsed: float) -> Vector:
        """Return the wall's force; see :class:`forcebound.environments.Environment`."""
        model = self._model
        if position[0] <= model.position or self._is_hole(position[1:3]):
            return self._pull(position, None)
        return self._pull(position, (model.position, *position[1:]))

    def _is_hole(self, place: Vector) -> bool:
        row, column = (*(math.floor(x / self._model.tile) for x in place), 0, 0)[:2]
        return uniform(self._model.seed, row, column) < self._model.holes


@dataclass(frozen=True)
class ExplodingBody(EnvironmentModel):
    """A body on a spring to the hand, integrated with steps that are too long: it swings up.

    Once it is farther than ``reach`` from the hand it is put back there, at rest, as by an engine
    that resets what has exploded.

    Attributes:
        stiffness: Of the spring.
        mass: Of the body.
        reach: Distance at which it is put back.
    """

    stiffness: Annotated[Stiffness, NOT_NEGATIVE] = 2000.0
    mass: Annotated[Mass, POSITIVE] = 0.01
    reach: Annotated[Length, POSITIVE] = 0.05

    def __post_init__(self) -> None:
        check_ranges(self)

    def open(self, axes: int) -> "_OpenExplodingBody":
        """Return an instance; see :class:`forcebound.environments.EnvironmentModel`."""
        return _OpenExplodingBody(self, axes)


class _OpenExplodingBody(_Touching):
    def __init__(self, model: ExplodingBody, axes: int) -> None:
        super().__init__(model.stiffness)
        self._model = model
        self._place: Vector | None = None
        self._rest: Vector = (0.0,) * axes
        self._velocity = self._rest
        self._elapsed = 0.0

    def force(self, user: str, position: Vector, velocity: Vector, elapsed: float) -> Vector:
        """Return the spring's force; see :class:`forcebound.environments.Environment`."""
        model, h = self._model, min(max(elapsed - self._elapsed, 0.0), LONGEST)
        self._elapsed = elapsed
        place = position if self._place is None else self._place
        pulls = zip(self._velocity, position, place, strict=True)
        gain = h * model.stiffness / model.mass
        # The explicit Euler rule: each step adds energy, however short it is.
        place = tuple([q + h * v for q, v in zip(place, self._velocity, strict=True)])
        self._velocity = tuple([v + gain * (x - q) for v, x, q in pulls])
        if not math.dist(place, position) < model.reach:
            place, self._velocity = position, self._rest
        self._place = place
        return self._pull(position, place)
