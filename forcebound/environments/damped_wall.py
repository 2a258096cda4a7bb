"""A wall of spring and damper, as Z-width measurements use it."""

from dataclasses import dataclass
from typing import Annotated

from forcebound.environments import StatelessEnvironment
from forcebound.environments.wall import on_first_axis
from forcebound.messages.packets import Vector
from forcebound.quantities import NOT_NEGATIVE, Damping, Length, Stiffness, check_ranges


def damped_wall_force(
    position: float, velocity: float, stiffness: float, damping: float, surface: float
) -> float:
    """Return ``max(k d + b v, 0)`` behind the surface, in N, else 0: the wall does not pull."""
    depth = position - surface
    return max(stiffness * depth + damping * velocity, 0.0) if depth > 0.0 else 0.0


@dataclass(frozen=True)
class DampedWall(StatelessEnvironment):
    """A flat wall of spring and damper across the first axis, the standard test of a Z-width.

    The velocity is the device's own estimate, a filtered backward difference of its readings.

    Source: J. E. Colgate and J. M. Brown, Factors affecting the Z-width of a haptic display, IEEE
    International Conference on Robotics and Automation, 1994.
    """

    stiffness: Annotated[Stiffness, NOT_NEGATIVE] = 10_000.0
    damping: Damping = 0.0
    position: Length = 0.010

    def __post_init__(self) -> None:
        check_ranges(self)

    def force(self, user: str, position: Vector, velocity: Vector, elapsed: float) -> Vector:
        """Return the wall's force; see :class:`forcebound.environments.Environment`."""
        force = damped_wall_force(
            position[0], velocity[0], self.stiffness, self.damping, self.position
        )
        return on_first_axis(force, len(position))
