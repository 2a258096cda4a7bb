"""An elastic wall."""

from dataclasses import dataclass
from typing import Annotated

from forcebound.environments import StatelessEnvironment
from forcebound.messages.packets import Vector
from forcebound.quantities import NOT_NEGATIVE, Length, Stiffness, check_ranges


def wall_force(position: float, stiffness: float, surface: float) -> float:
    """Return the force of an elastic wall, in N: ``k (x - x_w)`` behind the surface, else 0.

    Source: paper section 4.1, Eq. 32, first line.
    """
    return stiffness * max(position - surface, 0.0)


def on_first_axis(force: float, axes: int) -> Vector:
    """Return ``force`` along the first axis and zero along the others."""
    return (force,) if axes == 1 else (force,) + (0.0,) * (axes - 1)


@dataclass(frozen=True)
class Wall(StatelessEnvironment):
    """A flat elastic wall across the first axis; free motion before it."""

    stiffness: Annotated[Stiffness, NOT_NEGATIVE] = 10_000.0  # paper 4.2: k = 10 N/mm
    position: Length = 0.010  # of the surface; paper 4.1: x_wall = 10 mm

    def __post_init__(self) -> None:
        check_ranges(self)

    def force(self, user: str, position: Vector, velocity: Vector, elapsed: float) -> Vector:
        """Return the wall's force; see :class:`forcebound.environments.Environment`."""
        return on_first_axis(wall_force(position[0], self.stiffness, self.position), len(position))
