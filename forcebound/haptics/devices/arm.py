"""The body of a simulated arm: joints, kinematics, a hand at the tip."""

from struct import Struct
from typing import TYPE_CHECKING

import numpy as np

from forcebound.errors import DeviceError
from forcebound.haptics.devices import Kinematics, Truth
from forcebound.haptics.devices.joints import ANGLE, FRICTION, INERTIA, SPEED, arm_kernel
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
        if operator.gap >= 0.0:
            raise DeviceError("a wall in place of the hand needs a device of independent axes")
        start = pad(operator.target(0.0), axes)
        angles = stated.angles(start)
        if angles is None:
            raise DeviceError(f"the hand begins at {start} m, where the arm does not reach")
        self.kinematics: Kinematics | None = stated.kinematics()  # asked about readings
        self._true_kinematics = kinematics = stated.kinematics()  # about true angles
        self.compensation: Vector = (0.0,) * axes
        self._resolution, self._lag, self._substep = true.resolution, true.lag, stated.substep
        inertia = (stated.inertia,) * axes
        self._plant = np.array([inertia, true.damping, true.friction, true.presliding])
        self._sound, self._weak_spot = self._plant[FRICTION:].copy(), true.weak_spot
        self._hand = np.array([operator.mass, operator.stiffness, operator.damping])
        self._geometry = np.array(kinematics.geometry)
        self._joints = np.zeros((4, axes))
        self._joints[ANGLE] = angles
        self._inputs = np.zeros((3, axes))
        self._from, self._to, self._commanded = self._inputs
        self._input_view = self._inputs.data
        self._set_inputs = Struct(f"{3 * axes}d").pack_into  # numpy takes longer to set a number
        self._muscle = np.zeros(axes)
        self._energy = 0.0
        self._reading: Vector = ()  # not known since the last move
        self._advance = arm_kernel(kinematics.pose)
        # Compile, or load from the cache, before time matters.
        joints = self._joints.copy()
        self.move(start, start, 1e-3, (0.0,) * axes)
        self._joints[:], self._energy, self._reading = joints, 0.0, ()

    def reading(self) -> Vector:
        if not self._reading:
            angles = zip(self._joints[ANGLE].tolist(), self._resolution, strict=True)
            self._reading = tuple([quantise(x, step) for x, step in angles])
        return self._reading

    def truth(self) -> Truth:
        angles, kinematics = tuple(self._joints[ANGLE].tolist()), self._true_kinematics
        position = kinematics.position(angles)
        velocity = kinematics.velocity(angles, self._joints[SPEED])
        return Truth(position, velocity, tuple(self._muscle.tolist()), self._energy)

    def kinetic_energy(self) -> float:
        return 0.5 * float(self._plant[INERTIA] @ self._joints[SPEED] ** 2)

    def move(self, target: Vector, target_end: Vector, duration: float, commanded: Vector) -> None:
        """Move the joints; DeviceError if the tip comes to where the arm cannot be held."""
        if self._weak_spot is not None:
            share = self._weak_spot.share_at(self._joints[ANGLE].tolist())
            self._plant[FRICTION:] = share * self._sound
        self._set_inputs(self._input_view, 0, *target, *target_end, *commanded)
        self._energy += self._advance(
            self._joints,
            self._plant,
            self._hand,
            self._geometry,
            self._commanded,
            self._from,
            self._to,
            duration,
            self._substep,
            self._lag,
            self._muscle,
        )
        angles = tuple(self._joints[ANGLE].tolist())
        self._reading = ()
        if not self._true_kinematics.is_held(angles):
            where = ", ".join(f"{1e3 * x:.0f} mm" for x in self._true_kinematics.position(angles))
            raise DeviceError(f"the hand has moved the arm to a singular pose, its tip at {where}")
