"""Paths of an attack: genes, what they mean in each interval, and the worst readings.

A run has a row of genes for each interval between two readings. :func:`plan_of` turns them into
times, moves and commands; :func:`tick` lets the device go through one interval. The hand knows the
force before it moves: its moves are shares of the move that costs it least (``STRIKE``), and on top
of them multiples of the encoder's error (``MICRO``), a speed, and a turn within the hold.
"""

import math
from dataclasses import dataclass

import numpy as np

from forcebound.compiled import outlined
from forcebound.lab.paths import truth as at
from forcebound.lab.paths.arm import walk_at_tip
from forcebound.lab.paths.truth import AXES, Floats, no_faster, strike, strike_guarded, walk

# Columns of genes and of a plan.
DURATION, WRITE, APPLIED, CUT, STRIKE_OLD, STRIKE, RETURN, TURN, SPLIT = range(9)
MICRO, SPEED, MISREAD, COMMAND = 9, 12, 15, 18  # three columns each
COLUMNS = 21

# How the encoder errs, always by at most r.
READINGS = ("genes", "stick", "lead", "trail", "push", "pull", "quantised", "edges")
# What the environment commands.
COMMANDS = ("genes", "along the motion", "against the motion", "alternating", "along the axis")

# Places of the record of a run.
ENERGY, LOWEST, STRUCK, PEAK, SHARE, LEFT, CUT_AFTER, CUT_TIME, LATE_STRUCK, FALLEN = range(10)
RECORD = 10

# Rows of what is remembered from tick to tick besides the body.
READING, COMMANDED, LAST_MOVE, AT_CUT, AT_WRITE = range(5)
SEEN_ROWS = 5

SMALLEST_PEAK = 1e-5  # J, of the energy; a share of less says nothing
LARGE_PEAK = 1e-4  # J; what is left after such a peak says how tight a law is


@dataclass(frozen=True)
class Manner:
    """How the genes of a run are read.

    Attributes:
        reading: Place in :data:`READINGS`.
        command: Place in :data:`COMMANDS`.
        clock: 0: each interval is the hold limit, 1: the period, 2: up to the hold limit, 3: also
            overruns up to ``longest``.
        speed: Of the hand, m/s, for a gene of 1.
        longest: Longest interval, s.
        saturation: Largest command, N.
        punctual: No hold lasts longer than the hold limit, from write to write.
    """

    reading: int
    command: int
    clock: int
    speed: float
    longest: float
    saturation: float
    punctual: bool = False


def plan_of(
    genes: Floats,
    manner: Manner,
    period: float,
    hold_limit: Floats,
    write_delay: float,
    way: Floats,
) -> Floats:
    """Return what the rows of ``genes`` mean, in SI units, shape ``(rows, COLUMNS)``.

    Args:
        genes: Any numbers; of the order of 1.
        manner: How to read them.
        period: T, s.
        hold_limit: T_max of the force of each row, s.
        write_delay: Largest time from reading to writing, s.
        way: Unit of ``MICRO`` and ``TURN`` for each axis, m.
    """
    plan = genes.copy()
    shape = np.clip(genes[:, DURATION], -3.0, 3.0)
    exact = np.round(hold_limit * 1e9)
    if manner.clock == 0:
        nanoseconds = exact
    elif manner.clock == 1:
        nanoseconds = np.full(len(genes), float(round(period * 1e9)))
    else:
        up = manner.longest if manner.clock == 3 else hold_limit
        # Below -1: down to 1 us; within ±1: the hold limit; above: longer, by 1 ns or more.
        short = exact * (1000.0 / exact) ** np.maximum(-shape - 1.0, 0.0)
        long = np.maximum(exact + 1.0, exact * (up / hold_limit) ** ((shape - 1.0) / 2.0))
        nanoseconds = np.where(shape < 1.0, short, long if manner.clock == 3 else exact)
        nanoseconds = np.floor(np.clip(nanoseconds, 1000.0, np.maximum(up * 1e9, exact)))
    if manner.punctual:
        nanoseconds = np.minimum(nanoseconds, exact - math.ceil(write_delay * 1e9))
    plan[:, DURATION] = nanoseconds
    share = np.clip(np.abs(genes[:, WRITE]), 0.0, 1.0)
    plan[:, WRITE] = np.floor(np.minimum(share * write_delay * 1e9, nanoseconds))
    plan[:, APPLIED] = np.clip(2.0 - np.abs(genes[:, APPLIED]), 0.0, 1.0)
    plan[:, CUT] = np.clip(genes[:, CUT], -1.0, 1.0)
    plan[:, SPLIT] = np.clip(0.5 + genes[:, SPLIT] / 4.0, 0.05, 1.0)
    plan[:, TURN] = way[0] * genes[:, TURN] ** 3
    plan[:, MICRO : MICRO + AXES] = way * genes[:, MICRO : MICRO + AXES] ** 3
    plan[:, SPEED : SPEED + AXES] = manner.speed * np.clip(
        genes[:, SPEED : SPEED + AXES] ** 3, -1.0, 1.0
    )
    plan[:, MISREAD : MISREAD + AXES] = np.clip(1.5 * genes[:, MISREAD : MISREAD + AXES], -1.0, 1.0)
    plan[:, COMMAND : COMMAND + AXES] = manner.saturation * np.clip(
        3.0 * genes[:, COMMAND : COMMAND + AXES], -1.0, 1.0
    )
    return plan


@outlined
def misread(
    mode: int, axis: int, body: Floats, device: Floats, seen: Floats, share: float
) -> float:
    """Return a reading that is wrong by at most r, in m."""
    position, error = body[at.POSITION, axis], device[at.ERROR, axis]
    force = body[at.TARGET, axis] + device[at.WEIGHT, axis]
    if mode == 1:
        return float(min(max(seen[READING, axis], position - error), position + error))
    if mode == 2:
        return float(position + math.copysign(error, seen[LAST_MOVE, axis]))
    if mode == 3:
        return float(position - math.copysign(error, seen[LAST_MOVE, axis]))
    if mode == 4:
        return float(position + math.copysign(error, force))
    if mode == 5:
        return float(position - math.copysign(error, force))
    if mode == 6 and error > 0.0:
        return float(2.0 * error * math.floor(position / (2.0 * error) + 0.5))
    if mode == 7:
        return float(position + math.copysign(error, share))
    return float(position + error * share)


@outlined
def command_of(mode: int, axis: int, index: int, seen: Floats, plan: Floats) -> float:
    """Return the command of an axis for the next reading, in N."""
    command = plan[index, COMMAND + axis]
    if mode == 1:
        return float(math.copysign(command, -seen[LAST_MOVE, axis]))
    if mode == 2:
        return float(math.copysign(command, seen[LAST_MOVE, axis]))
    if mode == 3:
        return float(abs(command) * (1.0 - 2.0 * (index % 2)))
    if mode == 4:
        return float(command if axis == 0 else 0.0)
    return float(command)


@outlined
def worst_way(device: Floats, numbers: Floats, force: Floats, duration: float, way: Floats) -> None:
    """Put the move that costs least under a constant ``force``, rigid friction, into ``way``."""
    axes = int(numbers[at.USED_AXES])
    square = 0.0
    for axis in range(axes):
        way[axis] = device[at.GAIN, axis] * force[axis]
        square += way[axis] * way[axis]
    size = math.sqrt(square)
    for axis in range(axes):
        if numbers[at.ALONG_PATH] > 0.0:
            share = max(1.0 - device[at.FRICTION, 0] / size, 0.0) if size > 0.0 else 0.0
            way[axis] *= -share * duration / (2.0 * device[at.DAMPING, axis])
        else:
            excess = max(abs(way[axis]) - device[at.FRICTION, axis], 0.0)
            way[axis] = (
                -math.copysign(excess, way[axis]) * duration / (2.0 * device[at.DAMPING, axis])
            )


@outlined
def is_guarded(body: Floats, device: Floats, numbers: Floats, seen: Floats) -> bool:
    """Return whether a watchdog that looks now leaves the force on: its readings hide up to 2r."""
    for axis in range(int(numbers[at.USED_AXES])):
        force = body[at.TARGET, axis] + device[at.COMPENSATION, axis]
        back = -math.copysign(1.0, force) * (body[at.POSITION, axis] - seen[AT_WRITE, axis])
        if force != 0.0 and back > 2.0 * device[at.ERROR, axis]:
            return False
    return bool(numbers[at.GUARD] > 0.0)


@outlined
def account(
    body: Floats, device: Floats, numbers: Floats, duration: float, step: Floats, record: Floats
) -> None:
    """Walk a ``step``, in m, and keep the energy and its lowest value."""
    if numbers[at.AT_TIP] > 0.0:
        record[ENERGY] += walk_at_tip(body, device, numbers, duration, step)
    else:
        record[ENERGY] += walk(body, device, numbers, duration, step)
    record[LOWEST] = min(record[LOWEST], record[ENERGY])


@outlined
def drop(
    now: float,
    is_leaving: bool,
    body: Floats,
    device: Floats,
    numbers: Floats,
    record: Floats,
    seen: Floats,
) -> tuple[float, bool]:
    """Return when the watchdog looks or drops next, and whether the force is on its way out."""
    if not is_leaving and is_guarded(body, device, numbers, seen):
        return now + float(numbers[at.GUARD]), False
    if not is_leaving and numbers[at.DROP] > 0.0:
        return now + float(numbers[at.DROP]), True
    body[at.TARGET] = 0.0
    record[CUT_TIME] = now
    seen[AT_CUT] = body[at.POSITION]
    return math.inf, is_leaving


@outlined
def through(
    body: Floats,
    device: Floats,
    numbers: Floats,
    times: Floats,
    moves: Floats,
    force: Floats,
    events: Floats,
    record: Floats,
    seen: Floats,
) -> None:
    """Walk the pieces of an interval, split at the write and at the cut of the watchdog.

    Args:
        body: The state; changed.
        device: Properties.
        numbers: The other numbers.
        times: Length of each piece of the path, s, shape ``(pieces,)``.
        moves: Move in each piece, m, shape ``(pieces, 3)``.
        force: What is written, N.
        events: Time of the write, time of the cut of the old force, hold of the new one, s.
        record: Energy and its lowest value; changed.
        seen: Position at the cut; changed.
    """
    write, cut, hold = events[0], events[1], events[2]
    now, is_leaving = 0.0, False  # a guard has seen something; a new force comes before it forgets
    step = np.empty(AXES)
    for piece in range(times.size):
        left = times[piece]
        end = now + left
        while True:
            if write <= now and write >= 0.0:
                body[at.TARGET] = force - device[at.COMPENSATION]
                cut, write, is_leaving = now + hold, -1.0, False
                seen[AT_WRITE] = body[at.POSITION]
            if cut <= now:
                cut, is_leaving = drop(now, is_leaving, body, device, numbers, record, seen)
            if numbers[at.LAG] <= 0.0:
                body[at.OUTPUT] = body[at.TARGET]
            if left <= 0.0:
                break
            after = min(end, cut, write) if write >= 0.0 else min(end, cut)
            duration = after - now
            if after >= end:
                duration, after = left, end
            if duration > 0.0:
                for axis in range(AXES):
                    step[axis] = moves[piece, axis] * duration / times[piece]
                account(body, device, numbers, duration, step, record)
            left -= duration
            now = after
            if now >= end:
                left = 0.0
    if 0.0 <= write < math.inf:  # at the very end of the interval, to rounding
        body[at.TARGET] = force - device[at.COMPENSATION]
        seen[AT_WRITE] = body[at.POSITION]
        cut = now + hold
    record[CUT_AFTER] = cut - now


@outlined
def strike_all(
    body: Floats,
    device: Floats,
    numbers: Floats,
    write: float,
    holds: Floats,
    force: Floats,
    record: Floats,
) -> None:
    """Note the worst ends of the hold that begins with a ``write`` in so many s (:func:`tick`)."""
    low = strike(body, device, numbers, write, record[CUT_AFTER], force, holds[1])
    if numbers[at.GUARD] > 0.0:
        low = min(low, strike_guarded(body, device, numbers, write, force))
    low += record[ENERGY]
    record[STRUCK] = min(record[STRUCK], low)
    if record[PEAK] > SMALLEST_PEAK:
        record[SHARE] = min(record[SHARE], low / record[PEAK])
    if record[PEAK] > LARGE_PEAK:
        record[LEFT] = min(record[LEFT], low)
    if write <= 0.0 and numbers[at.LAG] <= 0.0:  # else the rest of an overdue force may act
        record[FALLEN] = min(record[FALLEN], low - min(record[ENERGY], 0.0))
    if holds[2] > 0.0:
        late = strike(body, device, numbers, write, record[CUT_AFTER], force, holds[2])
        record[LATE_STRUCK] = min(record[LATE_STRUCK], late + record[ENERGY])


@outlined
def pieces_of(
    body: Floats,
    device: Floats,
    numbers: Floats,
    row: Floats,
    hold: float,
    force: Floats,
    times: Floats,
    moves: Floats,
) -> None:
    """Put the lengths, s, and the moves, m, of the pieces of an interval into the last two."""
    duration, write = row[DURATION] * 1e-9, row[WRITE] * 1e-9
    # The pieces: under the old force, under the new one (there and back), after its cut.
    before = min(write, duration)
    held = min(duration - before, hold)
    times[0], times[1] = before, held * row[SPLIT]
    times[2], times[3] = held - times[1], duration - before - held
    worst_way(device, numbers, body[at.TARGET] + device[at.WEIGHT], max(before, 1e-9), moves[0])
    worst_way(device, numbers, force, max(held, 1e-9), moves[1])
    for axis in range(int(numbers[at.USED_AXES])):
        old, new = row[STRIKE_OLD] * moves[0, axis], row[STRIKE] * moves[1, axis]
        drift = row[SPEED + axis]
        extra = row[MICRO + axis] + drift * held
        share = row[SPLIT]
        moves[0, axis] = old + drift * before
        moves[1, axis] = share * (new + extra) + row[TURN]
        moves[2, axis] = (1.0 - share) * (new + extra) - row[TURN]
        moves[3, axis] = row[RETURN] * new + drift * times[3]


def tick(
    body: Floats,
    device: Floats,
    numbers: Floats,
    plan: Floats,
    index: int,
    modes: Floats,
    holds: Floats,
    record: Floats,
    seen: Floats,
    force: Floats,
) -> None:
    """Strike with the written force and walk through an interval, up to the next reading.

    Args:
        body: The state at the reading; changed.
        device: Properties.
        numbers: The other numbers.
        plan: Of the run.
        index: Row of this interval.
        modes: Places in READINGS and in COMMANDS.
        holds: How long the device really holds this force, how long it is struck, and how long in
            a late hold (0: not tried), s.
        record: Energies; changed.
        seen: Readings, moves and the next command; changed.
        force: Written, N, shape ``(3,)``.
    """
    row = plan[index]
    write = row[WRITE] * 1e-9
    record[CUT_TIME] = -1.0
    if write < math.inf:
        strike_all(body, device, numbers, write, holds, force, record)
    times, moves = np.zeros(4), np.zeros((4, AXES))
    pieces_of(body, device, numbers, row, holds[0], force, times, moves)
    for piece in range(4):
        no_faster(moves[piece], times[piece], numbers[at.FASTEST])
    start = body[at.POSITION].copy()
    events = np.array([write, record[CUT_AFTER], holds[0]])
    through(body, device, numbers, times, moves, force, events, record, seen)
    record[PEAK] = max(record[PEAK], record[ENERGY])
    following = min(index + 1, len(plan) - 1)
    seen[LAST_MOVE] = body[at.POSITION] - start
    for axis in range(AXES):
        seen[READING, axis] = misread(
            int(modes[0]), axis, body, device, seen, plan[following, MISREAD + axis]
        )
        seen[COMMANDED, axis] = command_of(int(modes[1]), axis, following, seen, plan)
