"""A wall that gives energy to the hand: what a launch file may use to see what a law survives."""

from dataclasses import dataclass

from forcebound.haptics.environments import StatelessEnvironment
from forcebound.haptics.environments.walls import on_first_axis
from forcebound.messages.packets import Vector
from forcebound.quantities import Damping, Length, Stiffness


def active_wall_force(
    position: float, velocity: float, stiffness: float, damping: float, surface: float
) -> float:
    """Return ``k d + b v`` behind the surface, in N, else 0; with negative b it may pull."""
    depth = max(position - surface, 0.0)
    return stiffness * depth + damping * velocity if depth > 0.0 else 0.0


@dataclass(frozen=True)
class ActiveWall(StatelessEnvironment):
    """A stiff wall that pushes harder on the way out than on the way in (negative damping)."""

    stiffness: Stiffness = 10_000.0
    damping: Damping = -20.0
    position: Length = 0.010

    def force(self, user: str, position: Vector, velocity: Vector, elapsed: float) -> Vector:
        """Return the wall's force; see :class:`forcebound.haptics.environments.Environment`."""
        force = active_wall_force(
            position[0], velocity[0], self.stiffness, self.damping, self.position
        )
        return on_first_axis(force, len(position))
