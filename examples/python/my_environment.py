"""An environment of my own: a ball of rubber, fixed in space, that can be felt from all sides.

Copy this file, change it, and check it:

    forcebound check environment my_environment.py stiffness:="2 N/mm"
    forcebound simulate my_environment.yaml

docs/write-your-own-environment.md explains each line.
"""

import math
from dataclasses import dataclass
from typing import Annotated

from forcebound.haptics.environments import StatelessEnvironment
from forcebound.haptics.parts.signals import Signal
from forcebound.messages.packets import Vector
from forcebound.quantities import NOT_NEGATIVE, POSITIVE, Damping, Length, Stiffness


@dataclass(frozen=True)
class Ball(StatelessEnvironment):
    """A ball that pushes outwards, along the line from its centre, and damps motion inside."""

    # Numbers that it publishes, each with name, SI unit and label: recordings, plots and the live
    # page show them.
    signals = (Signal("depth", "m", "depth in the ball"),)

    # The parameters, as a launch file gives them: with a unit, a range, a default, in SI.
    stiffness: Annotated[Stiffness, NOT_NEGATIVE] = 1_000.0  # N/m
    damping: Annotated[Damping, NOT_NEGATIVE] = 1.0  # N s/m
    radius: Annotated[Length, POSITIVE] = 0.010  # m
    centre: Length = 0.020  # m, on the first axis

    def force(self, user: str, position: Vector, velocity: Vector, elapsed: float) -> Vector:
        """Return the force, in N, one entry per axis.

        A force is positive when it *resists* motion in the positive direction.
        """
        # From the centre to the device, and how far the device is inside.
        offset = (position[0] - self.centre, *position[1:])
        distance = math.hypot(*offset)
        depth = self.radius - distance
        self.signal("depth", max(depth, 0.0))
        if depth <= 0.0 or distance == 0.0:  # outside; or at the centre, where all ways lead out
            return (0.0,) * len(position)
        # It pushes the device out, along offset; as a force that resists, that is -offset.
        push = self.stiffness * depth / distance
        return tuple(self.damping * v - push * o for o, v in zip(offset, velocity, strict=True))
