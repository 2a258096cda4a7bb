"""The largest force for which a hold costs no more than the ledger can pay.

For rigid friction in one direction this is a formula (``rigid_force``). With a lag, presliding, or
axes that differ, it is found by bisection along the commanded direction, from the safe side: the
cost grows with the force.

Without a watchdog there are two conditions: a hold of the hold limit may cost what the ledger has,
one as long as the force can stay on may cost the allowance more.
"""

import math

from forcebound.bounding.hold_cost import lagging_cost, rigid_force
from forcebound.bounding.sample import Floats
from forcebound.bounding.timeline import (
    ALLOWANCE,
    AVAILABLE,
    AXES,
    BLOCK,
    ENDS,
    GAIN,
    IS_ALONG_PATH,
    IS_RIGID,
    LAG,
    MOTOR,
    NONE,
    PATH_ERROR,
    PATH_FRICTION,
    PLANNED_LIMIT,
    SATURATION,
    TOLERANCE,
    WANTED,
    WATCHDOG,
    WATCHDOG_LIMIT,
    WRITE_DELAY,
    axis_cost,
    load_constants,
    path_cost,
)
from forcebound.bounding.waveform import load_motor

HALVINGS = 40  # of the saturation: 8 pN


def gain_at(rows: Floats, end: int) -> float:
    """Return the gain at one end of its range, 0 or 1; 1 if it has no error."""
    return float(1.0 + (2.0 * end - 1.0) * rows[GAIN])


def largest_force(rows: Floats, axes: int) -> float:
    """Return the largest force in the direction in ``WANTED`` that may be held, in N."""
    low, high = 0.0, float(rows[SATURATION])
    if rows[IS_RIGID] == 1.0:
        for end in range(int(rows[ENDS])):
            for level in range(_levels(rows)):
                most = _largest_rigid(rows, end, _most(rows, end, level), _duration(rows, level))
                high = min(high, most)
        return high
    force = high
    for _ in range(HALVINGS):  # the saturation itself comes first
        if _may_be_held(rows, axes, force):
            low = force
        else:
            high = force
        force = 0.5 * (low + high)
    return low


def surplus(rows: Floats, axes: int, end: int) -> float:
    """Return what the force in ``WANTED`` leaves of the energy available, in J."""
    gain, left = gain_at(rows, end), math.inf
    for level in range(_levels(rows)):
        most = _most(rows, end, level)
        left = min(left, most - cost(rows, axes, gain, _duration(rows, level)))
    return left


def _levels(rows: Floats) -> int:
    """Conditions that a force meets: for a punctual hold and, without a watchdog, a late one."""
    return 2 if rows[WATCHDOG] == NONE else 1


def _most(rows: Floats, end: int, level: int) -> float:
    """Most that a hold may cost, in J."""
    return float(rows[AVAILABLE + end] + level * rows[ALLOWANCE])


def _duration(rows: Floats, level: int) -> float:
    """How long it can last, in s."""
    return float(rows[WATCHDOG_LIMIT]) if level == 1 else planned_hold(rows)


def planned_hold(rows: Floats) -> float:
    """Return how long the next force must be expected to last, in s, if it is punctual."""
    if rows[WATCHDOG] == NONE:
        return float(rows[PLANNED_LIMIT])
    return float(rows[PLANNED_LIMIT] * (1.0 + rows[TOLERANCE]))


def _largest_rigid(rows: Floats, end: int, available: float, duration: float) -> float:
    one = load_constants(rows, 0)
    friction, error = one.friction, one.weight_error
    if rows[IS_ALONG_PATH] == 1.0:
        friction, error = rows[PATH_FRICTION], rows[PATH_ERROR]
    force = rigid_force(available, friction, one.damping, duration) - error
    return max(force, 0.0) / gain_at(rows, end)


def _may_be_held(rows: Floats, axes: int, force: float) -> bool:
    """Whether ``force`` in the direction in ``WANTED`` costs at most what there is.

    In deficit it may cost what no force at all does: the rest of the old one, paid for before.
    """
    for end in range(int(rows[ENDS])):
        scale = force * gain_at(rows, end)
        for level in range(_levels(rows)):
            duration = _duration(rows, level)
            most = max(_most(rows, end, level), cost(rows, axes, 0.0, duration))
            if cost(rows, axes, scale, duration) > most:
                return False
    return True


def cost(rows: Floats, axes: int, scale: float, duration: float) -> float:
    """Return what a hold of ``scale`` times the force in ``WANTED`` can cost, in J."""
    lag = rows[LAG]
    total = square = before_square = 0.0
    for axis in range(axes):
        block = AXES + axis * BLOCK
        one = load_constants(rows, axis)
        force = abs(scale * rows[block + WANTED])
        if rows[IS_ALONG_PATH] == 1.0:
            square += force * force
            before = _strongest(rows, block)
            before_square += before * before
        elif lag > 0.0:
            error = one.weight_error - (one.friction if one.presliding == 0.0 else 0.0)
            before = max(_strongest(rows, block) + error, 0.0)
            after = max(force + error, 0.0)
            total += lagging_cost(before, after, one.damping, duration, lag)
        else:
            total += axis_cost(one, force, duration)
    if rows[IS_ALONG_PATH] == 0.0:
        return total
    if lag == 0.0:
        return path_cost(rows, math.sqrt(square), duration)
    error = rows[PATH_ERROR] - rows[PATH_FRICTION]
    before = max(math.sqrt(before_square) + error, 0.0)
    after = max(math.sqrt(square) + error, 0.0)
    return lagging_cost(before, after, load_constants(rows, 0).damping, duration, lag)


def _strongest(rows: Floats, block: int) -> float:
    """Return the largest force of the motor, in N, when the next takes effect."""
    motor = load_motor(rows, block + MOTOR)
    force = abs(motor.actual)
    if rows[WRITE_DELAY] > 0.0:
        force = max(force, abs(motor.target))
    return float(force * (1.0 + rows[GAIN]))
