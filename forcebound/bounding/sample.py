r"""A sample: what a law sees, and what has to be remembered for it from sample to sample.

The only definition. The bounder of the live node, the compiled sweep, the audit and the fit of the
paper's table call these same functions; they use nothing but arithmetic and :mod:`math`, so that
they run compiled as well as in plain Python. A new observable is a field of :class:`Sample` (and
of :class:`Motion`, :class:`AxisMemory` or :class:`Memory` if it needs them) in this file.

One sample, for a device with any number of axes::

    motion = NO_MOTION
    for each axis:
        axis_memory, motion = observe_axis(axis_memory, memory, reading, motion, dt, device)
    memory, sample = observe(memory, motion, commanded, dt, device)
    state, largest_force, added_damping = law.limit(state, sample, device)
    ...                                           # the force is shortened and written
    write = NO_WRITE
    for each axis:
        axis_memory, write = write_axis(axis_memory, force, write)
    state = law.settle(state, write, device)

Measured way. Two lower bounds of how far the true position has gone, as the proof of the certified
law uses them (:mod:`forcebound.bounding.certified`, steps 3 and 4): the path of the play operator
of each axis, and the least :math:`\int |v|^2 dt` (:func:`squared_velocity_integral`), for which the
readings at two earlier samples, the anchors, are remembered. If dt exceeds the hold limit, the
device has dropped its force at an unknown moment; the sample still holds what was measured, and the
memory begins anew at the reading, with no force held.
"""

import math
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

if TYPE_CHECKING:  # a launcher reads the laws' names, and starts without numpy
    import numpy as np
    from numpy.typing import NDArray

Floats: TypeAlias = "NDArray[np.float64]"

#: Joules. An energy is negative if it is below minus this: rounding of sums that reach some 10 J.
ENERGY_TOLERANCE = 1e-9

#: Samples after which the younger of two anchors takes the place of the older. With eight,
#: two anchors gain 97 % of what 64 would, in displayed stiffness (``docs/theory.md``, section 3).
ANCHOR_SAMPLES = 8


class DeviceConstants(NamedTuple):
    """What a law may rely on about a device; see :class:`forcebound.bounding.Dissipation`."""

    damping: float  # b, N s/m
    friction: float  # f_c, N; 0 for a law that counts viscous damping alone
    half_resolution: float  # r, m
    period: float  # T, s
    hold_limit: float  # T_max, s
    axes: float  # number of axes


class AxisMemory(NamedTuple):
    """What is remembered of one axis."""

    reading: float  # q(n-1), m
    force: float  # F(n-1), N, held since the last sample
    play: float  # position of the play operator, m
    path: float  # way of the play operator, m
    older: float  # reading at the older anchor, m
    younger: float  # reading at the younger anchor, m


class Memory(NamedTuple):
    """What is remembered of all axes together."""

    path: float  # length of the vector of the axes' paths, m
    integral: float  # least ∫|v|² dt since the older anchor, m²/s
    between: float  # of it, from the older anchor to the younger, m²/s
    older_age: float  # time since the older anchor, s
    younger_age: float  # time since the younger anchor, s
    samples: float  # since the anchors moved


class Motion(NamedTuple):
    """What has been measured in a sample, summed over the axes."""

    distance_square: float  # m², of the move of the reading
    step_square: float  # m², of what of the move cannot be quantisation
    older_square: float  # m², the same since the older anchor
    younger_square: float  # m², the same since the younger anchor
    path_square: float  # m², of the way of the play operator
    work: float  # F(n-1)·Δq, J
    held_square: float  # N², of F(n-1)
    held_sum: float  # Σ_i |F_i(n-1)|, N


class Sample(NamedTuple):
    """What a law sees at a sample."""

    commanded: float  # ‖F_e(n)‖, N, already saturated
    dt: float  # measured time since the last sample, s, positive
    distance: float  # ‖Δq‖, m: how far the reading has moved since the last sample
    squared_velocity_integral: float  # increase of the least ∫|v|² dt, m²/s
    path: float  # increase of the length of the vector of the paths of the play operators, m
    work: float  # F(n-1)·Δq, J
    held: float  # ‖F(n-1)‖, N: force held since the last sample
    held_sum: float  # Σ_i |F_i(n-1)|, N


class Write(NamedTuple):
    """A force as it was written, summed over the axes; F(n-1) = 0 after a hold-limit overrun."""

    square: float  # ‖F(n)‖², N²
    force_sum: float  # Σ_i |F_i(n)|, N
    change_sum: float  # Σ_i |F_i(n) - F_i(n-1)|, N
    held_sum: float  # Σ_i |F_i(n-1)|, N


NO_MEMORY = Memory(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
NO_MOTION = Motion(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
NO_WRITE = Write(0.0, 0.0, 0.0, 0.0)


def start_axis(reading: float) -> AxisMemory:
    """Return the memory of an axis at its first ``reading``, in m, with no force held."""
    return AxisMemory(reading, 0.0, reading, 0.0, reading, reading)


def observe_axis(
    axis: AxisMemory,
    memory: Memory,
    reading: float,
    motion: Motion,
    dt: float,
    device: DeviceConstants,
) -> tuple[AxisMemory, Motion]:
    """Take in the new reading of one axis.

    Args:
        axis: What is remembered of this axis.
        memory: What is remembered of all axes, before this sample.
        reading: q(n), in m.
        motion: Sums over the axes before this one; :data:`NO_MOTION` for the first.
        dt: Time since the last sample, in s, positive.
        device: Constants of the device.

    Returns:
        The memory of the axis, and the sums with this axis.
    """
    r = device.half_resolution
    move = reading - axis.reading
    position = play(reading, axis.play, r)
    path = axis.path + abs(position - axis.play)
    motion = Motion(
        motion.distance_square + move * move,
        motion.step_square + clear_square(reading, axis.reading, r),
        motion.older_square + clear_square(reading, axis.older, r),
        motion.younger_square + clear_square(reading, axis.younger, r),
        motion.path_square + path * path,
        motion.work + axis.force * move,
        motion.held_square + axis.force * axis.force,
        motion.held_sum + abs(axis.force),
    )
    if dt > device.hold_limit:
        return start_axis(reading), motion
    moves_anchors = memory.samples + 1.0 == ANCHOR_SAMPLES
    older = axis.younger if moves_anchors else axis.older
    younger = reading if moves_anchors else axis.younger
    return AxisMemory(reading, axis.force, position, path, older, younger), motion


def observe(
    memory: Memory, motion: Motion, commanded: float, dt: float, device: DeviceConstants
) -> tuple[Memory, Sample]:
    """Make the sample of all axes.

    Args:
        memory: What is remembered of all axes.
        motion: Sums over all axes of :func:`observe_axis`.
        commanded: Magnitude of the commanded force, in N, already saturated.
        dt: Time since the last sample, in s, positive.
        device: Constants of the device.

    Returns:
        The memory for the next sample, and what the law sees of this one.
    """
    older_age = memory.older_age + dt
    younger_age = memory.younger_age + dt
    path = math.sqrt(motion.path_square)
    integral = squared_velocity_integral(memory, motion, dt)
    sample = Sample(
        commanded,
        dt,
        math.sqrt(motion.distance_square),
        integral - memory.integral,
        path - memory.path,
        motion.work,
        math.sqrt(motion.held_square),
        motion.held_sum,
    )
    if dt > device.hold_limit:
        return Memory(0.0, 0.0, 0.0, 0.0, 0.0, 0.0), sample
    samples = memory.samples + 1.0
    if samples == ANCHOR_SAMPLES:
        between = integral - memory.between
        return Memory(path, between, between, younger_age, 0.0, 0.0), sample
    return Memory(path, integral, memory.between, older_age, younger_age, samples), sample


def write_axis(axis: AxisMemory, force: float, write: Write) -> tuple[AxisMemory, Write]:
    """Take in the force written on one axis.

    Args:
        axis: What is remembered of this axis.
        force: F(n) on this axis, in N, as the device applies it.
        write: Sums over the axes before this one; :data:`NO_WRITE` for the first.

    Returns:
        The memory of the axis, and the sums with this axis.
    """
    write = Write(
        write.square + force * force,
        write.force_sum + abs(force),
        write.change_sum + abs(force - axis.force),
        write.held_sum + abs(axis.force),
    )
    axis = AxisMemory(axis.reading, force, axis.play, axis.path, axis.older, axis.younger)
    return axis, write


def play(reading: float, position: float, half_width: float) -> float:
    r"""Return the new position of the play (backlash) operator.

    .. math:: y' = \max(q - r, \min(q + r, y))

    It moves only when the reading has left it by more than ``half_width``. Its path is the shortest
    of all signals that stay within ``half_width`` of the readings, up to where it starts; so it
    never takes an encoder that chatters on one edge for travel.

    Args:
        reading: New reading q, in m.
        position: Position y of the operator so far, in m.
        half_width: r, in m, half the resolution of the reading.
    """
    return max(reading - half_width, min(reading + half_width, position))


def clear_square(reading: float, anchor: float, half_resolution: float) -> float:
    """Return the square, in m², of what of a move cannot be quantisation, which is at most 2r."""
    clear = max(abs(reading - anchor) - 2.0 * half_resolution, 0.0)
    return clear * clear


def squared_velocity_integral(memory: Memory, motion: Motion, dt: float) -> float:
    r"""Return the least :math:`\int |v|^2 dt` since the older anchor, in m²/s.

    .. math:: V = \max\Big(V + \frac{c_1^2}{dt}, \frac{c_a^2}{t - t_a},
                           V_{ab} + \frac{c_b^2}{t - t_b}\Big),
              \qquad c^2 = \sum_i (|q_i - q_{before,i}| - 2r)_+^2

    A slow hand moves by about one step of the encoder a sample, and one step proves nothing: the
    true position may have been at one edge of the reading's cell and now be at the other. Over
    several samples the same 2r is lost only once. By Cauchy-Schwarz each term is a lower bound, and
    so is the largest. The terms are from the last sample, the older anchor a and the younger b.
    """
    return max(
        memory.integral + motion.step_square / dt,
        motion.older_square / (memory.older_age + dt),
        memory.between + motion.younger_square / (memory.younger_age + dt),
    )


# NamedTuples as rows of numbers, ``stride`` apart: how arrays keep them between compiled calls.

AXIS_ROWS = len(AxisMemory._fields)
MEMORY_ROWS = len(Memory._fields)
DEVICE_ROWS = len(DeviceConstants._fields)


def load_axis(rows: Floats, first: int, stride: int) -> AxisMemory:
    """Return the memory of an axis from ``rows``."""
    return AxisMemory(
        rows[first],
        rows[first + stride],
        rows[first + 2 * stride],
        rows[first + 3 * stride],
        rows[first + 4 * stride],
        rows[first + 5 * stride],
    )


def store_axis(rows: Floats, first: int, stride: int, axis: AxisMemory) -> None:
    """Put the memory of an axis into ``rows``."""
    rows[first] = axis.reading
    rows[first + stride] = axis.force
    rows[first + 2 * stride] = axis.play
    rows[first + 3 * stride] = axis.path
    rows[first + 4 * stride] = axis.older
    rows[first + 5 * stride] = axis.younger


def load_memory(rows: Floats, first: int, stride: int) -> Memory:
    """Return the memory of all axes from ``rows``."""
    return Memory(
        rows[first],
        rows[first + stride],
        rows[first + 2 * stride],
        rows[first + 3 * stride],
        rows[first + 4 * stride],
        rows[first + 5 * stride],
    )


def store_memory(rows: Floats, first: int, stride: int, memory: Memory) -> None:
    """Put the memory of all axes into ``rows``."""
    rows[first] = memory.path
    rows[first + stride] = memory.integral
    rows[first + 2 * stride] = memory.between
    rows[first + 3 * stride] = memory.older_age
    rows[first + 4 * stride] = memory.younger_age
    rows[first + 5 * stride] = memory.samples


def load_device(rows: Floats, first: int, stride: int) -> DeviceConstants:
    """Return the constants of a device from ``rows``."""
    return DeviceConstants(
        rows[first],
        rows[first + stride],
        rows[first + 2 * stride],
        rows[first + 3 * stride],
        rows[first + 4 * stride],
        rows[first + 5 * stride],
    )
