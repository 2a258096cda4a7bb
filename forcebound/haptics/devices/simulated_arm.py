"""What simulated arms have in common: a body in a hand. Each kind adds its geometry."""

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Annotated

from forcebound.errors import ConfigError
from forcebound.haptics.devices import Source
from forcebound.haptics.devices.kinematics import ArmKinematics
from forcebound.haptics.devices.simulated import SimulatedDevice
from forcebound.haptics.devices.stated_joints import StatedJoints
from forcebound.haptics.hands import Operator
from forcebound.haptics.laws import Watchdog
from forcebound.messages.packets import Vector
from forcebound.quantities import POSITIVE, Range, Ratio, Time

if TYPE_CHECKING:
    from forcebound.haptics.devices.arm import ArmBody


ASSUMED: Mapping[str, Source] = dict.fromkeys(
    ("damping", "friction", "resolution", "saturation", "inertia", "largest_speed"), "assumed"
)


@dataclass(frozen=True, kw_only=True)
class SimulatedArm(StatedJoints):
    """Parameters of a simulated arm."""

    sources: Mapping[str, Source] = field(default_factory=lambda: ASSUMED, hash=False)
    watchdog: Watchdog = "guarding"
    watchdog_tolerance: Annotated[Ratio, Range(at_least=0, below=1)] = 0.0
    guard_period: Annotated[Time, POSITIVE] = 50e-6

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

    def body(self, operator: Operator) -> "ArmBody":
        """Return the body; see :class:`forcebound.haptics.devices.simulated.Body`.

        Raises:
            DeviceError: If the hand begins where the arm does not reach.
        """
        from forcebound.haptics.devices.arm import ArmBody  # numpy, which a launcher does without

        return ArmBody(self, operator)

    def open(self, operator: Operator | None, hold_limit: float) -> SimulatedDevice:
        return SimulatedDevice(self, operator, hold_limit)
