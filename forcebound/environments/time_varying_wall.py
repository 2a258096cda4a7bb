"""A wall that grows stiffer with time."""

from dataclasses import dataclass
from typing import Annotated

from forcebound.environments import StatelessEnvironment
from forcebound.environments.wall import on_first_axis, wall_force
from forcebound.messages.packets import Vector
from forcebound.quantities import NOT_NEGATIVE, Length, Stiffness, StiffnessRate


def time_varying_force(
    position: float, elapsed: float, stiffness: float, stiffness_rate: float, surface: float
) -> float:
    """Return the force of a wall of stiffness ``k_1 + k_2 t``, in N."""
    return wall_force(position, stiffness + stiffness_rate * elapsed, surface)


@dataclass(frozen=True)
class TimeVaryingWall(StatelessEnvironment):
    """A wall of stiffness ``k_1 + k_2 t`` across the first axis (paper Eq. 32, second line)."""

    stiffness: Annotated[Stiffness, NOT_NEGATIVE] = 300.0  # k_1; paper 4.2: 0.3 N/mm
    stiffness_rate: StiffnessRate = 60.0  # k_2; paper 4.2: 0.06 N/mm per s
    position: Length = 0.010

    def force(self, user: str, position: Vector, velocity: Vector, elapsed: float) -> Vector:
        """Return the wall's force; see :class:`forcebound.environments.Environment`."""
        force = time_varying_force(
            position[0], elapsed, self.stiffness, self.stiffness_rate, self.position
        )
        return on_first_axis(force, len(position))
