"""The body of a device with independent axes: a plant for each, in one hand."""

import math
from struct import Struct
from typing import TYPE_CHECKING

import numpy as np

from forcebound.compiled import jit
from forcebound.devices.extended import advance_extended
from forcebound.devices.kinematics import Floats
from forcebound.devices.plant import advance, quantise
from forcebound.devices.simulated import pad
from forcebound.devices.stated import per_axis
from forcebound.devices.true_values import true_axes, true_value
from forcebound.devices.truth import Truth
from forcebound.messages.packets import Vector
from forcebound.operators import Operator

if TYPE_CHECKING:
    from forcebound.devices.phantom import PhantomPremium15

X, V, WORK, MUSCLE, BRISTLE, MOTOR, READING = 0, 1, 2, 3, 4, 5, 6  # rows of ``state``
TARGET, TARGET_END, TOLD = 0, 1, 2  # of ``inputs``
DAMPING, FRICTION, PRESLIDING, WEIGHT, RESOLUTION = 0, 1, 2, 3, 4  # of ``plant``
MASS, HAND_MASS, STIFFNESS, HAND_DAMPING = 0, 1, 2, 3  # of ``hand``


def advance_axes(
    state: Floats,
    inputs: Floats,
    plant: Floats,
    hand: Floats,
    duration: float,
    substep: float,
    lag: float,
    is_extended: bool,
) -> float:
    """Move every axis, one column of the arrays, by ``duration`` s.

    Args:
        state: Of each axis: position, velocity, work of the hand, mean force of its spring and
            damper, bristle, force of the motor, and the encoder's reading.
        inputs: Target at the start and at the end, and what the motor is told.
        plant: Numbers of each axis.
        hand: Mass of device and hand, mass, stiffness and damping of the hand.
        duration: In s, > 0.
        substep: Longest integration step, in s.
        lag: Time constant of the motor, in s.
        is_extended: Whether presliding, lag or weight matter.

    Returns:
        Energy that has flowed from the hand into the device, in J.
    """
    energy = 0.0
    for i in range(state.shape[1]):
        x, v, work = state[X, i], state[V, i], state[WORK, i]
        target, target_end, told = inputs[TARGET, i], inputs[TARGET_END, i], inputs[TOLD, i]
        damping, friction = plant[DAMPING, i], plant[FRICTION, i]
        if is_extended:
            x, v, work, state[BRISTLE, i], state[MOTOR, i], state[MUSCLE, i] = advance_extended(
                x,
                v,
                work,
                state[BRISTLE, i],
                state[MOTOR, i],
                target,
                target_end,
                duration,
                substep,
                told,
                plant[WEIGHT, i],
                lag,
                plant[PRESLIDING, i],
                hand[MASS],
                damping,
                friction,
                hand[STIFFNESS],
                hand[HAND_DAMPING],
            )
        else:
            x, v, work, state[MUSCLE, i] = advance(
                x,
                v,
                work,
                target,
                target_end,
                duration,
                substep,
                told,
                hand[MASS],
                damping,
                friction,
                hand[STIFFNESS],
                hand[HAND_DAMPING],
            )
        state[X, i], state[V, i], state[WORK, i] = x, v, work
        state[READING, i] = quantise(x, plant[RESOLUTION, i])
        energy += work - 0.5 * hand[HAND_MASS] * v * v
    return energy


class AxesBody:
    """A mass, moved along axes that know nothing of each other; see ``Body``."""

    kinematics: None = None

    def __init__(self, model: "PhantomPremium15", operator: Operator) -> None:
        axes = model.axes
        mass = model.mass + operator.mass
        names = ("damping", "friction", "presliding", "weight", "resolution")
        self._plant = np.array([true_axes(model, name) for name in names])
        self._sound = self._plant[FRICTION : PRESLIDING + 1].copy()
        self._weak_spot = None if model.truth is None else model.truth.weak_spot
        self._hand = np.array([mass, operator.mass, operator.stiffness, operator.damping])
        self._lag = true_value(model, "lag")
        self._is_extended = self._lag > 0.0 or bool(self._plant[PRESLIDING : WEIGHT + 1].any())
        self._substep = model.substep
        for f, z in self._sound.T.tolist():
            if f > 0.0 and z > 0.0:  # an eighth of a radian of the oscillation on the bristle
                self._substep = min(self._substep, 0.125 * math.sqrt(mass * z / f))
        self.compensation: Vector = tuple([-w for w in per_axis(model.weight, axes)])
        start = np.array(pad(operator.target(0.0), axes), dtype=np.float64)
        self._state = np.zeros((READING + 1, axes))
        self._state[X], self._state[MOTOR] = start, self.compensation
        for axis, step in enumerate(self._plant[RESOLUTION].tolist()):
            self._state[READING, axis] = quantise(start[axis], step)
        self._energy = 0.0
        self._inputs = np.zeros((TOLD + 1, axes))
        # numpy takes longer to set or get a number
        self._set_inputs = Struct(f"{self._inputs.size}d").pack_into
        self._get_row = Struct(f"{axes}d").unpack_from
        self._rows, self._input_view = [row.data for row in self._state], self._inputs.data
        self._advance = jit(advance_axes)
        # Compile, or load from the cache, before time matters.
        unmoved = self._state.copy()
        self.move((0.0,) * axes, (0.0,) * axes, 1e-3, (0.0,) * axes)
        self._state[:], self._energy = unmoved, 0.0

    def reading(self) -> Vector:
        """Return the quantised positions; see ``Body``."""
        return self._get_row(self._rows[READING])

    def truth(self) -> Truth:
        """Return the ground truth; see :class:`Truth`."""
        get, rows = self._get_row, self._rows
        return Truth(get(rows[X]), get(rows[V]), get(rows[MUSCLE]), self._energy)

    def kinetic_energy(self) -> float:
        """Return that of the device alone; see ``Body``."""
        mass = self._hand[MASS] - self._hand[HAND_MASS]
        return 0.5 * float(mass * (self._state[V] @ self._state[V]))

    def move(self, target: Vector, target_end: Vector, duration: float, told: Vector) -> None:
        """Move every axis; see ``Body``."""
        if self._weak_spot is not None:
            share = self._weak_spot.share_at(self._state[X].tolist())
            self._plant[FRICTION : PRESLIDING + 1] = share * self._sound
        self._set_inputs(self._input_view, 0, *target, *target_end, *told)
        self._energy = self._advance(
            self._state,
            self._inputs,
            self._plant,
            self._hand,
            duration,
            self._substep,
            self._lag,
            self._is_extended,
        )
