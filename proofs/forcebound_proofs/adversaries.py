"""Environments that give energy to the hand, for audits: forces against it, worlds gone wrong.

Worlds fail as such worlds do fail: a god-object that jumps, a mesh with holes, a body whose
integration explodes. Their fields are drawn as those of all worlds.
"""

import math
from dataclasses import dataclass
from typing import Annotated, TypeAlias

from forcebound.haptics.environments import Environment, EnvironmentModel, StatelessEnvironment
from forcebound.lab.one_axis import pushing_force
from forcebound.messages.packets import Contact, Vector
from forcebound.quantities import (
    POSITIVE,
    PROBABILITY,
    Force,
    Length,
    Mass,
    Range,
    Ratio,
    Speed,
    Stiffness,
    Time,
)

Seed: TypeAlias = Annotated[Ratio, Range(at_least=1, at_most=1000)]  # its whole part

LONGEST = 0.1  # s, of a step of the exploding body
NEAREST = 1e-12  # m; a proxy that is nearer to the hand has no direction


def uniform(seed: float, step: int, axis: int) -> float:
    """Return a number in [0, 1) that looks random and depends on its arguments alone.

    The finaliser of SplitMix64: G. Steele, D. Lea, C. Flood, "Fast splittable pseudorandom number
    generators", OOPSLA 2014. A generator object would make the force depend on the number of
    queries, and so on the network.
    """
    mask = (1 << 64) - 1
    z = (
        int(seed) * 0x9E3779B97F4A7C15 + step * 0xD1342543DE82EF95 + axis * 0xA0761D6478BD642F
    ) & mask
    z = ((z ^ (z >> 30)) * 0xBF58476D1CE4E5B9) & mask
    z = ((z ^ (z >> 27)) * 0x94D049BB133111EB) & mask
    return ((z ^ (z >> 31)) >> 11) / (1 << 53)


@dataclass(frozen=True)
class VelocityPusher(StatelessEnvironment):
    """A force of constant magnitude, N, along the direction of motion: the greediest giver."""

    magnitude: Annotated[Force, POSITIVE] = 10.0
    threshold: Annotated[Speed, POSITIVE] = 0.001  # below it the direction is not known

    def force(self, user: str, position: Vector, velocity: Vector, elapsed: float) -> Vector:
        """Return the pushing force; see :class:`forcebound.haptics.environments.Environment`."""
        return tuple(pushing_force(v, self.magnitude, self.threshold) for v in velocity)


@dataclass(frozen=True)
class RandomForce(StatelessEnvironment):
    """A force that jumps to a new random value every ``interval``, whatever the position."""

    magnitude: Annotated[Force, POSITIVE] = 10.0
    interval: Annotated[Time, POSITIVE] = 0.01
    seed: Seed = 1.0

    def force(self, user: str, position: Vector, velocity: Vector, elapsed: float) -> Vector:
        """Return the random force; see :class:`forcebound.haptics.environments.Environment`."""
        step = int(elapsed / self.interval)
        sides = (2.0 * uniform(self.seed, step, axis) - 1.0 for axis in range(len(position)))
        return tuple(self.magnitude * side for side in sides)


@dataclass(frozen=True)
class _Touched(EnvironmentModel):
    """A spring to a proxy."""

    stiffness: Annotated[Stiffness, POSITIVE] = 1000.0

    def open(self, axes: int) -> Environment:
        """Return a new instance; see :class:`forcebound.haptics.environments.EnvironmentModel`."""
        return _Touching(self)

    def proxy(self, position: Vector, elapsed: float) -> Vector | None:
        """Return the place of the proxy, in m; None: free motion."""
        raise NotImplementedError


class _Touching(Environment):
    def __init__(self, model: _Touched) -> None:
        self._model = model
        self._contact: Contact | None = None

    def contact(self, user: str) -> Contact | None:
        return self._contact

    def proxy(self, position: Vector, elapsed: float) -> Vector | None:
        return self._model.proxy(position, elapsed)

    def force(self, user: str, position: Vector, velocity: Vector, elapsed: float) -> Vector:
        self._contact, proxy = None, self.proxy(position, elapsed)
        if proxy is None:
            return (0.0,) * len(position)
        way = [p - x for p, x in zip(proxy, position, strict=True)]
        length = math.hypot(*way)
        if NEAREST < length < math.inf:
            self._contact = Contact(proxy, tuple([one / length for one in way]))
        return tuple([-self._model.stiffness * one for one in way])


@dataclass(frozen=True)
class JumpingProxy(_Touched):
    """A wall whose proxy jumps by up to ``reach`` on each axis every ``interval``."""

    position: Length = 0.010  # of the surface
    reach: Annotated[Length, POSITIVE] = 0.005
    interval: Annotated[Time, POSITIVE] = 0.01
    seed: Seed = 1.0

    def proxy(self, position: Vector, elapsed: float) -> Vector:
        """Return the place of the proxy, in m."""
        step, should = (
            int(elapsed / self.interval),
            (min(position[0], self.position), *position[1:]),
        )
        jumps = (2.0 * uniform(self.seed, step, axis) - 1.0 for axis in range(len(position)))
        return tuple([p + self.reach * jump for p, jump in zip(should, jumps, strict=True)])


@dataclass(frozen=True)
class HoledWall(_Touched):
    """A wall of square tiles with an edge of ``tile``, a share of which is missing.

    Through a hole the hand gets behind the wall without a force; beside the hole the wall then
    pushes it out from the depth where it is. So does a mesh that is not closed.
    """

    position: Length = 0.010  # of the surface
    tile: Annotated[Length, POSITIVE] = 0.001
    holes: Annotated[Ratio, PROBABILITY] = 0.5
    seed: Seed = 1.0

    def proxy(self, position: Vector, elapsed: float) -> Vector | None:
        """Return the place of the proxy, in m; None: free motion."""
        row, column = (*(math.floor(x / self.tile) for x in position[1:3]), 0, 0)[:2]
        is_free = position[0] <= self.position or uniform(self.seed, row, column) < self.holes
        return None if is_free else (self.position, *position[1:])


@dataclass(frozen=True)
class ExplodingBody(_Touched):
    """A body of ``mass`` on a spring, integrated with steps that are too long: it swings up.

    Once it is farther than ``reach`` from the hand it is put back there, at rest, as by an engine
    that resets what has exploded.
    """

    mass: Annotated[Mass, POSITIVE] = 0.1
    reach: Annotated[Length, POSITIVE] = 0.05

    def open(self, axes: int) -> Environment:
        """Return a new instance; see :class:`forcebound.haptics.environments.EnvironmentModel`."""
        return _Exploding(self, axes)


class _Exploding(_Touching):
    def __init__(self, model: ExplodingBody, axes: int) -> None:
        super().__init__(model)
        self._body = model
        self._place: Vector | None = None
        self._velocity = self._rest = (0.0,) * axes
        self._elapsed = 0.0

    def proxy(self, position: Vector, elapsed: float) -> Vector:
        h = min(max(elapsed - self._elapsed, 0.0), LONGEST)
        self._elapsed = elapsed
        place = position if self._place is None else self._place
        pulls = zip(self._velocity, position, place, strict=True)
        gain = h * self._body.stiffness / self._body.mass
        # The explicit Euler rule: each step adds energy, however short it is.
        place = tuple([q + h * v for q, v in zip(place, self._velocity, strict=True)])
        self._velocity = tuple([v + gain * (x - q) for v, x, q in pulls])
        if not math.dist(place, position) < self._body.reach:
            place, self._velocity = position, self._rest
        self._place = place
        return place


ADVERSARIES: dict[str, type[EnvironmentModel]] = {
    "exploding_body": ExplodingBody,
    "holed_wall": HoledWall,
    "jumping_proxy": JumpingProxy,
    "random_force": RandomForce,
    "velocity_pusher": VelocityPusher,
}
