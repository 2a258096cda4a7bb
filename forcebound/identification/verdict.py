"""The verdict: what the certified law will show on an identified device, and what limits it.

A reading goes along a prescribed way, at 100 mm/s to 2 mm behind a surface, and rests there, while
the environment asks for more force than the law will ever give. What the law lets through, over
these 2 mm, is the stiffness that a wall can have on this device: no device is simulated, and no
hand. Done again with one number better than it was measured, this says what measuring it is worth.
"""

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from forcebound.devices import Device, DeviceModel, Kinematics
from forcebound.messages.packets import Vector
from forcebound.nodes.bounded_device import BoundedDevice
from forcebound.nodes.servo import ServoSettings, dissipation_of

SPEED, DEPTH = 0.1, 2e-3  # m/s, m
RESTING = 0.2  # s
SMALL = 1e-6  # rad, to find the direction in which the tip moves

#: By how many times a number is better on a better device, and what that is called.
BETTER = {
    **dict.fromkeys(("damping", "friction", "saturation"), (1.2, "a fifth more of it")),
    "largest_speed": (0.8, "a fifth less of it"),
    **dict.fromkeys(
        ("presliding", "resolution", "write_delay", "gain_error", "lag", "weight_error"),
        (0.0, "without it"),
    ),
}


class _Prescribed(Device):
    """A device whose readings go along a way of their own, whatever the force."""

    def __init__(self, start: Vector, end: Vector, step: Vector, kinematics: Any) -> None:
        self.kinematics = kinematics
        self.axes = len(start)
        self._start, self._end, self._step = start, end, step

    def read(self, time_ns: int) -> Vector:
        """Return where the way is now, in steps of the encoder."""
        share = min(1.0, time_ns * 1e-9 * SPEED / DEPTH)
        way = [a + share * (b - a) for a, b in zip(self._start, self._end, strict=True)]
        steps = zip(way, self._step, strict=True)
        return tuple([step * round(x / step) if step else x for x, step in steps])

    def write(self, time_ns: int, force: Vector) -> Vector:
        """Take any force."""
        return force


def displayed_stiffness(
    model: DeviceModel,
    servo: ServoSettings,
    start: Vector,
    kinematics: Kinematics | None,
) -> float:
    """Return the largest stiffness that a law displays at the end of the press, in N/m.

    Args:
        model: What the device states.
        servo: With the law.
        start: Readings at the surface.
        kinematics: Of an arm.
    """
    end, normal = _way(start, kinematics)
    dissipation = dissipation_of(model, servo)
    step = dissipation.of_axes("resolution", len(start))
    device = BoundedDevice(
        _Prescribed(start, end, step, kinematics), servo.law, dissipation, learns=False
    )
    device.begin()
    lever = 1.0 if kinematics is None else math.hypot(*kinematics.torque(start, normal))
    wanted = tuple([0.99 * model.saturation / lever * n for n in normal])
    ticks = round((DEPTH / SPEED + RESTING) * servo.rate)
    for tick in range(ticks):
        written = device.write(tick * servo.period_ns, wanted, 1.0)
    return math.hypot(*written.applied) / DEPTH


def _way(start: Vector, kinematics: Kinematics | None) -> tuple[Vector, Vector]:
    """Readings at the end of the press, and the direction in which the tip goes."""
    if kinematics is None:
        normal = (1.0, *(0.0,) * (len(start) - 1))
        return tuple([x + DEPTH * n for x, n in zip(start, normal, strict=True)]), normal
    here = np.array(kinematics.position(start))
    columns = []
    for joint in range(len(start)):
        moved = list(start)
        moved[joint] += SMALL
        columns.append((np.array(kinematics.position(tuple(moved))) - here) / SMALL)
    jacobian = np.stack(columns, axis=1)
    target = np.zeros(len(here))
    target[0] = DEPTH  # along the first coordinate of the tip
    turn = np.linalg.lstsq(jacobian, target, rcond=None)[0]
    return tuple((np.array(start) + turn).tolist()), tuple((target / DEPTH).tolist())


@dataclass(frozen=True)
class Verdict:
    """What the law ``certified`` shows.

    Attributes:
        stiffness: In N/m.
        gains: By number: how many times stiffer ``certified`` would be if the number had been found
            without any uncertainty (``measured``), and on a better device (``built``, see
            :data:`BETTER`).
        limit: The number with the largest gain of a better device.
    """

    stiffness: float
    gains: Mapping[str, Mapping[str, float]]
    limit: str


def verdict(
    model: Any,
    estimates: Mapping[str, float | Vector],
    rate: float,
    start: Vector,
    kinematics: Kinematics | None,
) -> Verdict:
    """Return what the law ``certified`` shows on a device.

    Args:
        model: With the bounds that were found.
        estimates: What was found of each number, without its uncertainty.
        rate: Of the servo, in Hz.
        start: Readings in the middle of the workspace.
        kinematics: Of an arm.
    """

    def shown(changed: Mapping[str, Any]) -> float:
        other = dataclasses.replace(model, **changed)
        return displayed_stiffness(other, ServoSettings(rate=rate), start, kinematics)

    now = shown({})
    base = now or math.inf
    gains: dict[str, dict[str, float]] = {}
    for name, (factor, _) in BETTER.items():
        value = getattr(model, name)
        if value is None or not np.any(value):
            continue
        gains[name] = {"built": shown({name: _times(value, factor)}) / base}
        if name in estimates:
            gains[name]["measured"] = shown({name: estimates[name]}) / base
    return Verdict(now, gains, max(gains, key=lambda name: gains[name]["built"]))


def _times(value: float | Vector, factor: float) -> float | Vector:
    return tuple([factor * v for v in value]) if isinstance(value, tuple) else factor * value
