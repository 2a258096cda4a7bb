"""Devices with a known truth, for identifications: drawn at random, altered, weighted."""

import math
import random
from dataclasses import dataclass
from typing import Any

from forcebound.haptics.devices import Device
from forcebound.haptics.devices.five_bar import FiveBar
from forcebound.haptics.devices.phantom import PhantomPremium15
from forcebound.haptics.devices.simulated import SimulatedDevice
from forcebound.haptics.devices.true_values import TrueAxes, TrueJoints
from forcebound.lab.identification.procedure import Plan
from forcebound.messages.packets import Vector

KNOB = Plan(reach=0.03, force=4.25)  # of a device of one axis like the PHANToM
ARM = Plan(reach=0.35, force=0.06)  # of a five-bar
WEIGHTS = {1: 1.5, 2: 0.027}  # N, N m, by axes
SEEN = 1.5  # steps of the encoder; less presliding cannot be bounded narrowly
RESOLVABLE_LAGS = (2e-4, 1e-3)  # s; a shorter one cannot be bounded narrowly by every encoder
SUBSTEP = 2.5e-4  # s


class Altered(Device):
    """A device whose readings or forces something changes."""

    def __init__(self, device: Device) -> None:
        self._device = device
        self.axes = device.axes
        self.reading: Vector = (0.0,) * device.axes

    def engage(self, time_ns: int) -> None:
        """Engage the device."""
        self._device.engage(time_ns)

    def read(self, time_ns: int) -> Vector:
        """Return a changed reading."""
        self.reading = self._device.read(time_ns)
        return self.seen(self.reading)

    def write(self, time_ns: int, force: Vector) -> Vector:
        """Write a changed force, and return the other."""
        self._device.write(time_ns, self.acting(force))
        return force

    def close(self) -> None:
        """Close the device."""
        self._device.close()

    def seen(self, reading: Vector) -> Vector:
        """Return the changed reading."""
        return reading

    def acting(self, force: Vector) -> Vector:
        """Return the changed force."""
        return force


class Weighted(Altered):
    """A device whose user hangs a weight on an axis, and takes it off, as the messages say.

    Args:
        device: Open.
        gain: Of its motors.
        weight: In N (N m).
    """

    def __init__(self, device: SimulatedDevice, gain: Vector, weight: float) -> None:
        super().__init__(device)
        self._gain, self._weight = gain, weight
        self._hung = [0.0] * device.axes

    def listen(self, line: str) -> None:
        """Do what a message to the user says."""
        if line.startswith("axis") and "weight" in line:
            axis = int(line.split(":")[0].removeprefix("axis ")) - 1
            self._hung[axis] = self._weight if "Hang the weight" in line else 0.0

    def stamps(self) -> tuple[int, int] | None:
        """Return those of the device."""
        return self._device.stamps()

    def acting(self, force: Vector) -> Vector:
        """Return a force with that of the weight: the motor gives its gain times as much."""
        both = zip(force, self._hung, self._gain, strict=True)
        return tuple([commanded + weight / gain for commanded, weight, gain in both])


@dataclass(frozen=True)
class Case:
    """A device to be identified.

    Attributes:
        model: With its truth.
        plan: How it is identified.
    """

    model: Any
    plan: Plan


def draw(seed: int) -> Case:
    """Return the device of a seed: every fourth is a five-bar, the others have one axis."""
    rng = random.Random(seed)

    def spread(middle: float, factor: float) -> float:
        return middle * math.exp(math.log(factor) * rng.uniform(-1.0, 1.0))

    axes = 2 if seed % 4 == 1 else 1
    step = spread(1.2e-3, 2.0) if axes == 2 else spread(3e-5, 2.0)
    yields = rng.random() < 0.5
    presliding = tuple(rng.uniform(SEEN, 5.0) * step if yields else 0.0 for _ in range(axes))
    gain = tuple(rng.uniform(0.8, 1.2) for _ in range(axes))
    delay = rng.choice((0.0, rng.uniform(2e-5, 2e-4)))
    b, f, m = (1e-3, 4e-3, 1e-4) if axes == 2 else (0.27, 0.12, 0.075)
    damping = tuple(spread(b, 2.5) for _ in range(axes))
    friction = tuple(spread(f, 2.5) for _ in range(axes))
    inertia = spread(m, 1.5)
    truth: dict[str, Any] = {
        "damping": damping,
        "friction": friction,
        "presliding": presliding,
        "resolution": (step,) * axes,
        "gain": gain,
        "write_delay": delay,
        "lag": rng.choice((0.0, rng.uniform(*RESOLVABLE_LAGS))),
        "random": True,
        "seed": seed,
    }
    stated: dict[str, Any] = {"substep": SUBSTEP, "write_delay": delay, "watchdog": "reporting"}
    if axes == 2:
        arm = FiveBar(inertia=inertia, truth=TrueJoints(**truth), **stated)
        return Case(arm, ARM)
    knob = PhantomPremium15(mass=inertia, truth=TrueAxes(**truth), **stated)
    return Case(knob, KNOB)
