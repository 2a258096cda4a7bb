r"""The simulated device: a mass with friction in a passive hand, integrated over real time.

How one step works. Over a step ``h`` with mean velocity :math:`\bar v`, the implicit midpoint rule

.. math::

    M (v_1 - v_0) / h = k_h (x_t - \bar x) + b_h (v_t - \bar v) - b \bar v - f_c s - F_d ,
    \qquad \bar v = (v_0 + v_1) / 2 , \quad \bar x = x_0 + h \bar v / 2

is solved for :math:`\bar v` with the friction's sign :math:`s = \mathrm{sgn}\,\bar v`, or
:math:`\bar v = 0` where the other forces cannot overcome it: true stick and slip, no smoothing
(J. J. Moreau's time-stepping, 1988). Multiplying by :math:`h \bar v` shows why this rule and no
other: kinetic energy, losses and the work of hand and motor balance *exactly* in each step, to
rounding, however coarse the step. So a negative energy in an audit is the law's fault and never
the integrator's. Where a step would reverse the velocity it ends at rest instead; that loses
kinetic energy to friction, never adds any.

The energy that the paper's Eq. 1 asks about flows from the hand into the *device*. The hand's own
mass moves with the handle, so the force at the interface is the muscle's (spring and damper) less
what accelerates that mass, and its work is the muscle's less the hand's kinetic energy.

What is left out: the arm's kinematics (axes are independent), gravity, cable compliance, motor
dynamics, cogging. Friction acts on each axis by itself, which loses at least as much as friction
along the path of several axes.
"""

import math
from typing import Protocol

from forcebound.compiled import jit
from forcebound.devices import DeviceModel
from forcebound.devices.truth import Truth
from forcebound.messages.packets import Vector
from forcebound.operators import Operator
from forcebound.operators.no_hand import NoHand


def advance(
    x: float,
    v: float,
    work: float,
    target: float,
    target_end: float,
    duration: float,
    substep: float,
    motor_force: float,
    mass: float,
    damping: float,
    friction: float,
    hand_stiffness: float,
    hand_damping: float,
) -> tuple[float, float, float, float]:
    """Advance one axis by ``duration`` under a constant motor force.

    Args:
        x: Position, in m.
        v: Velocity, in m/s.
        work: Work of the hand's spring and damper so far, in J.
        target: Where the hand wants to be at the start, in m.
        target_end: And at the end; in between it moves evenly.
        duration: In s, > 0.
        substep: Longest integration step, in s.
        motor_force: Held by the motor, in N, positive against positive motion.
        mass: Of device and hand together, in kg.
        damping: Of the device, in N s/m.
        friction: Coulomb friction of the device, in N.
        hand_stiffness: In N/m.
        hand_damping: In N s/m.

    Returns:
        Position, velocity, work, and the mean force of the hand's spring and damper in the last
        step, in N.
    """
    steps = count_steps(duration, substep)
    h = duration / steps
    target_velocity = (target_end - target) / duration
    inertia = 2.0 * mass / h
    impedance = step_impedance(inertia, damping, hand_damping, h, hand_stiffness)
    muscle = 0.0
    for i in range(steps):
        x, v, work, muscle = step(
            x,
            v,
            work,
            target + target_velocity * (i + 0.5) * h,
            target_velocity,
            h,
            motor_force,
            inertia,
            impedance,
            friction,
            hand_stiffness,
            hand_damping,
        )
    return x, v, work, muscle


def count_steps(duration: float, substep: float) -> int:
    """Return in how many equal steps of at most ``substep`` a ``duration`` is integrated."""
    return max(1, math.ceil(duration / substep - 1e-9))


def step_impedance(
    inertia: float, damping: float, hand_damping: float, h: float, hand_stiffness: float
) -> float:
    """Return the force per mean velocity of a step, in N s/m; ``inertia`` is 2 M/h."""
    return inertia + damping + hand_damping + 0.5 * h * hand_stiffness


def step(
    x: float,
    v: float,
    work: float,
    target_middle: float,
    target_velocity: float,
    h: float,
    motor_force: float,
    inertia: float,
    impedance: float,
    friction: float,
    hand_stiffness: float,
    hand_damping: float,
) -> tuple[float, float, float, float]:
    """Advance one axis by one step ``h``; the page above derives it.

    It has no branch that depends on the numbers, so that a sweep can step many simulations side by
    side. ``target_middle`` is the hand's target in the middle of the step, ``inertia`` and
    ``impedance`` are those of :func:`step_impedance`; everything else as in :func:`advance`.
    """
    drive = (
        inertia * v
        + hand_stiffness * (target_middle - x)
        + hand_damping * target_velocity
        - motor_force
    )
    mean = (drive - min(max(drive, -friction), friction)) / impedance
    end = 2.0 * mean - v
    dx = h * mean
    muscle = hand_stiffness * (target_middle - x - 0.5 * dx) + hand_damping * (
        target_velocity - mean
    )
    return x + dx, end if end * mean > 0.0 else 0.0, work + muscle * dx, muscle


def quantise(x: float, resolution: float) -> float:
    """Return the encoder's reading of ``x``, in m; with resolution 0 it is ``x`` itself."""
    if resolution <= 0.0:
        return x
    return math.floor(x / resolution + 0.5) * resolution


class PlantModel(DeviceModel, Protocol):
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
    and write first integrates to the given time, under the force that was held meanwhile; a force
    older than the hold limit is dropped at the very instant it gets too old, as the watchdog of a
    real device's firmware does.
    """

    def __init__(
        self, parameters: PlantModel, operator: Operator | None, hold_limit: float
    ) -> None:
        operator = NoHand() if operator is None else operator
        self._operator = operator
        self._hold_limit_ns = round(hold_limit * 1e9)
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
        self._dropped_ns = 0  # when the held force ends by itself
        self._force: Vector = (0.0,) * self.axes
        self._target = self._target_at(0.0)
        self._x = list(self._target)
        self._v = [0.0] * self.axes
        self._work = [0.0] * self.axes
        self._muscle = [0.0] * self.axes
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
        resolution = self._resolution
        return tuple([quantise(x, resolution) for x in self._x])

    def write(self, time_ns: int, force: Vector) -> Vector:
        """Hold ``force`` from now on; see :class:`forcebound.devices.Device`."""
        self._advance_to(time_ns)
        magnitude = math.hypot(*force)
        if not magnitude <= self._saturation:
            scale = self._saturation / magnitude if math.isfinite(magnitude) else 0.0
            force = tuple([scale * f if math.isfinite(f) else 0.0 for f in force])
        self._force = force
        self._dropped_ns = time_ns + self._hold_limit_ns
        return force

    def close(self) -> None:
        """Do nothing: it holds no resource; see :class:`forcebound.devices.Device`."""

    def truth(self) -> Truth:
        """Return the ground truth; see :class:`Truth`."""
        hand_mass = self._hand_mass
        energy = 0.0
        for work, v in zip(self._work, self._v, strict=True):
            energy += work - 0.5 * hand_mass * v * v
        return Truth(tuple(self._x), tuple(self._v), tuple(self._muscle), energy)

    def _target_at(self, elapsed: float) -> Vector:
        target, axes = self._operator.target(elapsed), self._axes
        return target if len(target) == axes else (target + (0.0,) * axes)[:axes]

    def _advance_to(self, time_ns: int) -> None:
        if self._time_ns is None:
            self._time_ns = time_ns
        if time_ns <= self._time_ns:
            return
        if self._time_ns < self._dropped_ns < time_ns:
            self._hold_until(self._dropped_ns)
        if self._time_ns >= self._dropped_ns:
            self._force = (0.0,) * self._axes
        self._hold_until(time_ns)

    def _hold_until(self, time_ns: int) -> None:
        assert self._time_ns is not None
        duration = (time_ns - self._time_ns) * 1e-9
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
                self._force[axis],
                *self._constants,
            )
        self._target = end
