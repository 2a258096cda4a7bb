r"""Ground truth of the independent attack: what a hand gives to a device on a prescribed path.

Written from ``docs/theory.md`` alone; it shares nothing with ``forcebound.haptics.devices``. There
is no mass and no integrator. The path is chosen, straight and uniform between events (write, cut,
turn), and the energy of each piece has a closed form:

.. math:: E = \sum_i b_i \int v_i^2 dt + W_{friction} + \sum_i \gamma_i \int F_{a,i} v_i dt

Without mass this is the energy that any hand has put in, since a mass only adds kinetic energy.

* The amplifier is first order: :math:`F_a` relaxes to what was written last, from the time of the
  write on, and to 0 from the time at which the watchdog drops the force.
* Friction is rigid, or a stop operator: an elastic bristle z that slides at :math:`|z| = z_m`. With
  friction along the path, z is a vector; on a straight line the bristle is dragged along a
  tractrix, whose work is known.
* The worst end of a hold (:func:`worst_hold`) is found piece by piece, again on straight pieces, so
  it is the energy of a path that exists, never an estimate.
"""

import math
from collections.abc import MutableSequence, Sequence
from typing import Annotated, TypeAlias

import numpy as np
from numpy.typing import NDArray

from forcebound.compiled import outlined

Floats: TypeAlias = NDArray[np.float64]

AXES = 3  # entries of a vector; with fewer axes the last ones stay zero
PerAxis: TypeAlias = Annotated[list[float], AXES]
Vector: TypeAlias = Floats | Sequence[float]


class Device:
    """A device: its state, and its properties; SI units."""

    position: PerAxis  # m
    bristle: PerAxis  # m
    output: PerAxis  # N, of an amplifier with a lag
    target: PerAxis  # N, of the amplifier
    damping: PerAxis
    friction: PerAxis
    presliding: PerAxis
    gain: PerAxis
    error: PerAxis  # m, of a reading, at most
    weight: PerAxis
    compensation: PerAxis
    lag: float  # s
    attenuates: int  # 0: no; 1: of each written force all or nothing; 2: whenever it pays the hand
    least: float  # share that it gives at least
    work: PerAxis  # J, against the motor since the force that acts took effect, if it gives all
    is_along_path: bool  # of friction
    axes: int
    is_at_tip: bool  # an arm, moved at its tip
    fastest: float  # m/s, of the hand
    burst: float  # s, within which a hand may be faster if it gets no further than in all of it
    seen: float  # m; a hand may be faster if its move in an interval is more than it may, by this
    guard: float  # s between two looks of a guarding watchdog, or 0
    drop: float  # s from a look that has seen something to the drop


#: The device, and two copies for what is only tried.
Devices: TypeAlias = MutableSequence[Device]
COPIES = 2

#: Pieces into which the worst end of a hold is cut when the force changes within it.
PIECES = 6

STALL = 1.0  # s, of a late hold that is guarded


@outlined
def set_force(device: Device, force: Vector) -> None:
    """Let the amplifier settle towards a ``force``, in N, less what compensates the weight."""
    for axis in range(AXES):
        device.target[axis] = force[axis] - device.compensation[axis]


@outlined
def cut(device: Device) -> None:
    """Let the amplifier settle towards no force."""
    for axis in range(AXES):
        device.target[axis] = 0.0


@outlined
def impulse(device: Device, axis: int, duration: float) -> float:
    """Return the time integral of the motor force of an axis over the next ``duration``, in N s."""
    target = device.target[axis]
    integral = target * duration
    if device.lag > 0.0:
        integral -= (device.output[axis] - target) * device.lag * math.expm1(-duration / device.lag)
    return device.gain[axis] * integral


@outlined
def relax(device: Device, duration: float) -> None:
    """Let the amplifier settle towards its target for ``duration``."""
    share = math.exp(-duration / device.lag) if device.lag > 0.0 else 0.0
    for axis in range(AXES):
        target = device.target[axis]
        device.output[axis] = target + (device.output[axis] - target) * share


@outlined
def work_of_axis(device: Device, axis: int, move: float) -> float:
    """Move the bristle of one axis; return the work against friction, stored or lost, in J."""
    friction, width = device.friction[axis], device.presliding[axis]
    if width <= 0.0:
        return friction * abs(move)
    before = device.bristle[axis]
    after = min(max(before + move, -width), width)
    device.bristle[axis] = after
    stored = friction / width * (after * after - before * before) / 2.0
    return stored + friction * (abs(move) - abs(after - before))


@outlined
def work_along_path(device: Device, move: Floats) -> float:
    """Move the bristle of a friction that acts along the path; return the work, in J."""
    friction, width, bristle = device.friction[0], device.presliding[0], device.bristle
    length = along = square = 0.0
    for axis in range(device.axes):
        length += move[axis] * move[axis]
    length = math.sqrt(length)
    if width <= 0.0 or length <= 0.0:
        return friction * length
    for axis in range(device.axes):
        along += bristle[axis] * move[axis] / length
        square += bristle[axis] * bristle[axis]
    across = math.sqrt(max(square - along * along, 0.0))
    slide = math.sqrt(max(width * width - across * across, 0.0)) - along
    if length <= slide:
        work = 0.0
        for axis in range(device.axes):
            before = bristle[axis]
            work += move[axis] * (before + move[axis] / 2.0)
            bristle[axis] = before + move[axis]
        return friction / width * work
    contact = along + slide
    work = friction / width * ((along + contact) / 2.0 * slide)
    ratio = (length - slide) / width  # the way that is left, in bristle lengths
    sine = across / width
    if sine > 1e-12:
        half = sine / (1.0 + contact / width)  # tan(angle / 2)
        end = half * math.exp(-ratio)
        work += friction * width * (ratio + math.log(sine * (1.0 + end * end) / (2.0 * half)))
        sine_end = 2.0 * end / (1.0 + end * end)
        cosine_end = (1.0 - end * end) / (1.0 + end * end)
        for axis in range(device.axes):
            direction = move[axis] / length
            normal = (bristle[axis] - along * direction) / across
            bristle[axis] = width * (cosine_end * direction + sine_end * normal)
        return work
    for axis in range(device.axes):
        bristle[axis] = width * move[axis] / length
    return work + friction * (length - slide)


@outlined
def given(device: Device, axis: int, work: float) -> float:
    """Return the ``work`` against a motor, in J, of which it may leave out what pays the hand."""
    if device.attenuates == 2:
        return max(device.least * work, min(work, 0.0))
    device.work[axis] += work
    return work


@outlined
def withheld(device: Device) -> float:
    """Let the force end; return the work, in J, that its motors may never have taken."""
    total = 0.0
    for axis in range(AXES):
        total += (
            max(device.work[axis], 0.0) * (1.0 - device.least) if device.attenuates == 1 else 0.0
        )
        device.work[axis] = 0.0
    return total


@outlined
def walk(device: Device, duration: float, move: Floats) -> float:
    """Move straight and uniformly by ``move`` in ``duration``; return the energy put in, in J."""
    energy = 0.0
    for axis in range(device.axes):
        speed = move[axis] / duration
        energy += device.damping[axis] * speed * move[axis]
        energy += given(device, axis, speed * impulse(device, axis, duration))
        energy += device.weight[axis] * move[axis]
        device.position[axis] += move[axis]
    if device.is_along_path:
        energy += work_along_path(device, move)
    else:
        for axis in range(device.axes):
            energy += work_of_axis(device, axis, move[axis])
    relax(device, duration)
    return energy


@outlined
def no_faster(move: Floats, duration: float, fastest: float) -> None:
    """Shorten ``move`` to what the hand can do in ``duration`` at its ``fastest``, m/s."""
    square = 0.0
    for axis in range(AXES):
        square += move[axis] * move[axis]
    most = fastest * duration
    if square > most * most:
        for axis in range(AXES):
            move[axis] *= most / math.sqrt(square)


@outlined
def worst_of_axis(device: Device, axis: int, force: float, duration: float) -> float:
    """Return the displacement, in m, that costs the hand least under a mean ``force`` of an axis.

    The slope of the cost, force + 2 b d / duration + friction(d), rises with d: its zero.
    """
    stiffness = 2.0 * device.damping[axis] / duration
    friction, width = device.friction[axis], device.presliding[axis]
    if width <= 0.0:
        return -math.copysign(max(abs(force) - friction, 0.0), force) / stiffness
    bristle = device.bristle[axis]
    elastic = friction / width
    move = -(force + elastic * bristle) / (stiffness + elastic)
    if abs(bristle + move) > width:
        friction = math.copysign(friction, bristle + move)
        move = -(force + friction) / stiffness
    return move


@outlined
def worst_move(devices: Devices, duration: float, move: Floats) -> None:
    """Put the uniform move of the first copy that costs the hand least in ``duration`` in ``move``.

    Exact for one axis and for friction of each axis by itself, and for a rigid friction along the
    path. With a vector of bristles the best length in the direction of the force is taken.
    """
    device, square = devices[1], 0.0
    for axis in range(device.axes):
        force = impulse(device, axis, duration) / duration + device.weight[axis]
        move[axis] = force
        square += force * force
    size = math.sqrt(square)
    if not device.is_along_path or device.axes == 1:
        for axis in range(device.axes):
            move[axis] = worst_of_axis(device, axis, move[axis], duration)
        return
    best = max(size - device.friction[0], 0.0) * duration / (2.0 * device.damping[0])
    if device.presliding[0] > 0.0:
        best = worst_length(devices, duration, move, size)
    for axis in range(device.axes):
        move[axis] *= -best / size if size > 0.0 else 0.0


@outlined
def worst_length(devices: Devices, duration: float, force: Floats, size: float) -> float:
    """Return the way against ``force`` of ``size`` that costs least, by golden sections."""
    golden = (math.sqrt(5.0) - 1.0) / 2.0
    low, high = 0.0, size * duration / (2.0 * devices[1].damping[0])
    move, costs = np.empty(AXES), np.empty(2)
    for _ in range(24):
        for side in range(2):
            share = 1.0 - golden if side == 0 else golden
            length = low + share * (high - low)
            for axis in range(AXES):
                move[axis] = -force[axis] / size * length if size > 0.0 else 0.0
            devices[2] = devices[1]
            costs[side] = walk(devices[2], duration, move)
        width = golden * (high - low)
        if costs[0] < costs[1]:
            high = low + width
        else:
            low = high - width
    return (low + high) / 2.0


@outlined
def worst_end(
    devices: Devices, duration: float, pieces: int, burst: float = 0.0
) -> tuple[float, float]:
    """Let the first copy walk the worst path; return the energy at its end and the lowest, in J.

    No piece is longer than what the hand can do in ``burst``, s, or in its own time.
    """
    move = np.zeros(AXES)
    energy = lowest = 0.0
    for _ in range(pieces):
        worst_move(devices, duration / pieces, move)
        no_faster(move, max(duration / pieces, burst), devices[1].fastest)
        energy += walk(devices[1], duration / pieces, move)
        lowest = min(lowest, energy)
    return energy, lowest


@outlined
def worst_hold(
    devices: Devices, dues: Vector, forces: Sequence[Vector], holds: Vector, cut_after: float
) -> float:
    """Return the lowest energy, in J, that the hand can still reach before the force is dropped.

    Args:
        devices: The device at a reading, which is not changed, and its copies.
        dues: When each of the forces on their way acts, s after the reading, shape ``(n,)``.
        forces: These forces, N, shape ``(n, 3)``; the last one is the new one.
        holds: How long the watchdog lets each act, s, shape ``(n,)``.
        cut_after: Time until it drops the force that acts now, s.
    """
    lag, lowest = devices[0].lag, 0.0
    last = 2 * len(dues) + 1
    for whole in range(2 if lag > 0.0 else 1):
        pieces = PIECES if lag > 0.0 and whole == 0 else 1
        devices[1] = devices[0]
        device, energy = devices[1], 0.0
        for phase in range(last + 1):  # each force, then nothing until the next one
            place, duration = phase // 2, 0.0
            begin = dues[place - 1] if place > 0 else 0.0
            gap = dues[place] - begin if place < len(dues) else math.inf
            held = min(gap, holds[place - 1] if place > 0 else cut_after)
            if phase % 2 == 0:
                if place > 0:
                    set_force(device, forces[place - 1])
                duration = held
            elif phase < last:
                if held < gap:
                    cut(device)
                duration = gap - held
            elif lag > 0.0:  # dropped, or replaced by none: a weight stays compensated
                set_force(device, np.zeros(AXES))
                duration = 3.0 * lag
            if duration <= 0.0:
                continue
            # The rest of the force that acts now is no hold of its own: the hand has been moving.
            burst = device.burst if phase > 0 and pieces == 1 else 0.0
            end, low = worst_end(devices, duration, pieces, burst)
            lowest = min(lowest, energy + low)
            energy += end
    return lowest


@outlined
def worst_guarded_hold(devices: Devices, write_after: float, force: Vector) -> float:
    """Return the lowest energy, in J, in a long hold that is guarded.

    The hand moves back by 2r, which the readings can hide, on all axes or on one of them, slowly;
    then as far as it pays before the watchdog has looked again and dropped the force. Arguments as
    of :func:`worst_hold`.
    """
    lowest = 0.0
    for chosen in range(-1, devices[0].axes):
        devices[1] = devices[0]
        device, energy = devices[1], 0.0
        if write_after > 0.0:
            energy = worst_end(devices, write_after, 1)[0]
        set_force(device, force)
        move = np.zeros(AXES)
        for axis in range(device.axes):
            if chosen < 0 or chosen == axis:
                move[axis] = -math.copysign(2.0 * device.error[axis], force[axis])
        no_faster(move, STALL, device.fastest)
        energy += walk(device, STALL, move)
        lowest = min(lowest, energy)
        lowest = min(
            lowest, energy + worst_end(devices, device.guard + device.drop, 1, device.burst)[1]
        )
    return lowest
