"""A serial arm with two or three joints, simulated.

Two joints move the tip in a plane: shoulder and elbow, angles counted from the x axis and from the
upper link. A third joint, the first of the three, turns that plane about its y axis: the tip's
coordinates are then along the arm in the plane's rest position, up, and to the side.

The defaults are the PHANToM Premium's numbers at a lever of one link, so that the tip feels like
that device.
"""

import math
from dataclasses import dataclass
from typing import Annotated

from forcebound.haptics.devices.arms import SimulatedArm
from forcebound.haptics.devices.kinematics import ArmKinematics, Floats, two_links
from forcebound.haptics.laws.dissipation import AngleOfJoints, DampingOfJoints, TorqueOfJoints
from forcebound.messages.packets import Vector
from forcebound.quantities import POSITIVE, AngularSpeed, Inertia, Length, Range, Torque


def planar_pose(angles: Floats, geometry: Floats, tip: Floats, jacobian: Floats) -> None:
    """Pose of two joints; see :data:`forcebound.haptics.devices.kinematics.Pose`.

    Angles of shoulder and elbow, in rad; the geometry is the lengths of the links, and the
    coordinates of the tip's origin, in m.
    """
    upper, lower = geometry[0], geometry[1]
    x_lower = lower * math.cos(angles[0] + angles[1])
    y_lower = lower * math.sin(angles[0] + angles[1])
    x = upper * math.cos(angles[0]) + x_lower
    y = upper * math.sin(angles[0]) + y_lower
    tip[0] = x - geometry[2]
    tip[1] = y - geometry[3]
    jacobian[0, 0] = -y
    jacobian[0, 1] = -y_lower
    jacobian[1, 0] = x
    jacobian[1, 1] = x_lower


def spatial_pose(angles: Floats, geometry: Floats, tip: Floats, jacobian: Floats) -> None:
    """Pose of three joints; see :data:`forcebound.haptics.devices.kinematics.Pose`.

    Angles of base, shoulder and elbow, in rad; geometry as of :func:`planar_pose`.
    """
    upper, lower = geometry[0], geometry[1]
    cosine, sine = math.cos(angles[0]), math.sin(angles[0])
    out_lower = lower * math.cos(angles[1] + angles[2])
    up_lower = lower * math.sin(angles[1] + angles[2])
    out = upper * math.cos(angles[1]) + out_lower
    up = upper * math.sin(angles[1]) + up_lower
    tip[0] = out * cosine - geometry[2]
    tip[1] = up - geometry[3]
    tip[2] = out * sine - geometry[4]
    jacobian[0, 0] = -out * sine
    jacobian[0, 1] = -up * cosine
    jacobian[0, 2] = -up_lower * cosine
    jacobian[1, 0] = 0.0
    jacobian[1, 1] = out
    jacobian[1, 2] = out_lower
    jacobian[2, 0] = out * cosine
    jacobian[2, 1] = -up * sine
    jacobian[2, 2] = -up_lower * sine


@dataclass(frozen=True, kw_only=True)
class SerialArm(SimulatedArm):
    """Parameters of the simulated serial arm.

    Attributes:
        joints: Two, in a plane, or three.
        upper: Length of the link at the shoulder.
        lower: Length of the link at the tip.
        origin: Where the tip is at 0 m: along the arm and up, from the shoulder.
    """

    joints: Annotated[int, Range(at_least=2, at_most=3)] = 2
    inertia: Annotated[Inertia, POSITIVE] = 1.5e-3  # 75 g at 0.14 m
    damping: DampingOfJoints = 5.3e-3  # 0.27 N s/m at 0.14 m
    friction: TorqueOfJoints = 0.0168  # 0.12 N at 0.14 m
    resolution: AngleOfJoints = 2.1e-4  # 30 um at 0.14 m
    saturation: Annotated[Torque, POSITIVE] = 1.2  # 8.5 N at 0.14 m
    # 7 m/s at 0.14 m: twice a hand's peak over 0.28 m (see phantom.py); folded, joints turn faster.
    largest_speed: Annotated[AngularSpeed, POSITIVE] | None = 50.0
    upper: Annotated[Length, POSITIVE] = 0.14
    lower: Annotated[Length, POSITIVE] = 0.14
    origin: tuple[Length, Length] = (0.14, -0.14)  # upper link level, lower one down

    @property
    def axes(self) -> int:
        return self.joints

    def geometry(self) -> ArmKinematics:
        pose = planar_pose if self.joints == 2 else spatial_pose
        return ArmKinematics(pose, (self.upper, self.lower, *self.origin, 0.0), self.joints)

    def angles(self, position: Vector) -> Vector | None:
        """The elbow is above the line from shoulder to tip."""
        out, up = position[0] + self.origin[0], position[1] + self.origin[1]
        base: Vector = ()
        if self.joints == 3:
            base = (math.atan2(position[2], out),)
            out = math.hypot(out, position[2])
        links = two_links(self.upper, self.lower, out, up)
        if links is None:
            return None
        shoulder, (lower_out, lower_up) = links
        return (*base, shoulder, math.atan2(lower_up, lower_out) - shoulder)
