"""What an arm states, numbers of its joints, and the simulated arm that has them."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, TypeAlias

from forcebound.devices.kinematics import ArmKinematics
from forcebound.devices.simulated import SimulatedDevice
from forcebound.devices.stated import StatedImperfections, check_count
from forcebound.devices.true_values import TrueMotor
from forcebound.messages.packets import Vector
from forcebound.operators import Operator
from forcebound.quantities import (
    NOT_NEGATIVE,
    POSITIVE,
    Angle,
    AngularSpeed,
    Inertia,
    JointDamping,
    Time,
    Torque,
)

if TYPE_CHECKING:
    from forcebound.devices.arm import ArmBody

# One number for all joints alike, or a list of one for each joint.
DampingOfJoints: TypeAlias = (
    Annotated[JointDamping, NOT_NEGATIVE] | tuple[Annotated[JointDamping, NOT_NEGATIVE], ...]
)
TorqueOfJoints: TypeAlias = (
    Annotated[Torque, NOT_NEGATIVE] | tuple[Annotated[Torque, NOT_NEGATIVE], ...]
)
AngleOfJoints: TypeAlias = (
    Annotated[Angle, NOT_NEGATIVE] | tuple[Annotated[Angle, NOT_NEGATIVE], ...]
)

PER_JOINT = ("damping", "friction", "resolution", "presliding")


@dataclass(frozen=True, kw_only=True)
class TrueJoints(TrueMotor):
    """True values of an arm; null: as stated.

    Attributes:
        damping: Viscous damping of the joints; one number, or one of each, as are the next three.
        friction: Coulomb friction of each joint by itself.
        presliding: Angle over which friction yields elastically.
        resolution: Resolution of the encoder.
    """

    damping: DampingOfJoints | None = None
    friction: TorqueOfJoints | None = None
    presliding: AngleOfJoints | None = None
    resolution: AngleOfJoints | None = None


@dataclass(frozen=True, kw_only=True)
class StatedJoints(StatedImperfections, ABC):
    """Parameters of an arm beside its geometry, which each kind of arm adds.

    Attributes:
        inertia: Of each joint, with the links that it carries; it does not change with the pose.
        damping: Minimum viscous damping of the joints; one number, or one of each.
        friction: Minimum Coulomb friction; one of each joint gives more force than one number,
            which counts along the path of all joints.
        resolution: Of the encoders.
        saturation: Largest torque: length of the vector of the joints' torques.
        presliding: Angle over which friction yields elastically before it dissipates.
        largest_speed: A reading that implies more is refused; null: none is.
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
    substep: Annotated[Time, POSITIVE] = 5e-5
    truth: TrueJoints | None = None

    @property
    def axes(self) -> int:
        """Number of joints, and of coordinates of the tip."""
        return 2

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in PER_JOINT:
            check_count(getattr(self, name), name, self.axes)
            check_count(getattr(self.truth, name, None), f"truth: {name}", self.axes)
        check_count(getattr(self.truth, "gain", None), "truth: gain", self.axes)

    @abstractmethod
    def kinematics(self) -> ArmKinematics:
        """Return the kinematics of this geometry."""

    @abstractmethod
    def angles(self, position: Vector) -> Vector | None:
        """Return the joint angles, in rad, for a tip at ``position``, in m; None out of reach."""

    def body(self, operator: Operator) -> "ArmBody":
        """Return the body; see :class:`forcebound.devices.simulated.Body`.

        Raises:
            DeviceError: If the hand begins where the arm does not reach.
        """
        from forcebound.devices.arm import ArmBody  # numpy, which a launcher does without

        return ArmBody(self, operator)

    def open(self, operator: Operator | None, hold_limit: float) -> SimulatedDevice:
        """Return the simulated device; see :class:`forcebound.devices.DeviceModel`."""
        return SimulatedDevice(self, operator, hold_limit)
