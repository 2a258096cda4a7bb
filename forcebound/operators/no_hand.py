"""The operator of a device that nobody holds."""

from dataclasses import dataclass

from forcebound.messages.packets import Vector
from forcebound.operators import Operator


@dataclass(frozen=True)
class NoHand(Operator):
    """No mass, no spring, no damper: only motor and friction move the device, from 0 m on."""

    mass: float = 0.0
    stiffness: float = 0.0
    damping: float = 0.0

    def target(self, elapsed: float) -> Vector:
        """Return where the device begins; see :class:`forcebound.operators.Operator`."""
        return (0.0,)
