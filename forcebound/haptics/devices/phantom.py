"""PHANToM Premium 1.5, simulated: the device of the paper's experiments."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated

from forcebound.haptics.devices import AxesModel, Source
from forcebound.haptics.devices.axes import AxesBody
from forcebound.haptics.devices.simulated import SimulatedDevice, SimulatedModel
from forcebound.haptics.devices.true_values import TrueAxes, TrueNumbers
from forcebound.haptics.hands import Operator
from forcebound.haptics.laws import Watchdog
from forcebound.haptics.laws.dissipation import DampingOfAxes, FrictionOfAxes, LengthOfAxes
from forcebound.messages.packets import MAX_AXES
from forcebound.quantities import POSITIVE, Force, Mass, Range, Ratio, Speed, Time


@dataclass(frozen=True, kw_only=True)
class PhantomPremium15(SimulatedModel, AxesModel):
    """Parameters of the simulated PHANToM Premium 1.5.

    Every axis is alike and independent of the others, unless a number is given for each axis.
    Damping and friction are the minimum values that the paper identified on the y axis; the
    simulated device has exactly these, so a law that relies on them has no hidden reserve.

    Attributes:
        axes: Number of axes.
        mass: Apparent mass at the tip; the usual figure of its data sheet.
        substep: Longest step of the integration.
        force_sensor: Whether it measures the force of the simulated hand, of its spring and damper.
        truth: What the simulated device really has, where that differs from what is stated.
    """

    axes: Annotated[int, Range(at_least=1, at_most=MAX_AXES)] = 1
    mass: Annotated[Mass, POSITIVE] = 0.075
    damping: DampingOfAxes = 0.27  # paper 4.1
    friction: FrictionOfAxes = 0.12  # paper 4.1
    resolution: LengthOfAxes = 3e-5  # paper 4.1
    saturation: Annotated[Force, POSITIVE] = 8.5  # paper 4.1
    substep: Annotated[Time, POSITIVE] = 5e-5
    # Above the fastest reach of a hand across the 0.38 m of the real one's workspace: in 0.15 s a
    # minimum-jerk motion (Flash and Hogan 1985) peaks at 1.875 * 0.38 m / 0.15 s = 4.7 m/s.
    largest_speed: Annotated[Speed, POSITIVE] | None = 5.0
    watchdog: Watchdog = "guarding"
    watchdog_tolerance: Annotated[Ratio, Range(at_least=0, below=1)] = 0.0
    guard_period: Annotated[Time, POSITIVE] = 50e-6
    force_sensor: bool = False
    truth: TrueAxes | None = None
    sources: Mapping[str, Source] = field(
        default_factory=lambda: {
            "damping": "measured",  # of the real device, by the paper's authors
            "friction": "measured",
            "resolution": "data sheet",
            "saturation": "data sheet",
            "largest_speed": "assumed",
        },
        hash=False,
    )

    def body(self, true: TrueNumbers, operator: Operator) -> AxesBody:
        return AxesBody(self.mass, self.weight, self.substep, true, operator)

    def open(self, operator: Operator | None, hold_limit: float) -> SimulatedDevice:
        return SimulatedDevice(self, operator, hold_limit)
