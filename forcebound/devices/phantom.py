"""PHANToM Premium 1.5, simulated: the device of the paper's experiments."""

from dataclasses import dataclass
from typing import Annotated

from forcebound.devices.simulated import SimulatedDevice
from forcebound.devices.stated import StatedImperfections, check_per_axis, per_axis
from forcebound.messages.packets import MAX_AXES
from forcebound.operators import Operator
from forcebound.quantities import (
    NOT_NEGATIVE,
    POSITIVE,
    Damping,
    Force,
    Length,
    Mass,
    Range,
    Time,
)


@dataclass(frozen=True)
class PhantomPremium15(StatedImperfections):
    """Parameters of the simulated PHANToM Premium 1.5.

    Every axis is alike and independent of the others. Damping and friction are the minimum values
    that the paper identified on the y axis; the simulated device has exactly these, so a law that
    relies on them has no hidden reserve.

    Attributes:
        presliding: Way over which friction yields elastically before it dissipates; one for all
            axes, or one of each.
        weight: Of the tip, which the device carries: the force of gravity in the positive direction
            of an axis; one for all axes, or one of each.
        weight_error: The weight may differ from that by so much.
    """

    axes: Annotated[int, Range(at_least=1, at_most=MAX_AXES)] = 1
    # Apparent mass at the tip; the usual data-sheet figure (paper: not given).
    mass: Annotated[Mass, POSITIVE] = 0.075
    damping: Annotated[Damping, NOT_NEGATIVE] = 0.27  # paper 4.1
    friction: Annotated[Force, NOT_NEGATIVE] = 0.12  # paper 4.1
    resolution: Annotated[Length, NOT_NEGATIVE] = 3e-5  # paper 4.1
    saturation: Annotated[Force, POSITIVE] = 8.5  # paper 4.1
    substep: Annotated[Time, POSITIVE] = 5e-5  # longest integration step
    presliding: Length | tuple[Length, ...] = 0.0
    weight: Force | tuple[Force, ...] = 0.0
    weight_error: Annotated[Force, NOT_NEGATIVE] = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        check_per_axis(self, "presliding", NOT_NEGATIVE, "m")
        check_per_axis(self, "weight", Range(), "N")

    @property
    def is_plain(self) -> bool:
        """Whether it states no imperfection, so that the sweep's kernel can simulate it."""
        stated = (self.gain_error, self.lag, self.write_delay, self.largest_speed)
        own = (*per_axis(self.presliding, self.axes), *per_axis(self.weight, self.axes))
        return self.watchdog != "none" and not any((*stated, *own, self.weight_error))

    def open(self, operator: Operator | None, hold_limit: float) -> SimulatedDevice:
        """Return the simulated device; see :class:`forcebound.devices.DeviceModel`."""
        return SimulatedDevice(self, operator, hold_limit)
