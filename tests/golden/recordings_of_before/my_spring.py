from dataclasses import dataclass
from typing import Annotated

from forcebound.haptics.environments import StatelessEnvironment
from forcebound.messages.packets import Vector
from forcebound.quantities import NOT_NEGATIVE, Length, Stiffness


@dataclass(frozen=True)
class MySpring(StatelessEnvironment):
    stiffness: Annotated[Stiffness, NOT_NEGATIVE] = 500.0
    rest: Length = 0.0

    def force(self, user: str, position: Vector, velocity: Vector, elapsed: float) -> Vector:
        return (self.stiffness * (position[0] - self.rest), *[0.0] * (len(position) - 1))
