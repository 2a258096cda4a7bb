"""A knob, simulated: motors that turn, each with a handle.

A joint knows nothing of the others. Its tip is where the hand holds it, at the end of a lever, and
its position is that along the arc: lever times angle. So one knob is a device of one axis, and the
tip of three is a point in space that a hand could not hold with three real ones.

The defaults are those of a small brushless motor without gears: assumed, none is measured.
"""

import math
from dataclasses import dataclass
from typing import Annotated

from forcebound.haptics.devices.arms import SimulatedArm
from forcebound.haptics.devices.kinematics import ArmKinematics, Floats
from forcebound.haptics.laws.dissipation import AngleOfJoints, DampingOfJoints, TorqueOfJoints
from forcebound.messages.packets import Vector
from forcebound.quantities import POSITIVE, AngularSpeed, Inertia, Length, Range, Torque


def knob_pose(angles: Floats, geometry: Floats, tip: Floats, jacobian: Floats) -> None:
    """Pose of independent joints; see :data:`forcebound.haptics.devices.kinematics.Pose`.

    Angles in rad; the geometry is the length of each lever, in m; the tip, that along each arc.
    """
    for j in range(angles.size):
        for k in range(angles.size):
            jacobian[k, j] = 0.0
        jacobian[j, j] = geometry[j]
        tip[j] = geometry[j] * angles[j]


@dataclass(frozen=True, kw_only=True)
class KnobNumbers:
    """Numbers and geometry of knobs.

    Attributes:
        joints: Number of knobs, each an axis.
        lever: From the axle of a knob to the hand.
    """

    joints: Annotated[int, Range(at_least=1, at_most=3)] = 1
    lever: Annotated[Length, POSITIVE] = 0.04
    inertia: Annotated[Inertia, POSITIVE] = 1e-4
    damping: DampingOfJoints = 1e-3  # 0.6 N s/m at the hand
    friction: TorqueOfJoints = 1e-2  # 0.25 N at the hand
    saturation: Annotated[Torque, POSITIVE] = 0.3  # 7.5 N at the hand

    @property
    def axes(self) -> int:
        return self.joints

    def geometry(self) -> ArmKinematics:
        return ArmKinematics(knob_pose, (self.lever,) * self.joints, self.joints)

    def angles(self, position: Vector) -> Vector:
        return tuple([x / self.lever for x in position])


@dataclass(frozen=True, kw_only=True)
class Knob(KnobNumbers, SimulatedArm):
    """Parameters of the simulated knob."""

    resolution: AngleOfJoints = 2.0 * math.pi / 8192
    # 4 m/s at the hand: three times a hand's fastest twist, 2.6 rad in 0.15 s (see phantom.py).
    largest_speed: Annotated[AngularSpeed, POSITIVE] | None = 100.0
