r"""A desktop arm of three joints, simulated, in the manner of the 3D Systems Touch (PHANToM Omni).

The base turns both links about the vertical. The two motors of the links sit on the base: one turns
the upper link, the other, through a parallelogram, the lower one, so the angle of the lower link is
counted from the vertical and not from the upper link. With angles :math:`\theta_1` of the base,
:math:`\theta_2` of the upper link above the level and :math:`\theta_3` of the lower link outwards
from hanging down,

.. math::

    r = l_1 \cos\theta_2 + l_2 \sin\theta_3 , \qquad
    x = r \sin\theta_1 , \quad y = l_1 \sin\theta_2 - l_2 \cos\theta_3 , \quad z = r \cos\theta_1

to the right, up, and towards the user. Source of the kinematics and of the links' length: A.
Jarillo-Silva, O. A. Dominguez-Ramirez, V. Parra-Vega and J. P. Ordaz-Oliver, PHANToM OMNI haptic
device: kinematic and manipulability, IEEE CERMA 2009. The data sheet gives the workspace, the
largest force, the resolution, the apparent mass, and of the friction an *upper* limit only: what is
stated here is half of that, and assumed, as is the damping.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated

from forcebound.haptics.devices import Source
from forcebound.haptics.devices.arms import ASSUMED, SimulatedArm
from forcebound.haptics.devices.kinematics import ArmKinematics, Floats, two_links
from forcebound.haptics.laws.dissipation import AngleOfJoints, DampingOfJoints, TorqueOfJoints
from forcebound.messages.packets import Vector
from forcebound.quantities import POSITIVE, AngularSpeed, Inertia, Length, Torque


def desktop_pose(angles: Floats, geometry: Floats, tip: Floats, jacobian: Floats) -> None:
    """Pose of a desktop arm; see :data:`forcebound.haptics.devices.kinematics.Pose`.

    Angles of base, upper and lower link, in rad; the geometry is the lengths of the links, and the
    origin, up and out from the shoulder, in m.
    """
    upper, lower = geometry[0], geometry[1]
    sine, cosine = math.sin(angles[0]), math.cos(angles[0])
    upper_out, upper_up = upper * math.cos(angles[1]), upper * math.sin(angles[1])
    lower_out, lower_up = lower * math.sin(angles[2]), -lower * math.cos(angles[2])
    out = upper_out + lower_out
    tip[0] = out * sine
    tip[1] = upper_up + lower_up - geometry[2]
    tip[2] = out * cosine - geometry[3]
    jacobian[0, 0] = out * cosine
    jacobian[0, 1] = -upper_up * sine
    jacobian[0, 2] = -lower_up * sine
    jacobian[1, 0] = 0.0
    jacobian[1, 1] = upper_out
    jacobian[1, 2] = lower_out
    jacobian[2, 0] = -out * sine
    jacobian[2, 1] = -upper_up * cosine
    jacobian[2, 2] = -lower_up * cosine


@dataclass(frozen=True, kw_only=True)
class DesktopArm(SimulatedArm):
    """Parameters of the simulated desktop arm.

    Attributes:
        upper: Length of the link at the shoulder.
        lower: Length of the link at the tip.
        origin: Where the tip is at 0 m: up and out, from the shoulder.
        workspace: Edges of the box about 0 m in which the hand should stay: to the right, up, and
            towards the user. The arm reaches all of it.
    """

    inertia: Annotated[Inertia, POSITIVE] = 8e-4  # 45 g at 0.133 m
    damping: DampingOfJoints = 1.8e-3  # 0.1 N s/m at 0.133 m
    friction: TorqueOfJoints = 0.0173  # 0.13 N at 0.133 m
    resolution: AngleOfJoints = 4.1e-4  # 55 um at 0.133 m
    saturation: Annotated[Torque, POSITIVE] = 0.44  # 3.3 N at 0.133 m
    # 5.3 m/s at 0.133 m: twice a hand's peak along the workspace's diagonal (see phantom.py).
    largest_speed: Annotated[AngularSpeed, POSITIVE] | None = 40.0
    upper: Annotated[Length, POSITIVE] = 0.13335
    lower: Annotated[Length, POSITIVE] = 0.13335
    origin: tuple[Length, Length] = (-0.025, 0.165)  # ours: the arm then reaches the whole box
    workspace: tuple[
        Annotated[Length, POSITIVE], Annotated[Length, POSITIVE], Annotated[Length, POSITIVE]
    ] = (0.16, 0.12, 0.07)
    sources: Mapping[str, Source] = field(
        default_factory=lambda: {
            **ASSUMED,
            **dict.fromkeys(("inertia", "resolution", "saturation"), "data sheet"),
        },
        hash=False,
    )

    @property
    def axes(self) -> int:
        return 3

    def geometry(self) -> ArmKinematics:
        return ArmKinematics(desktop_pose, (self.upper, self.lower, *self.origin), 3)

    def angles(self, position: Vector) -> Vector | None:
        """The elbow is above the line from shoulder to tip."""
        right, up, towards = position[0], position[1] + self.origin[0], position[2] + self.origin[1]
        links = two_links(self.upper, self.lower, math.hypot(right, towards), up)
        if links is None:
            return None
        upper, (lower_out, lower_up) = links
        return (math.atan2(right, towards), upper, math.atan2(lower_out, -lower_up))
