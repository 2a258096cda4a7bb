"""An environment of my own: a ball of rubber, fixed in space, that can be felt from all sides.

Copy this file, change it, and check it:

    forcebound check environment my_environment.py stiffness:="2 N/mm"
    forcebound simulate my_environment.yaml

docs/write-your-own-environment.md explains each line.
"""

import math
from dataclasses import dataclass
from typing import Annotated

from forcebound.haptics.environments import Environment, EnvironmentModel
from forcebound.haptics.parts.signals import Signal
from forcebound.messages.packets import Contact, Vector
from forcebound.quantities import NOT_NEGATIVE, POSITIVE, Damping, Length, Stiffness


@dataclass(frozen=True)
class Ball(EnvironmentModel):
    """A ball that pushes outwards, along the line from its centre, and damps motion inside."""

    # Numbers that it publishes, each with name, SI unit and label: recordings, plots and the live
    # page show them.
    signals = (Signal("depth", "m", "depth in the ball"),)

    # The parameters, as a launch file gives them: with a unit, a range, a default, in SI.
    stiffness: Annotated[Stiffness, NOT_NEGATIVE] = 1_000.0  # N/m
    damping: Annotated[Damping, NOT_NEGATIVE] = 1.0  # N s/m
    radius: Annotated[Length, POSITIVE] = 0.010  # m
    centre: Length = 0.020  # m, on the first axis

    def open(self, axes: int) -> "TouchedBall":
        """Return the ball, untouched."""
        return TouchedBall(self)


class TouchedBall(Environment):
    """The ball, and where it is touched."""

    def __init__(self, ball: Ball) -> None:
        self.ball = ball
        self.touched: Contact | None = None  # None: free motion

    def force(self, user: str, position: Vector, velocity: Vector, elapsed: float) -> Vector:
        """Return the force, in N, one entry per axis.

        A force is positive when it *resists* motion in the positive direction.
        """
        ball = self.ball
        # From the centre to the device, and how far the device is inside.
        offset = (position[0] - ball.centre, *position[1:])
        distance = math.hypot(*offset)
        depth = ball.radius - distance
        self.signal("depth", max(depth, 0.0))
        self.touched = None
        if depth <= 0.0 or distance == 0.0:  # outside; or at the centre, where all ways lead out
            return (0.0,) * len(position)
        # The way out, and the place on the surface that is nearest to the device.
        normal = tuple(o / distance for o in offset)
        place = tuple(p + depth * n for p, n in zip(position, normal, strict=True))
        self.touched = Contact(place, normal)
        # It pushes the device out, along the normal; as a force that resists, that is -normal.
        push = ball.stiffness * depth
        return tuple(ball.damping * v - push * n for n, v in zip(normal, velocity, strict=True))

    def contact(self, user: str) -> Contact | None:
        """Return the contact of the last call of force: place on the surface, and way out.

        From it a run knows depth and stiffness felt.
        """
        return self.touched
