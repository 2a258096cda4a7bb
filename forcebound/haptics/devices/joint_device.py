"""Joints, simulated: a device whose axes are its joints, without kinematics.

Each joint has an inertia, a damper and Coulomb friction, and knows nothing of the others: what is
left out is how the links couple them, gravity, and where the tip is. A simulated hand holds each
joint by a spring and a damper of its own, in the unit of the joint.

The defaults are those of a small servo arm with little gearing: assumed, none is measured.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated

from forcebound.axes import OfAxes
from forcebound.haptics.devices import JointsModel, Source
from forcebound.haptics.devices.arms import ASSUMED
from forcebound.haptics.devices.axes import AxesBody
from forcebound.haptics.devices.simulated import SimulatedDevice, SimulatedModel
from forcebound.haptics.devices.true_values import TrueJoints, TrueNumbers
from forcebound.haptics.hands import Operator
from forcebound.haptics.laws import Watchdog
from forcebound.haptics.laws.dissipation import AngleOfJoints, DampingOfJoints, TorqueOfJoints
from forcebound.quantities import POSITIVE, AngularSpeed, Inertia, Range, Ratio, Time, Torque


@dataclass(frozen=True, kw_only=True)
class JointBodies(JointsModel, SimulatedModel):
    """Parameters of joints that can be simulated, or emulated.

    Attributes:
        inertia: Of each joint, with what it carries; one number, or one of each.
        substep: Longest step of the integration.
    """

    inertia: OfAxes[Annotated[Inertia, POSITIVE]] = 3e-3
    substep: Annotated[Time, POSITIVE] = 5e-5

    def body(self, true: TrueNumbers, operator: Operator) -> AxesBody:
        return AxesBody(self.inertia, 0.0, self.substep, true, operator)


@dataclass(frozen=True, kw_only=True)
class Joints(JointBodies):
    """Parameters of simulated joints.

    Attributes:
        force_sensor: Whether it measures the torques of the simulated hand, of its springs and
            dampers.
        truth: What the simulated joints really have, where that differs from what is stated.
    """

    joints: tuple[str, ...] = ("shoulder", "elbow", "wrist")
    damping: DampingOfJoints = 0.01
    friction: TorqueOfJoints = 0.03
    resolution: AngleOfJoints = 2.0 * math.pi / 8192
    saturation: Annotated[Torque, POSITIVE] = 3.0
    # Twice a hand's fastest twist, 2.6 rad in 0.15 s; see knob.py.
    largest_speed: Annotated[AngularSpeed, POSITIVE] | None = 65.0
    watchdog: Watchdog = "guarding"
    watchdog_tolerance: Annotated[Ratio, Range(at_least=0, below=1)] = 0.0
    guard_period: Annotated[Time, POSITIVE] = 50e-6
    force_sensor: bool = False
    truth: TrueJoints | None = None
    sources: Mapping[str, Source] = field(default_factory=lambda: ASSUMED, hash=False)

    def open(self, operator: Operator | None, hold_limit: float) -> SimulatedDevice:
        return SimulatedDevice(self, operator, hold_limit)
