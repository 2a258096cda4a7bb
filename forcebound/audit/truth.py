"""Ground truth of an attack on a certificate: energy along a chosen path, without inertia.

The tip moves on straight lines; between two events (a reading, a write, a cut by the watchdog) it
makes :data:`PIECES` of them. In each piece every term of the energy is known in closed form:

* viscous loss, b v² h;
* friction: f_c times the way, along the path or on each axis by itself. With presliding, the
  friction acts on a bristle: it follows the tip elastically over z_m, and then slides. The energy
  that it stores can come back, so it counts with what the hand has put in;
* work against the motor, whose force relaxes to the written one with the time constant of the
  amplifier's lag, and has an error of gain;
* work against a weight; the motor carries what it takes for the weight while it holds a force.

Inertia would only add: the energy that the hand puts in is this energy and the kinetic one.

Everything lies in few arrays of numbers, so that a compiled call from Python costs little.
"""

import math
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from forcebound.devices.plant import quantise

Floats: TypeAlias = NDArray[np.float64]
Integers: TypeAlias = NDArray[np.int64]

PIECES = 3  # straight lines between two events
NEVER = np.iinfo(np.int64).max // 2

# A device, shape (8, at least 6): rows with one number for each axis, and a row of shared numbers.
DAMPING, FRICTION, PRESLIDING, HALF_RESOLUTION, WEIGHT, CARRIED, GAIN, SHARED = range(8)
#: Columns of the shared numbers: whether friction acts on each axis by itself, the time constant of
#: the amplifier in s, the largest speed in m/s, the kind of reading error, the time between two
#: looks of a guarding watchdog in s, or 0, and how long after a look it drops the force, in s.
ON_EACH_AXIS, LAG, LARGEST_SPEED, SENSOR, GUARD_PERIOD, DROP_DELAY = range(6)

# A path, as far as it does not depend on the forces: for each sample a row of times, in ns: of the
# reading, of the write (-1: it is lost), how long after the write the watchdog drops the force and
# until when the hold is punctual, when in the interval before the sample the drift begins or ends,
# and 1 if it begins there.
READ, WRITE, CUT_AFTER, PUNCTUAL, REST, RESTS_FIRST = range(6)
#: And a row of numbers: speed as a share of that which takes the most energy, then for each of
#: three axes the drift in m/s, the way of a tremor in m, the commanded force in N, the reading
#: error in half resolutions.
THIEF, DRIFT, TREMOR, COMMANDED, ERROR = 0, 1, 4, 7, 10
CHOICES = 13

# The state of the device, shape (5, at least 4): rows with one number for each axis (m, m, N, N),
# and a row of energies, in J: now, at the last write, the lowest since the last reading, the most
# by which a punctual hold has brought it below zero and below what it was at the write.
POSITION, BRISTLE, MOTOR, WRITTEN, ENERGIES = range(5)
NOW, AT_WRITE, LOWEST, PUNCTUAL_FALL = range(4)
# Times of the device, in ns: of the coming cut, of the last one in this interval (0: none), when
# the hold is late, when a hold was first late, and when a force is gone after a look (0: no look).
CUT, WAS_CUT, LATE, FIRST_LATE, GONE = range(5)


class Motion(NamedTuple):
    """The state of the device: arrays with the rows and places named above."""

    state: Floats
    times: Integers


def start(axes: int, device: Floats) -> Motion:
    """Return the state at rest: bristles carry the weight that nothing compensates."""
    state = np.zeros((5, max(4, axes)))
    for i in range(axes):
        if device[PRESLIDING, i] > 0.0:
            stiffness = device[FRICTION, i] / device[PRESLIDING, i]
            state[BRISTLE, i] = -device[WEIGHT, i] / stiffness
    return Motion(state, np.full(5, NEVER))


def walk(
    n: int,
    axes: int,
    times: Integers,
    choices: Floats,
    device: Floats,
    force: Floats,
    state: Floats,
    events: Integers,
    readings: Floats,
) -> tuple[float, float, float, int]:
    """Go from reading ``n - 1`` to reading ``n``; ``force`` is the one written between them.

    Args:
        n: Sample, at least 1.
        axes: Number of axes.
        times: Of the path.
        choices: Numbers of the path.
        device: The device.
        force: In N.
        state: See :class:`Motion`; it changes.
        events: Times of the device, see :class:`Motion`; they change.
        readings: Of this sample, at the last look or cut of the watchdog, and when the force that
            acts began to act, shape (3, axes); they change.

    Returns:
        The energy; the lowest since the last reading; the most by which a punctual hold has brought
        it below zero and below what it was, in J; and the time of the last cut, in ns, or 0.
    """
    begin = now = times[n - 1, READ]
    end, write, rest = times[n, READ], times[n - 1, WRITE], times[n, REST]
    energies = state[ENERGIES]
    events[WAS_CUT] = 0
    energies[LOWEST], energies[PUNCTUAL_FALL] = energies[NOW], 0.0
    while True:
        if now == write:
            events[CUT], events[GONE] = write + times[n - 1, CUT_AFTER], 0
            events[LATE] = write + times[n - 1, PUNCTUAL]
            energies[AT_WRITE] = energies[NOW]
            for i in range(axes):
                state[WRITTEN, i] = force[i] - device[CARRIED, i]
            look(n, axes, choices, device, state, -1.0, readings[2])
        if now >= end:
            break
        guarded = now == events[CUT] and is_guarded(n, axes, choices, device, state, readings)
        if guarded and events[GONE] == 0:
            events[CUT] = now + max(round(device[SHARED, GUARD_PERIOD] * 1e9), 1)
        elif now == events[CUT] and events[GONE] == 0 and device[SHARED, DROP_DELAY] > 0.0:
            events[CUT] = events[GONE] = now + round(device[SHARED, DROP_DELAY] * 1e9)
        elif now == events[CUT]:
            events[WAS_CUT] = now
            for i in range(axes):
                state[WRITTEN, i] = 0.0
        until = end
        for event in (write, rest, events[CUT], events[LATE]):
            if now < event < until:
                until = event
        drifts = times[n, RESTS_FIRST] == (now >= rest)
        if until > events[LATE]:
            events[FIRST_LATE] = min(events[FIRST_LATE], now)
        lowest = lowest_of_hold(until, device, state, events)
        share = (until - now) / (end - begin)
        move(choices[n], axes, device, (until - now) * 1e-9, share, drifts, lowest, state)
        now = until
    read(n, axes, choices, device, state, readings[0])
    return energies[NOW], energies[LOWEST], energies[PUNCTUAL_FALL], events[WAS_CUT]


def is_guarded(
    n: int, axes: int, choices: Floats, device: Floats, state: Floats, readings: Floats
) -> bool:
    """Return whether the watchdog leaves the force on: it guards, and no axis has moved back."""
    look(n, axes, choices, device, state, 1.0, readings[1])
    moved_back = False
    for i in range(axes):
        force = state[WRITTEN, i] + device[CARRIED, i]
        moved_back = moved_back or force * (readings[1, i] - readings[2, i]) < 0.0
    return device[SHARED, GUARD_PERIOD] > 0.0 and not moved_back


def look(
    n: int,
    axes: int,
    choices: Floats,
    device: Floats,
    state: Floats,
    side: float,
    readings: Floats,
) -> None:
    """Read as the watchdog does; if it guards, wrong towards the force (1) or against it (-1).

    So the hand can move back as far as a reading can hide.
    """
    read(n, axes, choices, device, state, readings)
    if device[SHARED, GUARD_PERIOD] > 0.0 and device[SHARED, SENSOR] != 0.0:
        for i in range(axes):
            force = state[WRITTEN, i] + device[CARRIED, i]
            error = side * math.copysign(device[HALF_RESOLUTION, i], force)
            readings[i] = state[POSITION, i] + error


def lowest_of_hold(until: int, device: Floats, state: Floats, events: Integers) -> float:
    """Return what the energy must not fall below in this hold if it is punctual, in J.

    A motor with a lag goes on giving the force of a late hold after it, so there nothing is asked.
    """
    is_tail = device[SHARED, LAG] > 0.0 and until > events[FIRST_LATE]
    if until > events[LATE] or is_tail:
        return -math.inf
    return min(float(state[ENERGIES, AT_WRITE]), 0.0)


def move(
    choice: Floats,
    axes: int,
    device: Floats,
    duration: float,
    share: float,
    drifts: bool,
    lowest: float,
    state: Floats,
) -> None:
    """Move in straight lines for ``duration``, in s, which is a ``share`` of the interval.

    The energy must not fall below ``lowest``, in J; by how much it does is noted.
    """
    energies = state[ENERGIES]
    h = duration / PIECES
    step = np.empty(axes)
    for _ in range(PIECES):
        theft = choice[THIEF] * theft_factor(axes, device, state)
        square = 0.0
        for i in range(axes):
            velocity = choice[TREMOR + i] * (share / duration) + theft * best_theft(
                i, device, state
            )
            if drifts:
                velocity += choice[DRIFT + i]
            square += velocity * velocity
            step[i] = velocity * h
        speed = math.sqrt(square)
        if speed > device[SHARED, LARGEST_SPEED]:
            step *= device[SHARED, LARGEST_SPEED] / speed
        spent = work_of_motor(axes, device, step, h, state)
        spent += work_of_friction(axes, device, step, state)
        for i in range(axes):
            spent += device[DAMPING, i] * step[i] * step[i] / h + device[WEIGHT, i] * step[i]
            state[POSITION, i] += step[i]
        energies[NOW] += spent
        energies[LOWEST] = min(energies[LOWEST], energies[NOW])
        energies[PUNCTUAL_FALL] = min(energies[PUNCTUAL_FALL], energies[NOW] - lowest)


def theft_factor(axes: int, device: Floats, state: Floats) -> float:
    """Return the share of the force that friction along the path leaves; 1 if it acts on axes."""
    if device[SHARED, ON_EACH_AXIS] == 1.0:
        return 1.0
    square = 0.0
    for i in range(axes):
        force = state[MOTOR, i] + device[WEIGHT, i]
        square += force * force
    return max(1.0 - device[FRICTION, 0] / math.sqrt(square), 0.0) if square > 0.0 else 0.0


def best_theft(axis: int, device: Floats, state: Floats) -> float:
    """Return the velocity, in m/s, at which the motor's force gives the most energy away.

    Friction along the path is left to :func:`theft_factor`.
    """
    force = state[MOTOR, axis] + device[WEIGHT, axis]
    excess = abs(force)
    if device[SHARED, ON_EACH_AXIS] == 1.0:
        excess = max(excess - device[FRICTION, axis], 0.0)
    return -math.copysign(excess, force) / (2.0 * float(device[DAMPING, axis]))


def work_of_motor(axes: int, device: Floats, step: Floats, h: float, state: Floats) -> float:
    """Let the motor's force relax for ``h``, in s; return the work against it, in J."""
    lag, work = device[SHARED, LAG], 0.0
    for i in range(axes):
        target = device[GAIN, i] * state[WRITTEN, i]
        mean = target
        if lag > 0.0:
            passed = -math.expm1(-h / lag)
            mean += (state[MOTOR, i] - target) * passed * lag / h
            target = state[MOTOR, i] + (target - state[MOTOR, i]) * passed
        state[MOTOR, i] = target
        work += mean * step[i]
    return work


def work_of_friction(axes: int, device: Floats, step: Floats, state: Floats) -> float:
    """Move the bristles by ``step``, in m; return the energy lost or stored, in J.

    Of all ways to keep the bristles' ends within z_m of the tip, they go the shortest.
    """
    bristle, work = state[BRISTLE], 0.0
    if device[SHARED, ON_EACH_AXIS] == 1.0:
        for i in range(axes):
            way = device[PRESLIDING, i]
            length = bristle[i] + step[i]
            work += pull(device[FRICTION, i], way, abs(bristle[i]), abs(length))
            bristle[i] = min(max(length, -way), way)
        return work
    before = after = 0.0
    for i in range(axes):
        before += bristle[i] * bristle[i]
        bristle[i] += step[i]
        after += bristle[i] * bristle[i]
    before, after = math.sqrt(before), math.sqrt(after)
    if after > device[PRESLIDING, 0]:
        bristle[:axes] *= device[PRESLIDING, 0] / after
    return pull(device[FRICTION, 0], device[PRESLIDING, 0], before, after)


def pull(friction: float, presliding: float, before: float, length: float) -> float:
    """Return the energy, in J, that friction takes when its bristle is pulled to ``length``, in m.

    What it had stored ``before``, in m, comes back; what is longer than ``presliding`` slides.
    """
    if presliding <= 0.0:
        return friction * length
    kept = min(length, presliding)
    stored = (kept * kept - before * before) / (2.0 * presliding)
    return friction * (length - kept + stored)


def read(
    n: int, axes: int, choices: Floats, device: Floats, state: Floats, readings: Floats
) -> None:
    """Read each axis at sample ``n``, at most half a resolution wrong."""
    sensor = device[SHARED, SENSOR]
    for i in range(axes):
        r, x, error = device[HALF_RESOLUTION, i], state[POSITION, i], choices[n, ERROR + i]
        if sensor == 0.0:
            readings[i] = quantise(x, 2.0 * r)
        elif sensor == 1.0:
            readings[i] = x + r * error
        elif sensor == 2.0:
            readings[i] = x + math.copysign(r, error)
        elif sensor == 3.0:
            readings[i] = x + math.copysign(r, choices[n, DRIFT + i] - state[WRITTEN, i])
        else:
            readings[i] = x - math.copysign(r, choices[n, COMMANDED + i] - state[WRITTEN, i])
