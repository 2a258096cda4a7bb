"""A hand that moves to and fro, as in palpation."""

import math
from dataclasses import dataclass

from forcebound.messages.packets import Vector
from forcebound.quantities import Damping, Frequency, Length, Mass, Stiffness


@dataclass(frozen=True)
class SinusoidalHand:
    """Mass, spring and damper whose target is a sine along the first axis (paper Fig. 19: 2 Hz)."""

    mass: Mass = 0.275
    stiffness: Stiffness = 950.0
    damping: Damping = 2.8
    centre: Length = 0.010
    amplitude: Length = 0.004
    frequency: Frequency = 2.0

    def target(self, elapsed: float) -> Vector:
        """Return the target after ``elapsed`` s; see :class:`forcebound.operators.Operator`."""
        phase = 2.0 * math.pi * self.frequency * elapsed
        return (self.centre - self.amplitude * math.cos(phase),)
