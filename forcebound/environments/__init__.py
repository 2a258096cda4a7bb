"""Virtual environments: the force that answers a position.

To add an environment: copy ``wall.py`` to ``my_environment.py``, add one line to ``ENVIRONMENTS``;
``tests/test_environments.py`` tests it with all the others, and launch files know it as
``environment: {kind: my_environment}`` with the fields of its dataclass as parameters.

A force is positive when it resists motion in the positive direction, so a wall that the hand
pushes into answers a positive force.
"""

from typing import Protocol

from forcebound.environments.adversary import (
    ActiveWall,
    NegativeDamper,
    RandomForce,
    VelocityPusher,
)
from forcebound.environments.damped_wall import DampedWall
from forcebound.environments.damper import Damper
from forcebound.environments.power_law_wall import PowerLawWall
from forcebound.environments.time_varying_wall import TimeVaryingWall
from forcebound.environments.wall import Wall
from forcebound.messages.packets import Vector


class Environment(Protocol):
    """What an environment node asks of the environment that it serves."""

    def force(self, position: Vector, velocity: Vector, elapsed: float) -> Vector:
        """Return the force, in N, one entry per axis.

        Args:
            position: Of the device, in m, shape ``(axes,)``.
            velocity: Of the device, in m/s, same shape.
            elapsed: Time since the force engaged, in s; 0 before.
        """
        ...


ENVIRONMENTS: dict[str, type[Environment]] = {
    "wall": Wall,
    "damped_wall": DampedWall,
    "time_varying_wall": TimeVaryingWall,
    "power_law_wall": PowerLawWall,
    "damper": Damper,
    "active_wall": ActiveWall,
    "negative_damper": NegativeDamper,
    "random_force": RandomForce,
    "velocity_pusher": VelocityPusher,
}
