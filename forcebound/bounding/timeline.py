"""What a bounder remembers, as an array of numbers, and the run of time in it.

Between two calls of a bounder everything lies in one array (``rows``), which compiled functions
take over without copying: first the numbers named here, then the memory of all axes, then a block
for each axis. The functions here let time pass: the old force acts until the new one takes effect,
the watchdog may drop it.
"""

import math

from forcebound.bounding.hold_cost import hold_cost, rigid_cost
from forcebound.bounding.sample import (
    AXIS_ROWS,
    DEVICE_ROWS,
    MEMORY_ROWS,
    AxisConstants,
    AxisMemory,
    DeviceConstants,
    Floats,
)
from forcebound.bounding.waveform import MOTOR_ROWS, load_motor, retarget, run, store_motor

# Settings.
SATURATION, ENDS, GAIN, LAG, WRITE_DELAY, WATCHDOG, TOLERANCE, WATCHDOG_LIMIT = range(8)
ALLOWANCE, IS_RIGID, IS_ALONG_PATH, PLANNED_LIMIT, PATH_ERROR = range(8, 13)
#: Values of ``WATCHDOG``.
SILENT, REPORTING, NONE, GUARDING = 0.0, 1.0, 2.0, 3.0
# The law: state and energy available for the next hold, at the least and the largest gain.
STATE, AVAILABLE = 13, 15
HELD_PRICE = 17  # J, of the last reading that was taken in
SPENT = 18  # J, the most that the force since that reading can have given
SINCE = 19  # s, since that reading
# The force that acts: its age, when it will be dropped (or inf), what it was planned for.
AGE, UNTIL_CUT, HELD_LIMIT, BUDGET, IS_DROPPED = range(20, 25)
# The force that was written and will act: when (or -1), and what it is planned for.
UNTIL_WRITE, PENDING_LIMIT, PENDING_BUDGET = range(25, 28)
LARGEST_LEAK = 28  # J, the most that a late hold can have given
IS_UNSURE = 29  # whether the watchdog may have dropped the force since the last reading
RESOLUTION = 30  # m, length of the vector of the axes' resolutions
GIVEN = 31  # J, the most that the acting force can have given since it took effect
DEVICE = 32
PATH_FRICTION = DEVICE + DeviceConstants._fields.index("path_friction")
MEMORY = DEVICE + DEVICE_ROWS
AXES = MEMORY + MEMORY_ROWS
# Places in the block of an axis, which begins with its AxisMemory.
FORCE = AxisMemory._fields.index("force")
MOTOR = AXIS_ROWS
CONSTANTS = MOTOR + MOTOR_ROWS
CONSTANT_ROWS = len(AxisConstants._fields)
PENDING = CONSTANTS + CONSTANT_ROWS  # N, force that was written
WANTED = PENDING + 1  # N, or a direction: what a cost is asked of
ORIGIN = PENDING + 2  # m, reading at the start
WORK = PENDING + 3  # J, in the ledger, of this axis: less the prices that grow with the gain
BLOCK = PENDING + 4


def load_constants(rows: Floats, axis: int) -> AxisConstants:
    """Return the constants of an axis from ``rows``."""
    first = AXES + axis * BLOCK + CONSTANTS
    return AxisConstants(
        rows[first],
        rows[first + 1],
        rows[first + 2],
        rows[first + 3],
        rows[first + 4],
        rows[first + 5],
        rows[first + 6],
    )


def advance(rows: Floats, axes: int, duration: float) -> None:
    """Let ``duration`` pass, in s: forces take effect and are dropped on the way."""
    left = duration
    while left > 0.0:
        piece = min(left, rows[UNTIL_CUT])
        is_pending = rows[UNTIL_WRITE] >= 0.0
        if is_pending:
            piece = min(piece, rows[UNTIL_WRITE])
        _run_motors(rows, axes, piece)
        left -= piece
        if is_pending:
            rows[UNTIL_WRITE] -= piece
            if rows[UNTIL_WRITE] <= 0.0:
                take_effect(rows, axes)
        if rows[UNTIL_CUT] <= 0.0 and left > 0.0:
            drop(rows, axes)


def _run_motors(rows: Floats, axes: int, piece: float) -> None:
    """Let ``piece`` pass, in s, in which nothing happens."""
    cost = acting_cost(rows, axes, piece, 1.0 + rows[GAIN])
    rows[GIVEN] += cost
    for axis in range(axes):
        first = AXES + axis * BLOCK + MOTOR
        store_motor(rows, first, run(load_motor(rows, first), piece, rows[LAG]))
    rows[AGE] += piece
    rows[SINCE] += piece
    rows[UNTIL_CUT] -= piece
    if rows[WATCHDOG] == NONE and rows[AGE] > rows[HELD_LIMIT] and rows[IS_DROPPED] == 0.0:
        rows[LARGEST_LEAK] = max(rows[LARGEST_LEAK], rows[GIVEN] - max(rows[BUDGET], 0.0))
    if may_be_dropped(rows):
        rows[IS_UNSURE] = 1.0
        cost += dropped_cost(rows, axes, piece)
    rows[SPENT] += cost


def may_be_dropped(rows: Floats) -> bool:
    """Whether the watchdog may, or may not yet, have dropped the acting force.

    A reporting watchdog that is late with its report is not believed to have held the force; a
    guarding one, which need not drop it, is.
    """
    if rows[IS_DROPPED] == 1.0 or rows[WATCHDOG] == NONE or rows[WATCHDOG] == GUARDING:
        return False
    if rows[WATCHDOG] == SILENT and rows[TOLERANCE] == 0.0:
        return False
    return bool(rows[AGE] > rows[HELD_LIMIT] * (1.0 - rows[TOLERANCE]))


def take_effect(rows: Floats, axes: int) -> None:
    """Let the force act that was written last."""
    for axis in range(axes):
        block = AXES + axis * BLOCK
        _retarget(rows, block + MOTOR, rows[block + PENDING])
    limit = rows[PENDING_LIMIT]
    rows[AGE] = rows[GIVEN] = rows[IS_DROPPED] = 0.0
    rows[HELD_LIMIT], rows[BUDGET], rows[UNTIL_WRITE] = limit, rows[PENDING_BUDGET], -1.0
    if rows[WATCHDOG] == SILENT:
        rows[UNTIL_CUT] = limit * (1.0 + rows[TOLERANCE])
    elif rows[WATCHDOG] == NONE:
        rows[UNTIL_CUT] = rows[WATCHDOG_LIMIT]
    else:  # it will be reported
        rows[UNTIL_CUT] = math.inf


def drop(rows: Floats, axes: int) -> None:
    """Let the watchdog drop the force."""
    for axis in range(axes):
        block = AXES + axis * BLOCK
        _retarget(rows, block + MOTOR, load_constants(rows, axis).dropped)
    rows[UNTIL_CUT], rows[IS_DROPPED] = math.inf, 1.0


def _retarget(rows: Floats, first: int, target: float) -> None:
    is_first = rows[SINCE] == 0.0
    store_motor(rows, first, retarget(load_motor(rows, first), target, rows[LAG], is_first))


def acting_cost(rows: Floats, axes: int, duration: float, gain: float) -> float:
    """Return the most that the acting force can give in ``duration``, in s, in J."""
    total = square = 0.0
    for axis in range(axes):
        motor = load_motor(rows, AXES + axis * BLOCK + MOTOR)
        force = gain * max(abs(motor.target), abs(motor.actual))
        if rows[IS_ALONG_PATH] == 0.0:
            total += axis_cost(load_constants(rows, axis), force, duration)
        square += force * force
    if rows[IS_ALONG_PATH] == 0.0:
        return total
    return path_cost(rows, math.sqrt(square), duration)


def dropped_cost(rows: Floats, axes: int, duration: float) -> float:
    """Return the most that weights which are not carried can give in ``duration``, in s, in J."""
    total = square = 0.0
    for axis in range(axes):
        one = load_constants(rows, axis)
        if rows[IS_ALONG_PATH] == 0.0:
            total += axis_cost(one, abs(one.dropped), duration)
        square += one.dropped * one.dropped
    if square == 0.0 or rows[IS_ALONG_PATH] == 0.0:
        return total
    return path_cost(rows, math.sqrt(square), duration)


def path_cost(rows: Floats, force: float, duration: float) -> float:
    """Return the cost of a hold with friction along the path, in J; all axes alike."""
    one = load_constants(rows, 0)
    friction = rows[PATH_FRICTION]
    return rigid_cost(force + rows[PATH_ERROR], friction, one.damping, duration)


def axis_cost(one: AxisConstants, force: float, duration: float) -> float:
    """Return the cost of a hold of a force on one axis, in J; friction on each axis by itself."""
    force += one.weight_error
    if one.presliding == 0.0:
        return rigid_cost(force, one.friction, one.damping, duration)
    return hold_cost(force, one.friction, one.presliding, one.damping, duration)
