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
* The worst end of a hold (:func:`strike`) is found piece by piece, again on straight pieces, so it
  is the energy of a path that exists, never an estimate.

Arrays have a row for each quantity and a column for each axis (``BODY``, ``DEVICE``); units are SI.
"""

import math
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from forcebound.compiled import outlined

Floats: TypeAlias = NDArray[np.float64]

AXES = 3  # columns of the arrays; fewer axes leave the last ones at zero

# Rows of the state of a device.
POSITION, BRISTLE, OUTPUT, TARGET = range(4)  # m, m, N, N
BODY_ROWS = 4

# Rows of its properties.
DAMPING, FRICTION, PRESLIDING, GAIN, ERROR, WEIGHT, COMPENSATION = range(7)  # SI units
DEVICE_ROWS = 7

# Places of its other numbers.
# s; 1: friction acts along the path; number of axes; 1: an arm, moved at its tip; m/s; s between
# two looks of a guarding watchdog, or 0; s from a look that has seen something to the drop.
LAG, ALONG_PATH, USED_AXES, AT_TIP, FASTEST, GUARD, DROP = range(7)
NUMBERS = 7

#: Pieces into which the worst end of a hold is cut when the force changes within it.
PIECES = 6

STALL = 1.0  # s, of a late hold that is guarded


@outlined
def impulse(body: Floats, device: Floats, lag: float, axis: int, duration: float) -> float:
    """Return the time integral of the motor force of an axis over the next ``duration``, in N s."""
    target = body[TARGET, axis]
    integral = target * duration
    if lag > 0.0:
        integral -= (body[OUTPUT, axis] - target) * lag * math.expm1(-duration / lag)
    return float(device[GAIN, axis] * integral)


@outlined
def relax(body: Floats, lag: float, duration: float) -> None:
    """Let the amplifier settle towards its target for ``duration``."""
    share = math.exp(-duration / lag) if lag > 0.0 else 0.0
    for axis in range(AXES):
        target = body[TARGET, axis]
        body[OUTPUT, axis] = target + (body[OUTPUT, axis] - target) * share


@outlined
def work_of_axis(body: Floats, device: Floats, axis: int, move: float) -> float:
    """Move the bristle of one axis; return the work against friction, stored or lost, in J."""
    friction, width = device[FRICTION, axis], device[PRESLIDING, axis]
    if width <= 0.0:
        return float(friction * abs(move))
    before = body[BRISTLE, axis]
    after = min(max(before + move, -width), width)
    body[BRISTLE, axis] = after
    stored = friction / width * (after * after - before * before) / 2.0
    return float(stored + friction * (abs(move) - abs(after - before)))


@outlined
def work_along_path(body: Floats, device: Floats, axes: int, move: Floats) -> float:
    """Move the bristle of a friction that acts along the path; return the work, in J."""
    friction, width = device[FRICTION, 0], device[PRESLIDING, 0]
    length = along = square = 0.0
    for axis in range(axes):
        length += move[axis] * move[axis]
    length = math.sqrt(length)
    if width <= 0.0 or length <= 0.0:
        return float(friction * length)
    for axis in range(axes):
        along += body[BRISTLE, axis] * move[axis] / length
        square += body[BRISTLE, axis] * body[BRISTLE, axis]
    across = math.sqrt(max(square - along * along, 0.0))
    slide = math.sqrt(max(width * width - across * across, 0.0)) - along
    if length <= slide:
        work = 0.0
        for axis in range(axes):
            before = body[BRISTLE, axis]
            work += move[axis] * (before + move[axis] / 2.0)
            body[BRISTLE, axis] = before + move[axis]
        return float(friction / width * work)
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
        for axis in range(axes):
            direction = move[axis] / length
            normal = (body[BRISTLE, axis] - along * direction) / across
            body[BRISTLE, axis] = width * (cosine_end * direction + sine_end * normal)
        return float(work)
    for axis in range(axes):
        body[BRISTLE, axis] = width * move[axis] / length
    return float(work + friction * (length - slide))


def stored_energy(body: Floats, device: Floats) -> float:
    """Return the energy of the bent bristles, in J."""
    widths = np.maximum(device[PRESLIDING], 1e-300)
    return float(np.sum(device[FRICTION] / widths * body[BRISTLE] ** 2) / 2.0)


@outlined
def walk(body: Floats, device: Floats, numbers: Floats, duration: float, move: Floats) -> float:
    """Move straight and uniformly by ``move`` in ``duration``; return the energy put in, in J."""
    axes, lag = int(numbers[USED_AXES]), numbers[LAG]
    energy = 0.0
    for axis in range(axes):
        speed = move[axis] / duration
        energy += device[DAMPING, axis] * speed * move[axis]
        energy += speed * impulse(body, device, lag, axis, duration)
        energy += device[WEIGHT, axis] * move[axis]
        body[POSITION, axis] += move[axis]
    if numbers[ALONG_PATH] > 0.0:
        energy += work_along_path(body, device, axes, move)
    else:
        for axis in range(axes):
            energy += work_of_axis(body, device, axis, move[axis])
    relax(body, lag, duration)
    return float(energy)


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
def worst_of_axis(body: Floats, device: Floats, axis: int, force: float, duration: float) -> float:
    """Return the displacement, in m, that costs the hand least under a mean ``force`` of an axis.

    The slope of the cost, force + 2 b d / duration + friction(d), rises with d: its zero.
    """
    stiffness = 2.0 * device[DAMPING, axis] / duration
    friction, width = device[FRICTION, axis], device[PRESLIDING, axis]
    if width <= 0.0:
        return float(-math.copysign(max(abs(force) - friction, 0.0), force) / stiffness)
    bristle = body[BRISTLE, axis]
    elastic = friction / width
    move = -(force + elastic * bristle) / (stiffness + elastic)
    if abs(bristle + move) > width:
        friction = math.copysign(friction, bristle + move)
        move = -(force + friction) / stiffness
    return float(move)


@outlined
def worst_move(
    body: Floats, device: Floats, numbers: Floats, duration: float, move: Floats
) -> None:
    """Put the uniform move that costs the hand least in ``duration`` into ``move``.

    Exact for one axis and for friction of each axis by itself, and for a rigid friction along the
    path. With a vector of bristles the best length in the direction of the force is taken.
    """
    axes, lag = int(numbers[USED_AXES]), numbers[LAG]
    square = 0.0
    for axis in range(axes):
        force = impulse(body, device, lag, axis, duration) / duration + device[WEIGHT, axis]
        move[axis] = force
        square += force * force
    size = math.sqrt(square)
    if numbers[ALONG_PATH] == 0.0 or axes == 1:
        for axis in range(axes):
            move[axis] = worst_of_axis(body, device, axis, move[axis], duration)
        return
    friction = device[FRICTION, 0]
    best = max(size - friction, 0.0) * duration / (2.0 * device[DAMPING, 0])
    if device[PRESLIDING, 0] > 0.0:
        best = worst_length(body, device, numbers, duration, move, size)
    for axis in range(axes):
        move[axis] *= -best / size if size > 0.0 else 0.0


@outlined
def worst_length(
    body: Floats, device: Floats, numbers: Floats, duration: float, force: Floats, size: float
) -> float:
    """Return the way against ``force`` of ``size`` that costs least, by golden sections."""
    golden = (math.sqrt(5.0) - 1.0) / 2.0
    low, high = 0.0, size * duration / (2.0 * device[DAMPING, 0])
    move = np.empty(AXES)
    costs = np.empty(2)
    for _ in range(24):
        for side in range(2):
            share = 1.0 - golden if side == 0 else golden
            length = low + share * (high - low)
            for axis in range(AXES):
                move[axis] = -force[axis] / size * length if size > 0.0 else 0.0
            costs[side] = walk(body.copy(), device, numbers, duration, move)
        width = golden * (high - low)
        if costs[0] < costs[1]:
            high = low + width
        else:
            low = high - width
    return float((low + high) / 2.0)


@outlined
def worst_end(
    body: Floats, device: Floats, numbers: Floats, duration: float, pieces: int
) -> tuple[float, float]:
    """Walk the worst path for ``duration``; return the energy at its end and the lowest, in J."""
    move = np.zeros(AXES)
    energy = lowest = 0.0
    for _ in range(pieces):
        worst_move(body, device, numbers, duration / pieces, move)
        no_faster(move, duration / pieces, numbers[FASTEST])
        energy += walk(body, device, numbers, duration / pieces, move)
        lowest = min(lowest, energy)
    return energy, lowest


@outlined
def strike(
    body: Floats,
    device: Floats,
    numbers: Floats,
    write_after: float,
    cut_after: float,
    force: Floats,
    hold: float,
) -> float:
    """Return the lowest energy, in J, that the hand can still reach before the force is dropped.

    Args:
        body: The state now, at a reading; it is not changed.
        device: Properties of the device.
        numbers: The other numbers.
        write_after: Time from the reading to the write, s; the old force acts so long.
        cut_after: Time until the watchdog drops the old force, s.
        force: What will be written, N.
        hold: How long it is held, s.
    """
    lag = numbers[LAG]
    lowest = 0.0
    for whole in range(2 if lag > 0.0 else 1):
        pieces = PIECES if lag > 0.0 and whole == 0 else 1
        state = body.copy()
        energy = 0.0
        first = min(write_after, cut_after)
        for phase in range(4):
            duration = 0.0
            if phase == 0:
                duration = first
            elif phase == 1:
                if cut_after < write_after:
                    state[TARGET] = 0.0
                    if lag <= 0.0:
                        state[OUTPUT] = 0.0
                duration = write_after - first
            elif phase == 2:
                state[TARGET] = force - device[COMPENSATION]
                if lag <= 0.0:
                    state[OUTPUT] = state[TARGET]
                duration = hold
            elif lag > 0.0:
                state[TARGET] = 0.0
                duration = 3.0 * lag
            if duration <= 0.0:
                continue
            end, low = worst_end(state, device, numbers, duration, pieces)
            lowest = min(lowest, energy + low)
            energy += end
    return lowest


@outlined
def strike_guarded(
    body: Floats, device: Floats, numbers: Floats, write_after: float, force: Floats
) -> float:
    """Return the lowest energy, in J, in a long hold that is guarded.

    The hand moves back by 2r, which the readings can hide, on all axes or on one of them, slowly;
    then as far as it pays before the watchdog has looked again and dropped the force.

    Args:
        body: The state now, at a reading; it is not changed.
        device: Properties of the device.
        numbers: The other numbers.
        write_after: Time from the reading to the write, s; the old force acts so long.
        force: What will be written, N.
    """
    axes, lowest = int(numbers[USED_AXES]), 0.0
    for chosen in range(-1, axes):
        state, energy = body.copy(), 0.0
        if write_after > 0.0:
            energy = worst_end(state, device, numbers, write_after, 1)[0]
        state[TARGET] = force - device[COMPENSATION]
        state[OUTPUT] = state[TARGET]
        move = np.zeros(AXES)
        for axis in range(axes):
            if chosen < 0 or chosen == axis:
                move[axis] = -math.copysign(2.0 * device[ERROR, axis], force[axis])
        no_faster(move, STALL, numbers[FASTEST])
        energy += walk(state, device, numbers, STALL, move)
        lowest = min(lowest, energy)
        left = numbers[GUARD] + numbers[DROP]
        lowest = min(lowest, energy + worst_end(state, device, numbers, left, 1)[1])
    return lowest
