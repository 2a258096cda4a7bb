"""The body of a device with independent axes: a plant for each, in one hand."""

import math
from typing import TYPE_CHECKING

from forcebound.compiled import jit
from forcebound.devices.extended import advance_extended
from forcebound.devices.plant import advance, quantise
from forcebound.devices.simulated import pad
from forcebound.devices.stated import per_axis
from forcebound.devices.true_values import true_axes, true_value
from forcebound.devices.truth import Truth
from forcebound.messages.packets import Vector
from forcebound.operators import Operator

if TYPE_CHECKING:
    from forcebound.devices.phantom import PhantomPremium15


class AxesBody:
    """A mass, moved along axes that know nothing of each other; see ``Body``."""

    kinematics: None = None

    def __init__(self, model: "PhantomPremium15", operator: Operator) -> None:
        axes = model.axes
        mass = model.mass + operator.mass
        damping, friction, presliding, weight = (
            true_axes(model, name) for name in ("damping", "friction", "presliding", "weight")
        )
        self.compensation: Vector = tuple([-w for w in per_axis(model.weight, axes)])
        self._resolution = true_axes(model, "resolution")
        self._hand_mass = operator.mass
        self._x = list(pad(operator.target(0.0), axes))
        self._v, self._work, self._muscle, self._bristle = ([0.0] * axes for _ in range(4))
        self._motor_force = list(self.compensation)
        self._constants = [
            (mass, b, f, operator.stiffness, operator.damping)
            for b, f in zip(damping, friction, strict=True)
        ]
        self._sound = (friction, presliding)
        self._weak_spot = None if model.truth is None else model.truth.weak_spot
        lag = true_value(model, "lag")
        self._extras = [(w, lag, z) for w, z in zip(weight, presliding, strict=True)]
        self._is_extended = any(map(any, self._extras))
        self._substep = model.substep
        for f, z in zip(friction, presliding, strict=True):
            if f > 0.0 and z > 0.0:  # an eighth of a radian of the oscillation on the bristle
                self._substep = min(self._substep, 0.125 * math.sqrt(mass * z / f))
        self._advance, self._advance_extended = jit(advance), jit(advance_extended)
        # Compile, or load from the cache, before time matters.
        rest = (0.0, 0.0, 1e-3, self._substep, 0.0)  # target, its end, duration, substep, force
        if self._is_extended:
            start = (0.0, 0.0, 0.0, 0.0, 0.0)
            self._advance_extended(*start, *rest, *self._extras[0], *self._constants[0])
        else:
            self._advance(0.0, 0.0, 0.0, *rest, *self._constants[0])

    def reading(self) -> Vector:
        """Return the quantised positions; see ``Body``."""
        return tuple([quantise(x, step) for x, step in zip(self._x, self._resolution, strict=True)])

    def truth(self) -> Truth:
        """Return the ground truth; see :class:`Truth`."""
        hand_mass = self._hand_mass
        energy = 0.0
        for work, v in zip(self._work, self._v, strict=True):
            energy += work - 0.5 * hand_mass * v * v
        return Truth(tuple(self._x), tuple(self._v), tuple(self._muscle), energy)

    def move(self, target: Vector, target_end: Vector, duration: float, told: Vector) -> None:
        """Move every axis; see ``Body``."""
        if self._weak_spot is not None:
            self._weaken(self._weak_spot.share_at(self._x))
        if self._is_extended:
            self._move_extended(target, target_end, duration, told)
            return
        for axis in range(len(target)):
            self._x[axis], self._v[axis], self._work[axis], self._muscle[axis] = self._advance(
                self._x[axis],
                self._v[axis],
                self._work[axis],
                target[axis],
                target_end[axis],
                duration,
                self._substep,
                told[axis],
                *self._constants[axis],
            )

    def _weaken(self, share: float) -> None:
        """Let this share of the friction be left, and of the way over which it yields."""
        friction, presliding = self._sound
        self._constants = [
            (mass, b, share * f, stiffness, damping)
            for (mass, b, _, stiffness, damping), f in zip(self._constants, friction, strict=True)
        ]
        self._extras = [
            (w, lag, share * z) for (w, lag, _), z in zip(self._extras, presliding, strict=True)
        ]

    def _move_extended(
        self, target: Vector, target_end: Vector, duration: float, told: Vector
    ) -> None:
        for axis in range(len(target)):
            (
                self._x[axis],
                self._v[axis],
                self._work[axis],
                self._bristle[axis],
                self._motor_force[axis],
                self._muscle[axis],
            ) = self._advance_extended(
                self._x[axis],
                self._v[axis],
                self._work[axis],
                self._bristle[axis],
                self._motor_force[axis],
                target[axis],
                target_end[axis],
                duration,
                self._substep,
                told[axis],
                *self._extras[axis],
                *self._constants[axis],
            )
