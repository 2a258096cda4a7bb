"""Stated numbers of every arm, of its joints. Each kind of simulated arm adds its geometry."""

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Annotated

from forcebound.errors import ConfigError
from forcebound.haptics.devices import Source
from forcebound.haptics.devices.kinematics import ArmKinematics
from forcebound.haptics.devices.simulated import SimulatedDevice, SimulatedModel
from forcebound.haptics.devices.true_values import (
    AngleOfJoints,
    DampingOfJoints,
    TorqueOfJoints,
    TrueJoints,
    TrueNumbers,
)
from forcebound.haptics.hands import Operator
from forcebound.haptics.laws import Watchdog
from forcebound.messages.packets import Vector
from forcebound.quantities import POSITIVE, AngularSpeed, Inertia, Range, Ratio, Time, Torque

if TYPE_CHECKING:
    from forcebound.haptics.devices.arm import ArmBody

ASSUMED: Mapping[str, Source] = dict.fromkeys(
    ("damping", "friction", "resolution", "saturation", "inertia", "largest_speed"), "assumed"
)


@dataclass(frozen=True, kw_only=True)
class StatedJoints(SimulatedModel):
    """Stated numbers of an arm: those of its joints.

    No weight: gravity pulls at a joint as the pose has it, so no constant describes it.

    Attributes:
        inertia: Of each joint, with the links that it carries; it does not change with the pose.
        damping: Minimum viscous damping of the joints; one number, or one of each.
        friction: Minimum Coulomb friction; one of each joint gives more force than one number,
            which counts along the path of all joints.
        resolution: Of the encoders.
        saturation: Largest torque: length of the vector of the joints' torques.
        presliding: Angle over which friction yields elastically before it dissipates.
        largest_speed: A reading that implies more is refused; null: none is.
        hand_speed: The hand turns the joints no faster than this, as the length of the vector of
            their speeds and on average over a period or longer; null: that is not stated.
        substep: Longest integration step.
        truth: What the simulated arm really has, where that differs from what is stated.
    """

    inertia: Annotated[Inertia, POSITIVE]
    damping: DampingOfJoints
    friction: TorqueOfJoints
    resolution: AngleOfJoints
    saturation: Annotated[Torque, POSITIVE]
    presliding: AngleOfJoints = 0.0
    largest_speed: Annotated[AngularSpeed, POSITIVE] | None = None
    hand_speed: Annotated[AngularSpeed, POSITIVE] | None = None
    substep: Annotated[Time, POSITIVE] = 5e-5
    truth: TrueJoints | None = None

    @property
    def axes(self) -> int:
        """Number of joints, and of coordinates of the tip."""
        return 2

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.angles((0.0,) * self.axes) is None:
            raise ConfigError("origin: the arm does not reach 0 m", field="origin")

    @abstractmethod
    def kinematics(self) -> ArmKinematics:
        """Return the kinematics of this geometry."""

    @abstractmethod
    def angles(self, position: Vector) -> Vector | None:
        """Return the joint angles, in rad, for a tip at ``position``, in m; None out of reach."""

    def body(self, true: TrueNumbers, operator: Operator) -> "ArmBody":
        from forcebound.haptics.devices.arm import ArmBody  # numpy, which a launcher does without

        return ArmBody(self, true, operator)


@dataclass(frozen=True, kw_only=True)
class SimulatedArm(StatedJoints):
    """Parameters of a simulated arm.

    Attributes:
        force_sensor: Whether it measures the force of the simulated hand, of its spring and damper.
    """

    sources: Mapping[str, Source] = field(default_factory=lambda: ASSUMED, hash=False)
    watchdog: Watchdog = "guarding"
    watchdog_tolerance: Annotated[Ratio, Range(at_least=0, below=1)] = 0.0
    guard_period: Annotated[Time, POSITIVE] = 50e-6
    force_sensor: bool = False

    def open(self, operator: Operator | None, hold_limit: float) -> SimulatedDevice:
        return SimulatedDevice(self, operator, hold_limit)
