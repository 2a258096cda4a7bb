"""A simulated device with independent axes, and the hand on it."""

import math
from typing import TYPE_CHECKING

from forcebound.compiled import jit
from forcebound.devices.extended import advance_extended
from forcebound.devices.motor import Motor
from forcebound.devices.plant import advance, quantise
from forcebound.devices.stated import per_axis
from forcebound.devices.true_values import TrueAxes, true_axes, true_value
from forcebound.devices.truth import Truth
from forcebound.messages.packets import Vector
from forcebound.operators import Operator
from forcebound.operators.no_hand import NoHand

if TYPE_CHECKING:
    from forcebound.devices.phantom import PhantomPremium15


class SimulatedDevice:
    """A device with a hand on it, whose time is that of the reads and writes.

    It starts at rest at the hand's first target and rests there until :meth:`engage`. Every read
    and write first integrates to the given time, under the force that was held meanwhile. A
    written force acts after the write delay; one that is too old is dropped at the very instant it
    gets too old, as the watchdog of a real device's firmware does.
    """

    kinematics: None = None  # readings are positions, forces are forces

    def __init__(
        self, parameters: "PhantomPremium15", operator: Operator | None, hold_limit: float
    ) -> None:
        operator = NoHand() if operator is None else operator
        self._operator = operator
        self._axes, self._saturation = parameters.axes, parameters.saturation
        self._resolution = true_axes(parameters, "resolution")
        self._hand_mass = operator.mass
        self._time_ns: int | None = None
        self._engaged_ns: int | None = None
        self._read_ns = 0
        self._target = self._target_at(0.0)
        self._x = list(self._target)
        self._v = [0.0] * self.axes
        self._work = [0.0] * self.axes
        self._muscle = [0.0] * self.axes
        self._reports_cuts = parameters.watchdog == "reporting"
        self._reading_at_cut = self._reading()
        self._set_motor(parameters, hold_limit)
        self._set_plant(parameters)

    def _set_motor(self, parameters: "PhantomPremium15", hold_limit: float) -> None:
        truth = parameters.truth or TrueAxes()
        self._gain = 1.0 + parameters.gain_error if truth.gain is None else truth.gain
        self._compensation = tuple([-w for w in per_axis(parameters.weight, self.axes)])
        self._scales = self._gain != 1.0 or any(self._compensation)
        self._motor = Motor(parameters, truth, hold_limit, self._told((0.0,) * self.axes))

    def _set_plant(self, parameters: "PhantomPremium15") -> None:
        hand, mass = self._operator, parameters.mass + self._operator.mass
        damping, friction, presliding, weight = (
            true_axes(parameters, name) for name in ("damping", "friction", "presliding", "weight")
        )
        self._constants = [
            (mass, b, f, hand.stiffness, hand.damping)
            for b, f in zip(damping, friction, strict=True)
        ]
        lag = true_value(parameters, "lag")
        self._extras = [(w, lag, z) for w, z in zip(weight, presliding, strict=True)]
        self._is_extended = any(map(any, self._extras))
        self._bristle = [0.0] * self.axes
        self._motor_force = list(self._motor.force)
        self._substep = parameters.substep
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

    @property
    def axes(self) -> int:
        """Number of axes; see :class:`forcebound.devices.Device`."""
        return self._axes

    def engage(self, time_ns: int) -> None:
        """Let the hand begin its motion; see :class:`forcebound.devices.Device`."""
        self._advance_to(time_ns)
        if self._engaged_ns is None:
            self._engaged_ns = time_ns

    def read(self, time_ns: int) -> Vector:
        """Return the encoder readings; see :class:`forcebound.devices.Device`."""
        self._advance_to(time_ns)
        self._read_ns = time_ns
        return self._reading()

    def write(self, time_ns: int, force: Vector) -> Vector:
        """Hold ``force`` from now on; see :class:`forcebound.devices.Device`."""
        self._advance_to(time_ns)
        magnitude = math.hypot(*force)
        if not magnitude <= self._saturation:
            scale = self._saturation / magnitude if math.isfinite(magnitude) else 0.0
            force = tuple([scale * f if math.isfinite(f) else 0.0 for f in force])
        self._motor.write(time_ns, self._told(force))
        return force

    def set_hold_limit(self, seconds: float) -> None:
        """Set the hold limit; see :class:`forcebound.devices.DeviceExtras`."""
        self._motor.set_hold_limit(seconds)

    def cut(self) -> tuple[int, Vector] | None:
        """Return the reported cut; see :class:`forcebound.devices.DeviceExtras`."""
        cut_ns = self._motor.cut_ns if self._reports_cuts else None
        return None if cut_ns is None else (cut_ns, self._reading_at_cut)

    def stamps(self) -> tuple[int, int]:
        """Return the last stamps; see :class:`forcebound.devices.DeviceExtras`."""
        return self._read_ns, self._motor.effect_ns

    def close(self) -> None:
        """Do nothing: it holds no resource; see :class:`forcebound.devices.Device`."""

    def truth(self) -> Truth:
        """Return the ground truth; see :class:`Truth`."""
        hand_mass = self._hand_mass
        energy = 0.0
        for work, v in zip(self._work, self._v, strict=True):
            energy += work - 0.5 * hand_mass * v * v
        return Truth(tuple(self._x), tuple(self._v), tuple(self._muscle), energy)

    def _reading(self) -> Vector:
        return tuple([quantise(x, step) for x, step in zip(self._x, self._resolution, strict=True)])

    def _told(self, force: Vector) -> Vector:
        """What the motor gives for a force of a write, in N, once its lag has passed."""
        if not self._scales:
            return force
        total = zip(force, self._compensation, strict=True)
        return tuple([self._gain * (f + c) for f, c in total])

    def _target_at(self, elapsed: float) -> Vector:
        target, axes = self._operator.target(elapsed), self._axes
        return target if len(target) == axes else (target + (0.0,) * axes)[:axes]

    def _advance_to(self, time_ns: int) -> None:
        if self._time_ns is None:
            self._time_ns = time_ns
        if time_ns <= self._time_ns:
            return
        motor = self._motor
        while motor.next_ns < time_ns:
            self._hold_until(motor.next_ns)
            if motor.change():
                self._reading_at_cut = self._reading()
        self._hold_until(time_ns)

    def _hold_until(self, time_ns: int) -> None:
        assert self._time_ns is not None
        duration = (time_ns - self._time_ns) * 1e-9
        if duration == 0.0:
            return
        self._time_ns = time_ns
        end = self._target
        if self._engaged_ns is not None:
            end = self._target_at((time_ns - self._engaged_ns) * 1e-9)
        for axis in range(len(end)):
            self._move(axis, end[axis], duration)
        self._target = end

    def _move(self, axis: int, target_end: float, duration: float) -> None:
        if not self._is_extended:
            self._x[axis], self._v[axis], self._work[axis], self._muscle[axis] = self._advance(
                self._x[axis],
                self._v[axis],
                self._work[axis],
                self._target[axis],
                target_end,
                duration,
                self._substep,
                self._motor.force[axis],
                *self._constants[axis],
            )
            return
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
            self._target[axis],
            target_end,
            duration,
            self._substep,
            self._motor.force[axis],
            *self._extras[axis],
            *self._constants[axis],
        )
