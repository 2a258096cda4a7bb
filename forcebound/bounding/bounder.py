"""The bounder: a law, its memory and the vectors, as the device node calls it at each sample.

What happens to numbers is compiled, one call for :meth:`ForceBounder.bound` and one for
:meth:`ForceBounder.settle`: a tick runs once a millisecond, with cold caches, and there interpreted
arithmetic costs several times more than compiled. The memory lies in an array, which such a call
takes over without copying.
"""

import math
from collections.abc import Callable
from functools import cache
from typing import Any, TypeAlias

from forcebound.bounding.dissipation import Dissipation
from forcebound.bounding.law import BoundingLaw
from forcebound.bounding.laws import LAWS
from forcebound.bounding.sample import (
    AXIS_ROWS,
    DEVICE_ROWS,
    MEMORY_ROWS,
    NO_MEMORY,
    NO_MOTION,
    NO_WRITE,
    Floats,
    load_axis,
    load_device,
    load_memory,
    observe,
    observe_axis,
    start_axis,
    store_axis,
    store_memory,
    write_axis,
)
from forcebound.compiled import allow_in_kernels, jit
from forcebound.errors import ConfigError

Vector: TypeAlias = tuple[float, ...]

ROUNDING = 1e-15  # more than the relative error of scaling a vector and taking its length
SHORTEST_INTERVAL = 1e-6  # s; a reading sooner after the last proves nothing
LARGEST_READING = 1e6  # m; a reading beyond is none
SMALLEST_LIMIT = 1e-290  # N; below it numbers lose the precision that ROUNDING relies on

# Places in the array of a bounder.
STATE, SATURATION, DEVICE = 0, 1, 2
MEMORY = DEVICE + DEVICE_ROWS
AXES = MEMORY + MEMORY_ROWS  # one block for each axis


class ForceBounder:
    """Bounds the force vector of a device with one law; one ledger for all axes.

    Call :meth:`start` once, then at each sample :meth:`bound` and :meth:`settle`. Damping and
    friction are those of the worst axis: every axis must dissipate at least this much, and friction
    must act along the path or on each axis by itself. Axes that differ much are better served by a
    bounder each.

    Args:
        law: A key of :data:`forcebound.bounding.LAWS`.
        dissipation: What the law may rely on.
        axes: Length of the vectors, at least 1.

    Attributes:
        limit: Largest magnitude allowed at the last sample, in N: the law's or the saturation.
        estimated_energy: Energy that the law believes in after the last sample, in J; its meaning
            is the law's.
        overruns: Holds that lasted longer than the hold limit.
        refused_readings: Readings that were not believed: not finite, too soon after the last, or
            faster than the device's largest speed.
        largest_allowance: Most energy that a late hold can have given the hand, in J.
        allowance_repaid: Whether the ledger has that back.

    Raises:
        ConfigError: If the law is not known or there is no axis.
    """

    def __init__(self, law: str, dissipation: Dissipation, axes: int = 1) -> None:
        if law not in LAWS:
            raise ConfigError(f"no bounding law {law!r}; known are {', '.join(sorted(LAWS))}")
        if axes < 1:
            raise ConfigError(f"axes must be >= 1, got {axes}")
        _refuse_unsupported(dissipation)
        import numpy as np  # not in the launcher

        self._start_law, self._limit_force, self._settle_force = _compiled(LAWS[law])
        self._axes = axes
        self._dissipation = dissipation
        self._vector = np.zeros(axes)  # what a compiled call takes in
        self._view: Any = self._vector.data  # numpy takes longer to set a number
        self._rows = np.zeros(AXES + AXIS_ROWS * axes)
        self._rows[SATURATION] = dissipation.saturation
        self._rows[DEVICE:MEMORY] = LAWS[law].device(dissipation, axes)
        # Compile, or load from the cache, before time matters.
        self.start(0, (0.0,) * axes)
        self.settle(self.bound(1_000_000, self._position, self._position))
        self.start(0, self._position)

    def start(self, time_ns: int, position: Vector) -> None:
        """Begin with the first reading and no force; forget everything before.

        The device must be without force from the last :meth:`settle` on.

        Args:
            time_ns: When it was read, in ns.
            position: Reading of each axis, in m.

        Raises:
            ValueError: If ``position`` does not have as many entries as there are axes.
        """
        self._time_ns = time_ns
        self._position = position
        self._is_cut = False
        self.limit = 0.0
        self.overruns = self.refused_readings = 0
        self.largest_allowance, self.allowance_repaid = 0.0, True
        self.estimated_energy: float = self._start_law(
            self._rows, self._take_in(position, "positions")
        )

    def bound(self, read_ns: int, position: Vector, commanded: Vector) -> Vector:
        """Return the force to write at this sample.

        A reading that cannot be is refused: it is counted, changes nothing else, and the force is
        one that is safe whatever the device does.

        Args:
            read_ns: When ``position`` was read, in ns; later than before.
            position: Reading of each axis, in m.
            commanded: Commanded force of each axis, in N.

        Returns:
            Bounded force of each axis, in N, in the direction of the commanded force (a law that
            adds damping excepted).

        Raises:
            ValueError: If a length is wrong or a commanded force is not finite: mistakes of the
                caller, since the safety chain has rejected such forces before.
        """
        if len(commanded) != self._axes:
            raise ValueError(f"expected {self._axes} forces, got {len(commanded)}")
        magnitude = math.hypot(*commanded)
        if not magnitude < math.inf:
            raise ValueError(f"commanded forces must be finite, got {commanded} N")
        readings = self._take_in(position, "positions")
        dt = (read_ns - self._time_ns) / 1e9
        if dt < SHORTEST_INTERVAL or not math.hypot(*position) < LARGEST_READING:
            self.refused_readings += 1
            self._is_cut = True
            self.limit = 0.0
            return (0.0,) * self._axes
        limit_s = self._dissipation.hold_limit
        if dt > limit_s or self._is_cut:
            self.overruns += 1
            dt = max(dt, limit_s * (1.0 + 1e-9))
        self._is_cut = False
        limit, damping = self._limit_force(self._rows, readings, magnitude, dt)
        force = commanded
        if damping > 0.0:
            rate = damping / dt
            moved = zip(force, position, self._position, strict=True)
            force = tuple([f + rate * (now - before) for f, now, before in moved])
            magnitude = math.hypot(*force)
        self._time_ns = read_ns
        self._position = position
        self.limit = limit
        return shorten(force, magnitude, limit)

    def set_hold_limit(self, seconds: float) -> None:
        """Plan the forces from the next :meth:`bound` on for this hold limit, in s.

        The device must have been given it before it gets such a force.
        """
        if seconds != self._dissipation.hold_limit:
            raise ConfigError("a hold limit that changes is not supported yet")

    def report_cut(self, time_ns: int, position: Vector) -> None:
        """Take in where and when the watchdog dropped the force; before the next :meth:`bound`."""

    def settle(self, applied: Vector, write_ns: int | None = None) -> None:
        """Close the sample with the force that was really written.

        Args:
            applied: Force of each axis, in N: what :meth:`bound` returned, or less of it.
            write_ns: When it took effect, in ns; None: when the position was read.

        Raises:
            ValueError: If the length is wrong.
        """
        self.estimated_energy = self._settle_force(self._rows, self._take_in(applied, "forces"))

    def _take_in(self, values: Vector, what: str) -> Floats:
        if len(values) != self._axes:
            raise ValueError(f"expected {self._axes} {what}, got {len(values)}")
        view = self._view
        for axis, value in enumerate(values):
            view[axis] = value
        return self._vector


def _refuse_unsupported(dissipation: Dissipation) -> None:
    for name in ("presliding", "weight", "weight_error"):
        if any(dissipation.of_axes(name, 1)):
            raise ConfigError(f"{name} is not supported yet")
    for name in ("gain_error", "lag", "write_delay", "allowance", "watchdog_tolerance"):
        if getattr(dissipation, name):
            raise ConfigError(f"{name} is not supported yet")
    if dissipation.largest_speed < math.inf or dissipation.energy_cap is not None:
        raise ConfigError("largest_speed and energy_cap are not supported yet")
    if dissipation.watchdog == "none":
        raise ConfigError("watchdog 'none' is not supported yet")


_Start: TypeAlias = Callable[[Floats, Floats], float]
_Limit: TypeAlias = Callable[[Floats, Floats, float, float], tuple[float, float]]
_Settle: TypeAlias = Callable[[Floats, Floats], float]


@cache
def _compiled(law: BoundingLaw) -> tuple[_Start, _Limit, _Settle]:
    """Return what a bounder does with its array and a vector, compiled.

    ``start(rows, position) -> estimated energy``, ``limit(rows, position, commanded force, dt) ->
    (largest force, added damping)`` and
    ``settle(rows, applied) -> estimated energy``.
    """
    start_law, limit_force, settle_law, energy = law.start, law.limit, law.settle, law.energy

    def start(rows: Floats, position: Floats) -> float:
        device = load_device(rows, DEVICE, 1)
        for axis in range(position.size):
            store_axis(rows, AXES + axis * AXIS_ROWS, 1, start_axis(position[axis]))
        store_memory(rows, MEMORY, 1, NO_MEMORY)
        rows[STATE] = start_law(device)
        return energy(rows[STATE], NO_WRITE, device)

    def limit(rows: Floats, position: Floats, commanded: float, dt: float) -> tuple[float, float]:
        device = load_device(rows, DEVICE, 1)
        memory = load_memory(rows, MEMORY, 1)
        motion = NO_MOTION
        for axis in range(position.size):
            first = AXES + axis * AXIS_ROWS
            one, motion = observe_axis(
                load_axis(rows, first, 1), memory, position[axis], motion, dt, device
            )
            store_axis(rows, first, 1, one)
        saturation = rows[SATURATION]
        memory, sample = observe(memory, motion, min(commanded, saturation), dt, device)
        store_memory(rows, MEMORY, 1, memory)
        rows[STATE], largest, added_damping = limit_force(rows[STATE], sample, device)
        return min(largest, saturation), added_damping

    def settle(rows: Floats, applied: Floats) -> float:
        device = load_device(rows, DEVICE, 1)
        write = NO_WRITE
        for axis in range(applied.size):
            first = AXES + axis * AXIS_ROWS
            one, write = write_axis(load_axis(rows, first, 1), applied[axis], write)
            store_axis(rows, first, 1, one)
        rows[STATE] = settle_law(rows[STATE], write, device)
        return energy(rows[STATE], write, device)

    allow_in_kernels([start_law, limit_force, settle_law, energy])
    return jit(start), jit(limit), jit(settle)


def shorten(force: Vector, magnitude: float, limit: float) -> Vector:
    """Return ``force``, of ``magnitude`` N, no longer than ``limit`` N; its direction is kept.

    The length is at most ``limit`` to the last bit, not only to rounding.
    """
    if magnitude <= limit:
        return force
    if len(force) == 1:
        return (math.copysign(limit, force[0]),)
    if limit < SMALLEST_LIMIT:
        return (0.0,) * len(force)
    scale = limit / magnitude * (1.0 - ROUNDING)
    return tuple([scale * f for f in force])
