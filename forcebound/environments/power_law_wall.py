"""A wall whose force grows with a power of the penetration, like soft tissue or a contact."""

import math
from dataclasses import dataclass
from typing import Annotated

from forcebound.environments import StatelessEnvironment
from forcebound.environments.wall import on_first_axis
from forcebound.messages.packets import Vector
from forcebound.quantities import NOT_NEGATIVE, POSITIVE, Length, Ratio, Stiffness, check_ranges


def power_law_force(
    position: float, stiffness: float, exponent: float, reference: float, surface: float
) -> float:
    """Return ``k d_0 (d / d_0)^p`` behind the surface, in N, else 0."""
    depth = max(position - surface, 0.0) / reference
    force: float = stiffness * reference * depth**exponent
    return force


@dataclass(frozen=True)
class PowerLawWall(StatelessEnvironment):
    """A wall ``F = k d_0 (d / d_0)^p`` across the first axis, with d the penetration.

    Written with a reference penetration d_0 so that ``stiffness`` keeps the unit N/m: at d = d_0
    the wall answers as a linear one of that stiffness. Exponent 1.5 is the contact of two spheres
    (H. Hertz, J. reine angew. Math. 92, 1881); 1 is the linear wall.
    """

    stiffness: Annotated[Stiffness, NOT_NEGATIVE] = 10_000.0
    exponent: Annotated[Ratio, POSITIVE] = 1.5
    reference: Annotated[Length, POSITIVE] = 0.001
    position: Length = 0.010

    def __post_init__(self) -> None:
        check_ranges(self)

    def force(self, user: str, position: Vector, velocity: Vector, elapsed: float) -> Vector:
        """Return the wall's force; see :class:`forcebound.environments.Environment`."""
        try:
            force = power_law_force(
                position[0], self.stiffness, self.exponent, self.reference, self.position
            )
        except OverflowError:  # of Python's power, where compiled code gives infinity
            force = math.inf
        return on_first_axis(force, len(position))
