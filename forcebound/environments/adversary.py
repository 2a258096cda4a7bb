"""Adversaries: environments that give energy to the hand.

They serve audits (``forcebound.audit``) and demonstrations of the bounder.
"""

from dataclasses import dataclass
from typing import Annotated

from forcebound.environments import StatelessEnvironment
from forcebound.environments.walls import damper_force, on_first_axis
from forcebound.messages.packets import Vector
from forcebound.quantities import (
    POSITIVE,
    Damping,
    Force,
    Length,
    Speed,
    Stiffness,
    Time,
    check_ranges,
)


def active_wall_force(
    position: float, velocity: float, stiffness: float, damping: float, surface: float
) -> float:
    """Return ``k d + b v`` behind the surface, in N, else 0; with negative b it may pull."""
    depth = max(position - surface, 0.0)
    return stiffness * depth + damping * velocity if depth > 0.0 else 0.0


def pushing_force(velocity: float, magnitude: float, threshold: float) -> float:
    """Return a force of ``magnitude``, in N, that pushes along a ``velocity`` above a threshold."""
    if abs(velocity) <= threshold:
        return 0.0
    return -magnitude if velocity > 0.0 else magnitude


@dataclass(frozen=True)
class ActiveWall(StatelessEnvironment):
    """A stiff wall that pushes harder on the way out than on the way in (negative damping)."""

    stiffness: Stiffness = 10_000.0
    damping: Damping = -20.0
    position: Length = 0.010

    def force(self, user: str, position: Vector, velocity: Vector, elapsed: float) -> Vector:
        """Return the wall's force; see :class:`forcebound.environments.Environment`."""
        force = active_wall_force(
            position[0], velocity[0], self.stiffness, self.damping, self.position
        )
        return on_first_axis(force, len(position))


@dataclass(frozen=True)
class NegativeDamper(StatelessEnvironment):
    """A medium that pushes along with every motion, ``b v`` with negative b."""

    damping: Damping = -5.0

    def force(self, user: str, position: Vector, velocity: Vector, elapsed: float) -> Vector:
        """Return the medium's force; see :class:`forcebound.environments.Environment`."""
        return tuple(damper_force(v, self.damping) for v in velocity)


@dataclass(frozen=True)
class VelocityPusher(StatelessEnvironment):
    """A force of constant magnitude along the direction of motion: the greediest giver."""

    magnitude: Force = 8.5
    threshold: Speed = 0.001  # below it the direction is not known

    def force(self, user: str, position: Vector, velocity: Vector, elapsed: float) -> Vector:
        """Return the pushing force; see :class:`forcebound.environments.Environment`."""
        return tuple(pushing_force(v, self.magnitude, self.threshold) for v in velocity)


@dataclass(frozen=True)
class RandomForce(StatelessEnvironment):
    """A force that jumps to a new random value every ``interval``, whatever the position.

    The value is a function of time and seed alone, so a run can be repeated.
    """

    magnitude: Force = 8.5
    interval: Annotated[Time, POSITIVE] = 0.005
    seed: int = 1

    def __post_init__(self) -> None:
        check_ranges(self)

    def force(self, user: str, position: Vector, velocity: Vector, elapsed: float) -> Vector:
        """Return the random force; see :class:`forcebound.environments.Environment`."""
        step = int(elapsed / self.interval)
        return tuple(
            self.magnitude * (2.0 * uniform(self.seed, step, axis) - 1.0)
            for axis in range(len(position))
        )


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
