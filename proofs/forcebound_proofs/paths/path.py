"""Paths of an attack: genes, what they mean in each interval, and the worst readings.

A run has a row of genes for each interval between two readings. :func:`plan_of` turns them into
times, moves and commands; ``interval.py`` lets the device go through one interval. The hand knows
the force before it moves: its moves are shares of the move that costs it least (``worst_hold``),
and on top of them multiples of the encoder's error (``micro``), a speed, and a turn in the hold.
"""

import math
from enum import IntEnum
from typing import Annotated, Any, NamedTuple

import numpy as np

from forcebound.compiled import outlined, record_type
from forcebound_proofs.paths.truth import Device, Floats, PerAxis


class Interval:
    """A row of genes, in this order, or what they mean; SI units but for the two times."""

    duration: float  # ns
    write: float  # ns after the reading
    applied: float  # share of the force that is applied
    cut: float  # error of the watchdog, -1 to 1
    share_before: float  # shares of the worst move: before the write,
    share_held: float  # in the hold,
    share_after: float  # and, of the hold's, after the cut
    turn: float  # m
    split: float  # share of the hold before the turn
    micro: PerAxis  # m
    speed: PerAxis  # m/s
    misread: PerAxis  # share of the error of a reading
    command: PerAxis  # N


FIELDS = record_type(Interval)
COLUMNS = FIELDS.itemsize // 8
#: Columns of a row of genes by field.
PLACES = {name: place // 8 for name, (_, place, *_) in (FIELDS.fields or {}).items()}
VECTORS = ("micro", "speed", "misread", "command")


class Reading(IntEnum):
    """How the encoder errs, always by at most r."""

    GENES = 0  # as the genes say
    STICKING = 1
    LEADING = 2
    TRAILING = 3
    WITH_THE_FORCE = 4
    AGAINST_THE_FORCE = 5
    QUANTISED = 6
    AT_THE_EDGES = 7


class Command(IntEnum):
    """What the environment commands."""

    GENES = 0  # as the genes say
    ALONG_THE_MOTION = 1
    AGAINST_THE_MOTION = 2
    ALTERNATING = 3
    ON_THE_FIRST_AXIS = 4
    SLOWLY = 5  # in steps that friction pays for; only with a certificate that says so


QUEUE = 16  # forces that can be on their way

LARGE_PEAK = 1e-4  # J; what is left after such a peak says how tight a law is


class Account:
    """The energy of a run so far, in J, and what is handed from interval to interval."""

    energy: float
    lowest: float
    lowest_end: float  # lowest of the worst ends of all holds
    lowest_late_end: float  # the same, of late holds
    fallen: float  # most that it can fall in a punctual hold while it is below zero
    peak: float
    share: float  # lowest after a peak, over that peak
    left: float  # lowest after a peak of LARGE_PEAK
    cut_after: float  # s until the watchdog drops the force
    cut_time: float  # s, when it did in this interval; -1: it did not
    reading_mode: int  # of Reading
    command_mode: int  # of Command
    hold: float  # s, for which the device really holds the next force
    longest_hold: float  # s, with which its worst end is sought
    late_hold: float  # s, in a late hold; 0: not tried
    force: PerAxis  # N, to be written
    waiting: int  # forces that have been written and do not act yet, in order:
    due: Annotated[list[float], QUEUE]  # s after the reading
    queued: Annotated[list[PerAxis], QUEUE]  # N
    queued_hold: Annotated[list[float], QUEUE]  # s
    reading: PerAxis  # m
    commanded: PerAxis  # N
    last_move: PerAxis  # m
    at_cut: PerAxis  # m
    at_write: PerAxis  # m


class Manner(NamedTuple):
    """How the genes of a run are read."""

    reading: Reading
    command: Command
    clock: int  # interval: 0 hold limit, 1 period, 2 up to the hold limit, 3 also overruns
    speed: float  # m/s, of the hand, for a gene of 1
    longest: float  # s, of an overrun
    saturation: float  # N, largest command
    punctual: bool = False  # no hold lasts longer than the hold limit, from write to write


def plan_of(
    genes: Floats,
    manner: Manner,
    period: float,
    hold_limit: Floats,
    write_delay: float,
    way: Floats,
) -> Any:
    """Return what the rows of ``genes`` mean, an array of :class:`Interval`.

    Args:
        genes: Any numbers, of the order of 1; a row for each interval, ``COLUMNS`` columns.
        manner: How to read them.
        period: T, s.
        hold_limit: T_max of the force of each row, s.
        write_delay: Largest time from reading to writing, s.
        way: Unit of ``micro`` and ``turn`` for each axis, m.
    """
    plan: Any = np.ascontiguousarray(genes).copy().view(FIELDS)[:, 0]
    shape = np.clip(plan["duration"], -3.0, 3.0)
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
    varies = write_delay * 1e9
    if manner.punctual:
        varies = min(varies, 0.5 * float(exact.min()))
        nanoseconds = np.minimum(nanoseconds, exact - math.ceil(varies))
    plan["duration"] = nanoseconds
    share = np.clip(np.abs(plan["write"]), 0.0, 1.0)
    readings = np.cumsum(nanoseconds) - nanoseconds
    acts = readings + np.floor(write_delay * 1e9 - (1.0 - share) * varies)
    plan["write"] = np.maximum.accumulate(acts) - readings  # the order of writes is kept
    plan["applied"] = np.clip(2.0 - np.abs(plan["applied"]), 0.0, 1.0)
    plan["cut"] = np.clip(plan["cut"], -1.0, 1.0)
    plan["split"] = np.clip(0.5 + plan["split"] / 4.0, 0.05, 1.0)
    plan["turn"] = way[0] * plan["turn"] ** 3
    plan["micro"] = way * plan["micro"] ** 3
    plan["speed"] = manner.speed * np.clip(plan["speed"] ** 3, -1.0, 1.0)
    plan["misread"] = np.clip(1.5 * plan["misread"], -1.0, 1.0)
    plan["command"] = manner.saturation * np.clip(3.0 * plan["command"], -1.0, 1.0)
    return plan


@outlined
def misread(account: Account, device: Device, axis: int, share: float) -> float:
    """Return a reading that is wrong by at most r, in m."""
    position, error, mode = device.position[axis], device.error[axis], account.reading_mode
    if mode == Reading.STICKING:
        return min(max(account.reading[axis], position - error), position + error)
    if mode == Reading.LEADING:
        return position + math.copysign(error, account.last_move[axis])
    if mode == Reading.TRAILING:
        return position - math.copysign(error, account.last_move[axis])
    if mode == Reading.WITH_THE_FORCE:
        return position + math.copysign(error, device.target[axis] + device.weight[axis])
    if mode == Reading.AGAINST_THE_FORCE:
        return position - math.copysign(error, device.target[axis] + device.weight[axis])
    if mode == Reading.QUANTISED and error > 0.0:
        return 2.0 * error * math.floor(position / (2.0 * error) + 0.5)
    if mode == Reading.AT_THE_EDGES:
        return position + math.copysign(error, share)
    return position + error * share


@outlined
def command_of(account: Account, device: Device, axis: int, index: int, command: float) -> float:
    """Return the command of an axis for the next reading, in N."""
    mode = account.command_mode
    if mode == Command.ALONG_THE_MOTION:
        return math.copysign(command, -account.last_move[axis])
    if mode == Command.AGAINST_THE_MOTION:
        return math.copysign(command, account.last_move[axis])
    if mode == Command.ALTERNATING:
        return abs(command) * (1.0 - 2.0 * (index % 2))
    if mode == Command.ON_THE_FIRST_AXIS:
        return command if axis == 0 else 0.0
    if mode == Command.SLOWLY:
        force, step = account.force[axis], 1.5 * device.friction[axis]
        return min(max(command, force - step), force + step)
    return command
