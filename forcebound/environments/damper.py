"""A viscous medium."""

from dataclasses import dataclass

from forcebound.environments import StatelessEnvironment
from forcebound.messages.packets import Vector
from forcebound.quantities import Damping


def damper_force(velocity: float, damping: float) -> float:
    """Return ``b v``, in N."""
    return damping * velocity


@dataclass(frozen=True)
class Damper(StatelessEnvironment):
    """A force ``b v`` along every axis, everywhere."""

    damping: Damping = 5.0

    def force(self, user: str, position: Vector, velocity: Vector, elapsed: float) -> Vector:
        """Return the damper's force; see :class:`forcebound.environments.Environment`."""
        return tuple(damper_force(v, self.damping) for v in velocity)
