"""The body of a simulated arm: joints, kinematics, a hand at the tip."""

import math
from collections.abc import Callable
from functools import partial
from struct import Struct
from typing import TYPE_CHECKING

import numpy as np

from forcebound.errors import DeviceError
from forcebound.haptics.devices import Kinematics, Truth, joints
from forcebound.haptics.devices.plant import quantise
from forcebound.haptics.devices.simulated import pad
from forcebound.haptics.devices.true_values import TrueNumbers
from forcebound.haptics.hands import Operator
from forcebound.messages.packets import Vector

if TYPE_CHECKING:
    from forcebound.haptics.devices.arms import StatedJoints


class ArmBody:
    """An arm with a hand at its tip; see ``Body``. Its readings are angles.

    DeviceError if the hand begins where the arm does not reach.
    """

    def __init__(self, stated: "StatedJoints", true: TrueNumbers, operator: Operator) -> None:
        axes = stated.axes
        start = pad(operator.target(0.0), axes)
        angles = stated.angles(start)
        if angles is None:
            raise DeviceError(f"the hand begins at {start} m, where the arm does not reach")
        self.kinematics: Kinematics | None = stated.kinematics()  # asked about readings
        kinematics = stated.geometry()  # of true angles
        self.compensation: Vector = (0.0,) * axes
        self._numbers = numbers = np.zeros((joints.ROWS, axes))
        numbers[joints.ANGLE], numbers[joints.INERTIA] = angles, stated.inertia
        numbers[joints.DAMPING], numbers[joints.RESOLUTION] = true.damping, true.resolution
        self._damping = numbers[joints.DAMPING].copy()
        self._frictions = numbers[joints.FRICTION : joints.PRESLIDING + 1]
        self._frictions[:] = true.friction, true.presliding
        self._sound, self._weak_spot = self._frictions.copy(), true.weak_spot
        numbers[joints.READING] = [quantise(*x) for x in zip(angles, true.resolution, strict=True)]
        numbers[joints.TIP] = kinematics.position(angles)
        numbers[joints.GAP] = math.nan
        numbers[joints.GAP, : len(operator.walls)] = operator.walls
        limits = operator.joint_limits or ((-math.inf, math.inf),) * axes
        numbers[joints.LOWEST], numbers[joints.HIGHEST] = zip(*limits, strict=True)
        self._geometry = None if self.kinematics is not None else kinematics
        hand = (operator.mass, operator.stiffness, operator.damping)
        walls = (not operator.walls, operator.joint_stiffness, operator.joint_damping)
        own = (stated.substep, true.lag)
        self._settings = np.array([*hand, *own, *walls, *kinematics.geometry])
        # numpy takes longer to set or get a number
        data, row = numbers.view(np.uint8).reshape(-1).data, 8 * axes
        self._set_inputs = partial(Struct(f"{3 * axes}d").pack_into, data, joints.TARGET * row)
        get = Struct(f"{axes}d").unpack_from
        self.reading: Callable[[], Vector] = partial(get, data, joints.READING * row)
        self._angles = partial(get, data, joints.ANGLE * row)
        self._speeds = partial(get, data, joints.SPEED * row)
        self._tip = partial(get, data, joints.TIP * row)
        self._tip_speed = partial(get, data, joints.TIP_SPEED * row)
        self._muscle = partial(get, data, joints.MUSCLE * row)
        self._energy = 0.0
        self._advance = joints.arm_kernel(kinematics.pose)
        # Compile, or load from the cache, before time matters.
        unmoved = numbers.copy()
        self.move(start, start, 1e-3, (0.0,) * axes)
        numbers[:], self._energy = unmoved, 0.0

    def truth(self) -> Truth:
        if self._geometry is not None:  # in its joints
            angles = self._angles()
            torques = self._geometry.torque(angles, self._muscle())
            return Truth(angles, self._speeds(), torques, self._energy)
        return Truth(self._tip(), self._tip_speed(), self._muscle(), self._energy)

    def kinetic_energy(self) -> float:
        return 0.5 * float(self._numbers[joints.INERTIA] @ self._numbers[joints.SPEED] ** 2)

    def brake(self, damping: Vector) -> None:
        self._numbers[joints.DAMPING] = self._damping + damping

    def move(self, target: Vector, target_end: Vector, duration: float, commanded: Vector) -> None:
        """Move the joints; DeviceError if the tip comes to where the arm cannot be held."""
        if self._weak_spot is not None:
            share = self._weak_spot.share_at(self._numbers[joints.ANGLE].tolist())
            self._frictions[:] = share * self._sound
        self._set_inputs(*target, *target_end, *commanded)
        energy, is_held = self._advance(self._numbers, self._settings, duration)
        self._energy += energy
        if not is_held:
            where = ", ".join(f"{1e3 * x:.0f} mm" for x in self._tip())
            raise DeviceError(f"the hand has moved the arm to a singular pose, its tip at {where}")
