"""Stated numbers of every arm, of its joints. Each kind of simulated arm adds its geometry."""

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Annotated, Literal

from forcebound.axes import Axis, lengths
from forcebound.errors import ConfigError
from forcebound.haptics.devices import Source
from forcebound.haptics.devices.kinematics import ArmKinematics
from forcebound.haptics.devices.simulated import SimulatedDevice, SimulatedModel
from forcebound.haptics.devices.true_values import TrueJoints, TrueNumbers
from forcebound.haptics.hands import Operator
from forcebound.haptics.laws import Watchdog
from forcebound.haptics.laws.dissipation import JointNumbers
from forcebound.messages.packets import Vector
from forcebound.quantities import POSITIVE, Inertia, Range, Ratio, Time

if TYPE_CHECKING:
    from forcebound.haptics.devices.arm import ArmBody

ASSUMED: Mapping[str, Source] = dict.fromkeys(
    ("damping", "friction", "resolution", "saturation", "inertia", "largest_speed"), "assumed"
)


@dataclass(frozen=True, kw_only=True)
class StatedJoints(JointNumbers, SimulatedModel):
    """Stated numbers of an arm: those of its joints.

    Attributes:
        inertia: Of each joint, with the links that it carries; it does not change with the pose.
        space: Axes that the graph, the environment and the results see: the coordinates of the tip,
            in m and N, or the joints, in rad and N m. A simulated hand holds the tip either way.
        substep: Longest integration step.
        truth: What the simulated arm really has, where that differs from what is stated.
    """

    inertia: Annotated[Inertia, POSITIVE]
    space: Literal["tip", "joints"] = "tip"
    substep: Annotated[Time, POSITIVE] = 5e-5
    truth: TrueJoints | None = None

    @property
    def axes(self) -> int:
        """Number of joints, and of coordinates of the tip."""
        return 2

    @property
    def named_axes(self) -> tuple[Axis, ...]:
        if self.space == "tip":
            return lengths(self.axes)
        return tuple(Axis(f"joint {j + 1}", "angle") for j in range(self.axes))

    @property
    def hand_axes(self) -> tuple[Axis, ...]:
        return lengths(self.axes)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.angles((0.0,) * self.axes) is None:
            raise ConfigError("origin: the arm does not reach 0 m", field="origin")

    @abstractmethod
    def geometry(self) -> ArmKinematics:
        """Return the kinematics of this geometry, whatever axes the graph sees."""

    def kinematics(self) -> ArmKinematics | None:
        return self.geometry() if self.space == "tip" else None

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
