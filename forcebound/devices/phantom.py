"""PHANToM Premium 1.5, simulated: the device of the paper's experiments."""

from dataclasses import dataclass

from forcebound.devices.plant import SimulatedDevice
from forcebound.messages.packets import MAX_AXES
from forcebound.operators import Operator
from forcebound.quantities import Damping, Force, Length, Mass, Time


@dataclass(frozen=True)
class PhantomPremium15:
    """Parameters of the simulated PHANToM Premium 1.5.

    Every axis is alike and independent of the others. Damping and friction are the minimum values
    that the paper identified on the y axis; the simulated device has exactly these, so a law that
    relies on them has no hidden reserve.
    """

    axes: int = 1
    mass: Mass = 0.075  # apparent mass at the tip; the usual data-sheet figure (paper: not given)
    damping: Damping = 0.27  # paper 4.1
    friction: Force = 0.12  # paper 4.1
    resolution: Length = 3e-5  # paper 4.1
    saturation: Force = 8.5  # paper 4.1
    substep: Time = 5e-5  # longest integration step

    def __post_init__(self) -> None:
        if not 1 <= self.axes <= MAX_AXES:
            raise ValueError(f"axes must be 1 to {MAX_AXES}, got {self.axes}")
        for name, unit, lowest in (
            ("mass", "kg", 0.0),
            ("saturation", "N", 0.0),
            ("substep", "s", 0.0),
        ):
            if getattr(self, name) <= lowest:
                raise ValueError(f"{name} must be > 0 {unit}, got {getattr(self, name)} {unit}")
        for name, unit in (("damping", "N s/m"), ("friction", "N"), ("resolution", "m")):
            if getattr(self, name) < 0:
                raise ValueError(f"{name} must be >= 0 {unit}, got {getattr(self, name)} {unit}")

    def open(self, operator: Operator | None, hold_limit: float) -> SimulatedDevice:
        """Return the simulated device; see :class:`forcebound.devices.DeviceModel`."""
        return SimulatedDevice(self, operator, hold_limit)
