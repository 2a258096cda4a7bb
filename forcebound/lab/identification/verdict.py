"""The verdict: what the certified law will show on an identified device, and what limits it.

A reading goes along a prescribed way, at 100 mm/s to 2 mm behind a surface, or 20 steps of a coarse
encoder, and rests there, while the environment asks for more force than the law will ever give.
What the law lets through, over this depth, is the stiffness that a wall can have on this device: no
device is simulated, and no hand. Repeated with one number better, this shows which number limits
it.
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
STEPS = 20  # of the encoder, at least
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

    def __init__(
        self, model: DeviceModel, start: Floats, turn: Floats, step: Floats, seconds: float
    ) -> None:
        self.kinematics, self.axes = model.kinematics(), model.axes
        self._start, self._turn, self._step, self._seconds = start, turn, step, seconds

    def read(self, time_ns: int) -> Vector:
        """Return where the way is now, in steps of the encoder."""
        way = self._start + min(1.0, time_ns * 1e-9 / self._seconds) * self._turn
        step = np.where(self._step > 0.0, self._step, 1.0)
        return tuple(np.where(self._step > 0.0, step * np.round(way / step), way).tolist())

    def write(self, time_ns: int, force: Vector) -> Vector:
        """Take any force."""
        return force


class Press(NamedTuple):
    """A press: the stiffness that the law ``certified`` displays after it, and how deep it went."""

    stiffness: float  # N/m; of angles N m/rad
    depth: float  # m, rad


def press(model: DeviceModel, rate: float, start: Vector) -> Press:
    """Return the press with the largest force; on angles by as much at a lever of 0.1 m.

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
    moves = np.abs(turn) > 1e-9 * np.abs(turn).max()
    deeper = max(1.0, STEPS * float((step[moves] / np.abs(turn[moves])).min()))
    seconds = deeper * DEPTH / SPEED
    device = BoundedDevice(
        _Prescribed(model, np.array(start), deeper * turn, step, seconds),
        servo.law,
        dissipation,
        learns=False,
    )
    device.begin()
    lever = float(np.linalg.norm(jacobian[0]))
    force = tuple((0.99 * model.saturation / lever * axes[0]).tolist())
    for tick in range(round((seconds + RESTING) * rate)):
        written = device.write(tick * servo.period_ns, force, 1.0)
    return Press(math.hypot(*written.applied) / (deeper * depth), deeper * depth)


def pressed_kind(model: DeviceModel) -> AxisKind:
    """Return the kind of the axis along which the press goes: the first."""
    return model.named_axes[0].kind


class Verdict(NamedTuple):
    """Displayed stiffness of the law ``certified`` on a device."""

    stiffness: float  # N/m; of angles N m/rad
    depth: float  # m, rad; of the press
    kind: AxisKind  # of the axes
    better: dict[str, float]  # stiffness of a device with a better number, see BETTER
    limit: str  # the number with the largest of them


def verdict(model: Any, rate: float, start: Vector) -> Verdict:
    """Return that of a device; arguments of `press`."""
    now, better = press(model, rate, start), {}
    for name, (factor, _) in BETTER.items():
        value = getattr(model, name, None) or 0.0
        if np.any(value):
            changed = (
                tuple(factor * v for v in value) if isinstance(value, tuple) else factor * value
            )
            one = press(dataclasses.replace(model, **{name: changed}), rate, start)
            better[name] = one.stiffness * one.depth / now.depth
    limit = max(better, key=better.__getitem__)
    return Verdict(now.stiffness, now.depth, pressed_kind(model), better, limit)
