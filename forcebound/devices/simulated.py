"""A simulated device with independent axes, and the hand on it."""

import math
from typing import Protocol

from forcebound.compiled import jit
from forcebound.devices import DeviceModel
from forcebound.devices.motor import Motor, MotorModel
from forcebound.devices.plant import advance, quantise
from forcebound.devices.truth import Truth
from forcebound.messages.packets import Vector
from forcebound.operators import Operator
from forcebound.operators.no_hand import NoHand


class PlantModel(DeviceModel, MotorModel, Protocol):
    """Parameters of a simulated device: those of any device, and what only the plant knows."""

    @property
    def mass(self) -> float:
        """Apparent mass of the device, in kg."""
        ...

    @property
    def substep(self) -> float:
        """Longest integration step, in s."""
        ...


class SimulatedDevice:
    """A device with a hand on it, whose time is that of the reads and writes.

    It starts at rest at the hand's first target and rests there until :meth:`engage`. Every read
    and write first integrates to the given time, under the force that was held meanwhile. A
    written force acts after the write delay; one that is too old is dropped at the very instant it
    gets too old, as the watchdog of a real device's firmware does.
    """

    kinematics: None = None  # readings are positions, forces are forces

    def __init__(
        self, parameters: PlantModel, operator: Operator | None, hold_limit: float
    ) -> None:
        operator = NoHand() if operator is None else operator
        self._operator = operator
        self._axes, self._resolution = parameters.axes, parameters.resolution
        self._saturation, self._substep = parameters.saturation, parameters.substep
        self._hand_mass = operator.mass
        self._constants = (
            parameters.mass + operator.mass,
            parameters.damping,
            parameters.friction,
            operator.stiffness,
            operator.damping,
        )
        self._advance = jit(advance)
        self._time_ns: int | None = None
        self._engaged_ns: int | None = None
        self._motor = Motor(parameters, hold_limit)
        self._reports_cuts = parameters.watchdog == "reporting"
        self._reading_at_cut: Vector = (0.0,) * self.axes
        self._target = self._target_at(0.0)
        self._x = list(self._target)
        self._v = [0.0] * self.axes
        self._work = [0.0] * self.axes
        self._muscle = [0.0] * self.axes
        self._read_ns = 0
        # Compile, or load from the cache, before time matters.
        self._advance(0.0, 0.0, 0.0, 0.0, 0.0, 1e-3, self._substep, 0.0, *self._constants)

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
        self._motor.write(time_ns, force)
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
        resolution = self._resolution
        return tuple([quantise(x, resolution) for x in self._x])

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
            self._x[axis], self._v[axis], self._work[axis], self._muscle[axis] = self._advance(
                self._x[axis],
                self._v[axis],
                self._work[axis],
                self._target[axis],
                end[axis],
                duration,
                self._substep,
                self._motor.force[axis],
                *self._constants,
            )
        self._target = end
