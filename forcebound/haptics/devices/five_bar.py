r"""A planar five-bar, simulated: two motors, four links, one tip.

Two motors stand at :math:`(\pm d/2, 0)`. Each turns a proximal link of length l, counted from the
x axis; two distal links of length L join the elbows at the tip. The tip is the meeting point
farther from the motors, in y. The class is that of the Pantograph (Campion, Wang and Hayward, IROS
2005) and of the Haply 2DIY, whose geometry, encoders (4880 counts a turn) and motors (0.123 N m)
are the defaults; its damping, friction and inertia are not published, and assumed here. The 2DIY
has no watchdog; this one has.

With the elbows A, B and the tip P, a force :math:`F = \lambda_A (P - A) + \lambda_B (P - B)` at the
tip pulls at the elbows along the distal links, so the torques are
:math:`\tau_A = \lambda_A (P - A) \cdot dA/d\theta_A` and :math:`\tau_B` alike: the Jacobian.
"""

import math
from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated

from forcebound.haptics.devices import Source
from forcebound.haptics.devices.arms import SimulatedArm
from forcebound.haptics.devices.kinematics import ArmKinematics, Floats, link_angle
from forcebound.haptics.laws.dissipation import AngleOfJoints, DampingOfJoints, TorqueOfJoints
from forcebound.messages.packets import Vector
from forcebound.quantities import NOT_NEGATIVE, POSITIVE, AngularSpeed, Inertia, Length, Torque

SOURCES: Mapping[str, Source] = {
    "damping": "assumed",
    "friction": "assumed",
    "resolution": "data sheet",
    "saturation": "data sheet",
    "largest_speed": "assumed",
}
PROXIMAL, DISTAL = 0.07, 0.09  # m, links of the Haply 2DIY
#: Sine of the angle between the distal links below which the tip cannot be held: 6 degrees.
LEAST_SINE = 0.1


def five_bar_pose(angles: Floats, geometry: Floats, tip: Floats, jacobian: Floats) -> None:
    """Pose of a five-bar; see :data:`forcebound.haptics.devices.kinematics.Pose`.

    Angles of the motors at +d/2 and -d/2, in rad; the geometry is l, L, d, and the coordinates of
    the tip's origin, in m. Where the distal links could not meet, or are nearly in line, the
    Jacobian is zero.
    """
    proximal, distal, base, origin_x, origin_y = geometry
    ax = 0.5 * base + proximal * math.cos(angles[0])
    ay = proximal * math.sin(angles[0])
    bx = -0.5 * base + proximal * math.cos(angles[1])
    by = proximal * math.sin(angles[1])
    apart = math.hypot(ax - bx, ay - by)
    height = math.sqrt(max(distal * distal - 0.25 * apart * apart, 0.0))
    across = height / apart if apart > 0.0 else 0.0
    px = 0.5 * (ax + bx) - across * (ay - by)
    py = 0.5 * (ay + by) + across * (ax - bx)
    tip[0] = px - origin_x
    tip[1] = py - origin_y
    # Rows: the distal links; a link keeps its length if tip and elbow move alike along it.
    right_x, right_y, left_x, left_y = px - ax, py - ay, px - bx, py - by
    cross = right_x * left_y - right_y * left_x
    is_held = abs(cross) > LEAST_SINE * distal * distal
    scale = 1.0 / cross if is_held else 0.0
    right = (right_y * (ax - 0.5 * base) - right_x * ay) * scale
    left = (left_y * (bx + 0.5 * base) - left_x * by) * scale
    jacobian[0, 0] = left_y * right
    jacobian[0, 1] = -right_y * left
    jacobian[1, 0] = -left_x * right
    jacobian[1, 1] = right_x * left


@dataclass(frozen=True, kw_only=True)
class FiveBarNumbers:
    """Numbers and geometry of a five-bar of the class of the Haply 2DIY and the Pantograph.

    Attributes:
        origin: Where the tip is at 0 m, from the middle between the motors.
    """

    inertia: Annotated[Inertia, POSITIVE] = 1e-4  # assumed
    damping: DampingOfJoints = 1e-3  # assumed; 0.2 N s/m at a lever of 0.07 m
    friction: TorqueOfJoints = 4e-3  # assumed; 0.06 N there
    resolution: AngleOfJoints = math.tau / 4880  # data sheet, version 3; version 2 is finer
    saturation: Annotated[Torque, POSITIVE] = 0.123  # the firmware's clamp
    # 7 m/s at an elbow; a hand's peak over 0.15 m is 27 rad/s (see phantom.py), more near singular
    # poses.
    largest_speed: Annotated[AngularSpeed, POSITIVE] | None = 100.0
    origin: tuple[Length, Length] = (0.0, 0.105)
    sources: Mapping[str, Source] = field(default_factory=lambda: SOURCES, hash=False)

    @property
    @abstractmethod
    def links(self) -> tuple[float, float, float]:
        """Lengths of the links at the motors and at the tip, and distance of the motors, in m."""

    def geometry(self) -> ArmKinematics:
        return ArmKinematics(five_bar_pose, (*self.links, *self.origin), 2)

    def angles(self, position: Vector) -> Vector | None:
        """The elbows are those on the outer sides."""
        proximal, distal, base = self.links
        found = []
        for side in (1.0, -1.0):
            x = position[0] + self.origin[0] - side * 0.5 * base
            y = position[1] + self.origin[1]
            corner = link_angle(proximal, distal, math.hypot(x, y))
            if corner is None:
                return None
            found.append(math.atan2(y, x) - side * corner)
        return tuple(found)


@dataclass(frozen=True, kw_only=True)
class FiveBar(FiveBarNumbers, SimulatedArm):
    """Parameters of the simulated five-bar, of the class of the Haply 2DIY and the Pantograph.

    Attributes:
        proximal: Length of the links at the motors.
        distal: Length of the links at the tip.
        base: Distance of the motors.
    """

    proximal: Annotated[Length, POSITIVE] = PROXIMAL
    distal: Annotated[Length, POSITIVE] = DISTAL
    base: Annotated[Length, NOT_NEGATIVE] = 0.038

    @property
    def links(self) -> tuple[float, float, float]:
        return self.proximal, self.distal, self.base
