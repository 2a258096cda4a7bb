"""Environments that give energy to the hand, for audits: forces against it, worlds gone wrong.

Their surfaces lie at 0 m on the first axis. Worlds fail as such worlds do fail: a god-object that
jumps, a mesh with holes, a body whose integration explodes.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

from forcebound.haptics.environments import Environment, EnvironmentModel, StatelessEnvironment
from forcebound.lab.one_axis import pushing_force
from forcebound.messages.packets import Contact, Vector

LONGEST = 0.1  # s, of a step of the exploding body
NEAREST = 1e-12  # m; a proxy that is nearer to the hand has no direction


def uniform(seed: int, step: int, axis: int) -> float:
    """Return a number in [0, 1) that looks random and depends on its arguments alone.

    The finaliser of SplitMix64: G. Steele, D. Lea, C. Flood, "Fast splittable pseudorandom number
    generators", OOPSLA 2014. A generator object would make the force depend on the number of
    queries, and so on the network.
    """
    mask = (1 << 64) - 1
    z = (seed * 0x9E3779B97F4A7C15 + step * 0xD1342543DE82EF95 + axis * 0xA0761D6478BD642F) & mask
    z = ((z ^ (z >> 30)) * 0xBF58476D1CE4E5B9) & mask
    z = ((z ^ (z >> 27)) * 0x94D049BB133111EB) & mask
    return ((z ^ (z >> 31)) >> 11) / (1 << 53)


@dataclass(frozen=True)
class VelocityPusher(StatelessEnvironment):
    """A force of constant magnitude, N, along the direction of motion: the greediest giver."""

    magnitude: float
    threshold: float = 0.001  # m/s; below it the direction is not known

    def force(self, user: str, position: Vector, velocity: Vector, elapsed: float) -> Vector:
        """Return the pushing force; see :class:`forcebound.haptics.environments.Environment`."""
        return tuple(pushing_force(v, self.magnitude, self.threshold) for v in velocity)


@dataclass(frozen=True)
class RandomForce(StatelessEnvironment):
    """A force, N, that jumps to a new random value every ``interval``, s, whatever the position."""

    magnitude: float
    interval: float
    seed: int

    def force(self, user: str, position: Vector, velocity: Vector, elapsed: float) -> Vector:
        """Return the random force; see :class:`forcebound.haptics.environments.Environment`."""
        step = int(elapsed / self.interval)
        sides = (2.0 * uniform(self.seed, step, axis) - 1.0 for axis in range(len(position)))
        return tuple(self.magnitude * side for side in sides)


@dataclass(frozen=True)
class Adversary(EnvironmentModel):
    """A world with a proxy, made for a number of axes."""

    make: Callable[[int], "Touching"]

    def open(self, axes: int) -> Environment:
        """Return a new instance; see :class:`forcebound.haptics.environments.EnvironmentModel`."""
        return self.make(axes)


class Touching(Environment):
    """A spring of ``stiffness``, N/m, to a proxy."""

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


class JumpingProxy(Touching):
    """A wall whose proxy jumps by up to ``reach``, m, on each axis every ``interval``, s."""

    def __init__(self, stiffness: float, reach: float, interval: float, seed: int) -> None:
        super().__init__(stiffness)
        self._reach, self._interval, self._seed = reach, interval, seed

    def force(self, user: str, position: Vector, velocity: Vector, elapsed: float) -> Vector:
        """Return the spring's force; see :class:`forcebound.haptics.environments.Environment`."""
        step = int(elapsed / self._interval)
        should = enumerate((min(position[0], 0.0), *position[1:]))
        jumps = [p + self._reach * (2.0 * uniform(self._seed, step, a) - 1.0) for a, p in should]
        return self._pull(position, tuple(jumps))


class HoledWall(Touching):
    """A wall of square tiles with an edge of ``tile``, m, a share of which is missing.

    Through a hole the hand gets behind the wall without a force; beside the hole the wall then
    pushes it out from the depth where it is. So does a mesh that is not closed.
    """

    def __init__(self, stiffness: float, tile: float, holes: float, seed: int) -> None:
        super().__init__(stiffness)
        self._tile, self._holes, self._seed = tile, holes, seed

    def force(self, user: str, position: Vector, velocity: Vector, elapsed: float) -> Vector:
        """Return the wall's force; see :class:`forcebound.haptics.environments.Environment`."""
        row, column = (*(math.floor(x / self._tile) for x in position[1:3]), 0, 0)[:2]
        is_hole = uniform(self._seed, row, column) < self._holes
        is_free = position[0] <= 0.0 or is_hole
        return self._pull(position, None if is_free else (0.0, *position[1:]))


class ExplodingBody(Touching):
    """A body of ``mass``, kg, on a spring, integrated with steps that are too long: it swings up.

    Once it is farther than ``reach``, m, from the hand it is put back there, at rest, as by an
    engine that resets what has exploded.
    """

    def __init__(self, stiffness: float, mass: float, reach: float, axes: int) -> None:
        super().__init__(stiffness)
        self._mass, self._reach = mass, reach
        self._place: Vector | None = None
        self._velocity = self._rest = (0.0,) * axes
        self._elapsed = 0.0

    def force(self, user: str, position: Vector, velocity: Vector, elapsed: float) -> Vector:
        """Return the spring's force; see :class:`forcebound.haptics.environments.Environment`."""
        h = min(max(elapsed - self._elapsed, 0.0), LONGEST)
        self._elapsed = elapsed
        place = position if self._place is None else self._place
        pulls = zip(self._velocity, position, place, strict=True)
        gain = h * self._stiffness / self._mass
        # The explicit Euler rule: each step adds energy, however short it is.
        place = tuple([q + h * v for q, v in zip(place, self._velocity, strict=True)])
        self._velocity = tuple([v + gain * (x - q) for v, x, q in pulls])
        if not math.dist(place, position) < self._reach:
            place, self._velocity = position, self._rest
        self._place = place
        return self._pull(position, place)
