"""The body of a device with independent axes: a plant for each, in one hand."""

import math
from collections.abc import Callable, Sequence
from functools import partial
from struct import Struct
from typing import Annotated, Any, TypeAlias

import numpy as np

from forcebound.axes import PerAxis, per_axis
from forcebound.compiled import jit, new_records, record_type
from forcebound.haptics.devices import Kinematics, Truth
from forcebound.haptics.devices.plant import Axis, Moving, advance_extended, quantise
from forcebound.haptics.devices.simulated import pad
from forcebound.haptics.devices.true_values import TrueNumbers
from forcebound.haptics.hands import Operator
from forcebound.messages.packets import MAX_AXES, Vector

Numbers: TypeAlias = Annotated[list[float], MAX_AXES]


class Axes:
    """All axes in the hand, as compiled code reads and writes them.

    Of an angle, rad stands for m, N m for N, kg m^2 for kg.
    """

    target: Numbers  # of the hand, at the start of a move, m
    target_end: Numbers  # and at its end
    commanded: Numbers  # force commanded of the motor, N
    x: Numbers  # m
    v: Numbers  # m/s
    work: Numbers  # of the hand, J
    muscle: Numbers  # mean force of the hand's spring and damper in the last step, N
    bristle: Numbers  # m
    motor: Numbers  # what the motor gives, N
    reading: Numbers  # of the encoder, m
    damping: Numbers  # N s/m
    friction: Numbers  # N
    presliding: Numbers  # m
    weight: Numbers  # N
    resolution: Numbers  # m
    gap: Numbers  # to a wall in place of the hand, m, its sign the side; NaN: none
    mass: Numbers  # of device and hand, kg
    count: int
    hand_mass: float  # kg
    stiffness: float  # of the hand, N/m
    hand_damping: float  # N s/m
    is_hand: bool  # there are no walls in place of it
    substep: float  # longest integration step, s
    lag: float  # of the motor, s


def advance_axes(records: Sequence[Axes], duration: float) -> float:
    """Move every axis by ``duration``, in s, > 0.

    Returns:
        Energy that has flowed from the hand into the device, in J.
    """
    energy, a = 0.0, records[0]
    for i in range(a.count):
        is_held = a.is_hand or not math.isnan(a.gap[i])
        axis = Axis(
            a.mass[i],
            a.damping[i],
            a.friction[i],
            a.presliding[i],
            a.weight[i],
            a.lag,
            a.stiffness if is_held else 0.0,
            a.hand_damping if is_held else 0.0,
            a.gap[i],
        )
        before = Moving(a.x[i], a.v[i], a.work[i], a.bristle[i], a.motor[i])
        after, a.muscle[i] = advance_extended(
            before, axis, a.target[i], a.target_end[i], duration, a.substep, a.commanded[i]
        )
        a.x[i], a.v[i], a.work[i], a.bristle[i], a.motor[i] = after
        a.reading[i] = quantise(after.x, a.resolution[i])
        energy += after.work - 0.5 * a.hand_mass * after.v * after.v
    return energy


class AxesBody:
    """A mass, or inertia, on each of some axes that know nothing of each other; see ``Body``."""

    kinematics: Kinematics | None = None

    def __init__(
        self,
        mass: PerAxis,
        weight: PerAxis,
        substep: float,
        true: TrueNumbers,
        operator: Operator,
    ) -> None:
        """Put it into an operator's hand; ``mass`` without it, ``weight`` as it is stated."""
        axes = len(true.damping)
        self._records = new_records(Axes)
        self._axes: Any = self._records[0]
        self._axes.count, self._masses = axes, np.array(per_axis("inertia", mass, axes))
        self._axes.mass[:axes] = self._masses + operator.mass
        self._axes.hand_mass, self._axes.stiffness = operator.mass, operator.stiffness
        self._axes.hand_damping, self._axes.lag = operator.damping, true.lag
        self._axes.gap[:], self._axes.is_hand = math.nan, not operator.walls
        self._axes.gap[: len(operator.walls)] = operator.walls
        self._axes.damping[:axes], self._axes.friction[:axes] = true.damping, true.friction
        self._damping = np.array(true.damping)
        self._axes.presliding[:axes], self._axes.weight[:axes] = true.presliding, true.weight
        self._axes.resolution[:axes] = true.resolution
        self._sound = self._axes.friction.copy(), self._axes.presliding.copy()
        self._weak_spot = true.weak_spot
        self._axes.substep = substep
        for mass, f, z in zip(self._axes.mass, *self._sound, strict=True):
            if f > 0.0 and z > 0.0:  # an eighth of a radian of the oscillation on the bristle
                step = 0.125 * math.sqrt(mass * z / f)
                self._axes.substep = min(self._axes.substep, step)
        self.compensation: Vector = tuple([-w for w in per_axis("weight", weight, axes)])
        start = pad(operator.target(0.0), axes)
        self._axes.x[:axes], self._axes.motor[:axes] = start, self.compensation
        for axis, x in enumerate(start):
            self._axes.reading[axis] = quantise(x, float(self._axes.resolution[axis]))
        self._energy = 0.0
        # numpy takes longer to set or get a number
        data = self._records.view(np.uint8).data
        unused = 8 * (MAX_AXES - axes)
        self._set_inputs = partial(Struct(f"{axes}d{unused}x" * 3).pack_into, data, 0)
        places: Any = record_type(Axes).fields
        get = Struct(f"{axes}d").unpack_from
        self.reading: Callable[[], Vector]
        self._x, self._v, self._muscle, self.reading = (
            partial(get, data, places[name][1]) for name in ("x", "v", "muscle", "reading")
        )
        self._advance: Any = jit(advance_axes)
        # Compile, or load from the cache, before time matters.
        unmoved = self._records.copy()
        self.move((0.0,) * axes, (0.0,) * axes, 1e-3, (0.0,) * axes)
        self._records[:], self._energy = unmoved, 0.0

    def truth(self) -> Truth:
        return Truth(self._x(), self._v(), self._muscle(), self._energy)

    def kinetic_energy(self) -> float:
        speeds = self._axes.v[: self._axes.count]
        return 0.5 * float(self._masses @ speeds**2)

    def brake(self, damping: Vector) -> None:
        self._axes.damping[: self._axes.count] = self._damping + damping

    def move(self, target: Vector, target_end: Vector, duration: float, commanded: Vector) -> None:
        if self._weak_spot is not None:
            share = self._weak_spot.share_at(self._x())
            friction, presliding = self._sound
            self._axes.friction, self._axes.presliding = share * friction, share * presliding
        self._set_inputs(*target, *target_end, *commanded)
        self._energy = self._advance(self._records, duration)
