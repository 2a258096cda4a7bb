"""The verdict: what the certified law will show on an identified device, and what limits it.

A reading goes along a prescribed way, at 100 mm/s to 2 mm behind a surface, and rests there, while
the environment asks for more force than the law will ever give. What the law lets through, over
these 2 mm, is the stiffness that a wall can have on this device: no device is simulated, and no
hand. Repeated with one number better, this shows which number limits it.
"""

import dataclasses
import math
from typing import Any, NamedTuple

import numpy as np

from forcebound.axes import AxisKind, at_lever
from forcebound.graph.servo import ServoSettings, dissipation_of
from forcebound.haptics.devices import Device, DeviceModel
from forcebound.haptics.laws.dissipation import per_axis
from forcebound.lab.identification.rig import Floats
from forcebound.messages.packets import Vector
from forcebound.nodes.bounded_device import BoundedDevice

SPEED, DEPTH = 0.1, 2e-3  # m/s, m
RESTING = 0.2  # s

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

    def __init__(self, model: DeviceModel, start: Floats, turn: Floats, step: Floats) -> None:
        self.kinematics, self.axes = model.kinematics(), model.axes
        self._start, self._turn, self._step = start, turn, step

    def read(self, time_ns: int) -> Vector:
        """Return where the way is now, in steps of the encoder."""
        way = self._start + min(1.0, time_ns * 1e-9 * SPEED / DEPTH) * self._turn
        step = np.where(self._step > 0.0, self._step, 1.0)
        return tuple(np.where(self._step > 0.0, step * np.round(way / step), way).tolist())

    def write(self, time_ns: int, force: Vector) -> Vector:
        """Take any force."""
        return force


def displayed_stiffness(model: DeviceModel, rate: float, start: Vector) -> float:
    """Return the largest stiffness that the law ``certified`` displays after the press, in N/m.

    Of angles in N m/rad, pressed by as much at a lever of 0.1 m.

    Args:
        model: What the device states.
        rate: Of the servo, in Hz.
        start: Readings at the surface.
    """
    arm, servo = model.kinematics(), ServoSettings(rate=rate)
    axes = np.eye(len(start if arm is None else arm.position(start)))
    # Row i: the readings by which the tip moves along its coordinate i.
    jacobian = (
        axes if arm is None else np.array([arm.torque(start, tuple(e)) for e in axes.tolist()])
    )
    depth = at_lever(DEPTH, "m", pressed_kind(model))
    turn = np.linalg.lstsq(jacobian, depth * axes[0], rcond=None)[0]
    dissipation = dissipation_of(model, servo)
    step = np.array(per_axis("resolution", dissipation.resolution, len(start)))
    device = BoundedDevice(
        _Prescribed(model, np.array(start), turn, step), servo.law, dissipation, learns=False
    )
    device.begin()
    lever = float(np.linalg.norm(jacobian[0]))
    force = tuple((0.99 * model.saturation / lever * axes[0]).tolist())
    for tick in range(round((DEPTH / SPEED + RESTING) * rate)):
        written = device.write(tick * servo.period_ns, force, 1.0)
    return math.hypot(*written.applied) / depth


def pressed_kind(model: DeviceModel) -> AxisKind:
    """Return the kind of the axis along which the press goes: the first."""
    return model.named_axes[0].kind


class Verdict(NamedTuple):
    """Displayed stiffness of the law ``certified`` on a device."""

    stiffness: float  # N/m; of angles N m/rad
    kind: AxisKind  # of the axes
    gains: dict[str, float]  # times as stiff on a device with a better number, see BETTER
    limit: str  # the number with the largest gain


def verdict(model: Any, rate: float, start: Vector) -> Verdict:
    """Return that of a device; arguments of `displayed_stiffness`."""

    def shown(**changed: object) -> float:
        return displayed_stiffness(dataclasses.replace(model, **changed), rate, start)

    now = shown()
    gains = {}
    for name, (factor, _) in BETTER.items():
        value = getattr(model, name, None) or 0.0
        if np.any(value):
            better = (
                tuple(factor * v for v in value) if isinstance(value, tuple) else factor * value
            )
            gains[name] = shown(**{name: better}) / (now or math.inf)
    return Verdict(now, pressed_kind(model), gains, max(gains, key=gains.__getitem__))
