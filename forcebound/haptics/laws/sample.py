"""A sample: what a law sees, and what has to be remembered for it from sample to sample.

The only definition. The bounder of the live node, the compiled loops and the fit of the paper's
table call these same functions; they use nothing but arithmetic and :mod:`math`, so that they run
compiled as well as in plain Python. A new observable is a field of :class:`Sample` (and of
:class:`Motion`, :class:`AxisMemory` or :class:`Memory` if it needs them) in this file.

A sample is :func:`observe_axis` for each axis, begun with :data:`NO_MOTION`, then :func:`observe`,
the law's ``limit``, and its ``settle`` once the force is written. The measured loss is a lower
bound (``docs/theory.md``, section 3, lemmas 3 and 4): the path of the play operator of each axis,
and :func:`viscous_loss`.
"""

import math
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

if TYPE_CHECKING:  # a launcher reads the laws' names, and starts without numpy
    import numpy as np
    from numpy.typing import NDArray

Floats: TypeAlias = "NDArray[np.float64]"

#: Joules. An energy is negative if it is below minus this: rounding of sums that reach some 10 J.
ENERGY_TOLERANCE = 1e-9

#: Samples after which the younger of two anchors takes the place of the older.
ANCHOR_SAMPLES = 8


class DeviceConstants(NamedTuple):
    """Constants of a device for a law; see :class:`forcebound.haptics.laws.Dissipation`."""

    damping: float  # b of the worst axis, N s/m
    friction: float  # f_c of the worst axis, N; 0 for a law that counts viscous damping alone
    half_resolution: float  # r of the worst axis, m
    period: float  # T, s
    hold_limit: float  # T_max, s
    axes: float  # number of axes
    path_friction: float  # N, of friction along the path; 0 if it acts on each axis by itself
    start_price: float  # J, friction that may be credited before the first motion is sure
    energy_cap: float  # J, more is of no use for a hold
    hand_speed: float = math.inf  # m/s
    initial_level: float = 0.0  # J, of an energy tank, as all below
    target_level: float = 0.0  # J
    refill: float = 0.0  # N s/m for each J that is missing


class AxisConstants(NamedTuple):
    """Constants of one axis for a law."""

    damping: float  # b_i, N s/m
    friction: float  # f_i, N, on this axis by itself; 0 for friction along the path
    half_resolution: float  # r_i, m
    half_play: float  # m, of the play operator: r_i + z_i
    presliding: float  # 2 z_i, m: displacement in a hold before friction is sure
    weight_error: float  # N
    dropped: float  # N, force against positive motion after a cut: the weight, not compensated


class AxisMemory(NamedTuple):
    """Memory of one axis."""

    reading: float  # q(n-1), m
    force: float  # F(n-1), N, written last
    mean_force: float  # N, of the interval before the last reading
    play: float  # position of the play operator, m
    path: float  # length of the play operator's path, m
    older: float  # reading at the older anchor, m
    younger: float  # reading at the younger anchor, m


class Memory(NamedTuple):
    """Memory of all axes together."""

    path: float  # length of the vector of the axes' paths, m
    loss: float  # least viscous loss since the older anchor, J
    between: float  # of it, from the older anchor to the younger, J
    older_age: float  # time since the older anchor, s
    younger_age: float  # time since the younger anchor, s
    samples: float  # since the anchors moved


class Motion(NamedTuple):
    """Measurements of a sample, summed over the axes."""

    distance_square: float  # m², of the move of the reading
    held_square: float  # N², of F(n-1)
    step: float  # J s, b times the square of what of the move cannot be quantisation
    older: float  # J s, the same since the older anchor
    younger: float  # J s, the same since the younger anchor
    path_square: float  # m², of the play operator's path
    slid: float  # J, friction of the play operators' moves
    work: float  # J
    held_price: float  # J


class Sample(NamedTuple):
    """Input of a law at a sample."""

    commanded: float  # ‖F_e(n)‖, N, already saturated
    dt: float  # measured time since the last sample, s, positive
    distance: float  # ‖Δq‖, m: how far the reading has moved since the last sample
    work: float  # F̄·Δq, J, with the mean force since the last sample: F(n-1) if nothing changed it
    held: float  # ‖F(n-1)‖, N: force written at the last sample
    viscous_loss: float  # J, increase of the least viscous loss
    friction_loss: float  # J, increase of the least friction loss
    penalty: float  # J, what a force that changes within the interval can gain by its changes
    change_price: float  # Σ_i r_i |F̄_i(n-1) - F̄_i(n-2)|, J
    held_price: float  # Σ_i r_i |F̄_i(n-1)|, J


class Write(NamedTuple):
    """A force as it was written."""

    square: float  # ‖F(n)‖², N²
    held_price: float  # J, of the sample
    surplus: float  # J of the law's energy that a hold of this force does not need


NO_MEMORY = Memory(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
NO_MOTION = Motion(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
NO_WRITE = Write(0.0, 0.0, 0.0)


def start_axis(reading: float) -> AxisMemory:
    """Return the memory of an axis at its first ``reading``, in m, with no force held."""
    return AxisMemory(reading, 0.0, 0.0, reading, 0.0, reading, reading)


def observe_axis(
    axis: AxisMemory,
    memory: Memory,
    reading: float,
    mean: float,
    motion: Motion,
    constants: AxisConstants,
) -> tuple[AxisMemory, Motion]:
    """Take in the new ``reading``, in m, of one axis, with the ``mean`` force since the last, in N.

    ``motion`` has the sums over the axes before this one. Returns the memory of the axis, and the
    sums with this axis.
    """
    r, b = constants.half_resolution, constants.damping
    move = reading - axis.reading
    position = play(reading, axis.play, constants.half_play)
    distance = abs(position - axis.play)
    path = axis.path + distance
    motion = Motion(
        motion.distance_square + move * move,
        motion.held_square + axis.force * axis.force,
        motion.step + b * clear_square(reading, axis.reading, r),
        motion.older + b * clear_square(reading, axis.older, r),
        motion.younger + b * clear_square(reading, axis.younger, r),
        motion.path_square + path * path,
        motion.slid + constants.friction * distance,
        motion.work + mean * move,
        motion.held_price + r * abs(mean),
    )
    moves_anchors = memory.samples + 1.0 == ANCHOR_SAMPLES
    older = axis.younger if moves_anchors else axis.older
    younger = reading if moves_anchors else axis.younger
    return AxisMemory(reading, axis.force, mean, position, path, older, younger), motion


def observe(
    memory: Memory,
    motion: Motion,
    penalty: float,
    change_price: float,
    commanded: float,
    dt: float,
    device: DeviceConstants,
) -> tuple[Memory, Sample]:
    """Make the sample of all axes, ``dt`` s after the last; it follows the memory for the next.

    ``motion`` has the sums of :func:`observe_axis`; ``penalty`` is what the changes of the force
    can have gained, ``change_price`` the price of the change of its mean, in J; ``commanded`` is
    the magnitude of the commanded force, already saturated, in N.
    """
    older_age = memory.older_age + dt
    younger_age = memory.younger_age + dt
    path = math.sqrt(motion.path_square)
    loss = viscous_loss(memory, motion, dt)
    sample = Sample(
        commanded,
        dt,
        math.sqrt(motion.distance_square),
        motion.work,
        math.sqrt(motion.held_square),
        loss - memory.loss,
        motion.slid + device.path_friction * (path - memory.path),
        penalty,
        change_price,
        motion.held_price,
    )
    samples = memory.samples + 1.0
    if samples == ANCHOR_SAMPLES:
        between = loss - memory.between
        return Memory(path, between, between, younger_age, 0.0, 0.0), sample
    return Memory(path, loss, memory.between, older_age, younger_age, samples), sample


def play(reading: float, position: float, half_width: float) -> float:
    r"""Return the new position of the play (backlash) operator, in m; ``half_width`` is r.

    .. math:: y' = \max(q - r, \min(q + r, y))

    Its path is the shortest of all signals that stay within ``half_width`` of the readings, up to
    where it starts; so it never takes an encoder that chatters on one edge for travel.
    """
    return max(reading - half_width, min(reading + half_width, position))


def clear_square(reading: float, anchor: float, half_resolution: float) -> float:
    """Return the square, in m², of what of a move cannot be quantisation, which is at most 2r."""
    clear = max(abs(reading - anchor) - 2.0 * half_resolution, 0.0)
    return clear * clear


def viscous_loss(memory: Memory, motion: Motion, dt: float) -> float:
    r"""Return the least viscous loss :math:`\int b |v|^2 dt` since the older anchor, in J.

    .. math:: V = \max\Big(V + \frac{c_1^2}{dt}, \frac{c_a^2}{t - t_a},
                            V_{ab} + \frac{c_b^2}{t - t_b}\Big),
                  \qquad c^2 = \sum_i b_i (|q_i - q_{before,i}| - 2r_i)_+^2

    The terms are from the last sample, the older anchor a and the younger b. Over several samples
    the 2r that the encoder does not show is lost only once.
    """
    return max(
        memory.loss + motion.step / dt,
        motion.older / (memory.older_age + dt),
        memory.between + motion.younger / (memory.younger_age + dt),
    )
