"""PHANToM Premium 1.5, simulated: the device of the paper's experiments."""

from dataclasses import dataclass
from typing import Annotated

from forcebound.devices.plant import SimulatedDevice
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
    check_ranges,
)


@dataclass(frozen=True)
class PhantomPremium15:
    """Parameters of the simulated PHANToM Premium 1.5.

    Every axis is alike and independent of the others. Damping and friction are the minimum values
    that the paper identified on the y axis; the simulated device has exactly these, so a law that
    relies on them has no hidden reserve.
    """

    axes: Annotated[int, Range(at_least=1, at_most=MAX_AXES)] = 1
    # Apparent mass at the tip; the usual data-sheet figure (paper: not given).
    mass: Annotated[Mass, POSITIVE] = 0.075
    damping: Annotated[Damping, NOT_NEGATIVE] = 0.27  # paper 4.1
    friction: Annotated[Force, NOT_NEGATIVE] = 0.12  # paper 4.1
    resolution: Annotated[Length, NOT_NEGATIVE] = 3e-5  # paper 4.1
    saturation: Annotated[Force, POSITIVE] = 8.5  # paper 4.1
    substep: Annotated[Time, POSITIVE] = 5e-5  # longest integration step

    def __post_init__(self) -> None:
        check_ranges(self)

    def open(self, operator: Operator | None, hold_limit: float) -> SimulatedDevice:
        """Return the simulated device; see :class:`forcebound.devices.DeviceModel`."""
        return SimulatedDevice(self, operator, hold_limit)
