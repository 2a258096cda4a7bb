"""An attack through one interval: forces take effect and are dropped while the hand moves.

Written from ``docs/theory.md`` alone, as :mod:`forcebound_proofs.paths.truth`; the genes of
:mod:`forcebound_proofs.paths.path` say how the hand moves.
"""

import math
from collections.abc import Sequence

import numpy as np

from forcebound.compiled import outlined
from forcebound_proofs.cases import LEAST_PEAK
from forcebound_proofs.paths.arm import walk_at_tip
from forcebound_proofs.paths.path import LARGE_PEAK, QUEUE, Account, Interval, command_of, misread
from forcebound_proofs.paths.truth import (
    AXES,
    Device,
    Devices,
    Floats,
    Vector,
    cut,
    no_faster,
    set_force,
    walk,
    withheld,
    worst_guarded_hold,
    worst_hold,
)


@outlined
def worst_way(device: Device, force: Vector, duration: float, way: Floats) -> None:
    """Put the move that costs least under a constant ``force``, rigid friction, into ``way``."""
    square = 0.0
    for axis in range(device.axes):
        way[axis] = device.gain[axis] * force[axis]
        square += way[axis] * way[axis]
    size = math.sqrt(square)
    for axis in range(device.axes):
        if device.is_along_path:
            share = max(1.0 - device.friction[0] / size, 0.0) if size > 0.0 else 0.0
            way[axis] *= -share * duration / (2.0 * device.damping[axis])
        else:
            excess = max(abs(way[axis]) - device.friction[axis], 0.0)
            way[axis] = -math.copysign(excess, way[axis]) * duration / (2.0 * device.damping[axis])


@outlined
def is_guarded(device: Device, account: Account) -> bool:
    """Return whether a watchdog that looks now leaves the force on: its readings hide up to 2r."""
    for axis in range(device.axes):
        force = device.target[axis] + device.compensation[axis]
        back = -math.copysign(1.0, force) * (device.position[axis] - account.at_write[axis])
        if force != 0.0 and back > 2.0 * device.error[axis]:
            return False
    return device.guard > 0.0


@outlined
def go(device: Device, account: Account, duration: float, step: Floats) -> None:
    """Walk a ``step``, in m, and keep the energy and its lowest value."""
    if device.is_at_tip:
        account.energy += walk_at_tip(device, duration, step)
    else:
        account.energy += walk(device, duration, step)
    account.lowest = min(account.lowest, account.energy)


@outlined
def drop(device: Device, account: Account, now: float, is_leaving: bool) -> tuple[float, bool]:
    """Return when the watchdog looks or drops next, and whether the force is on its way out."""
    if not is_leaving and is_guarded(device, account):
        return now + device.guard, False
    if not is_leaving and device.drop > 0.0:
        return now + device.drop, True
    cut(device)
    account.cut_time = now
    for axis in range(AXES):
        account.at_cut[axis] = device.position[axis]
    return math.inf, is_leaving


@outlined
def send(account: Account, write: float) -> None:
    """Put the force of this interval on its way; it acts ``write`` s after the reading."""
    while account.waiting > 0 and account.due[account.waiting - 1] >= write:
        account.waiting -= 1  # this force takes its place
    if account.waiting == QUEUE:  # far more than a law that knows of the delay sends, but for zeros
        if not np.any(account.force) and not np.any(account.queued[QUEUE - 1]):
            return
        account.waiting -= 1
    place = account.waiting
    account.due[place], account.queued_hold[place] = write, account.hold
    for axis in range(AXES):
        account.queued[place][axis] = account.force[axis]
    account.waiting += 1


@outlined
def settle(device: Device, account: Account) -> None:
    """Let the force that acts end: it is known what of it pays the hand."""
    account.energy -= withheld(device)
    account.lowest = min(account.lowest, account.energy)


@outlined
def act(device: Device, account: Account) -> float:
    """Let the first force on its way act; return how long it is held, in s."""
    settle(device, account)
    set_force(device, account.queued[0])
    hold: float = account.queued_hold[0]
    account.waiting -= 1
    for place in range(account.waiting):
        account.due[place] = account.due[place + 1]
        account.queued_hold[place] = account.queued_hold[place + 1]
        for axis in range(AXES):
            account.queued[place][axis] = account.queued[place + 1][axis]
    for axis in range(AXES):
        account.at_write[axis] = device.position[axis]
    return hold


@outlined
def through(device: Device, account: Account, times: Floats, moves: Floats) -> None:
    """Walk the pieces of an interval, split where a force begins to act or the watchdog cuts it.

    Args:
        device: Changed.
        account: Changed; it has the time of the old force's cut, and the forces on their way.
        times: Length of each piece of the path, s, shape ``(pieces,)``.
        moves: Move in each piece, m, shape ``(pieces, 3)``.
    """
    cut_at = account.cut_after
    now, is_leaving = 0.0, False  # a guard has seen something; a new force comes before it forgets
    step = np.empty(AXES)
    for piece in range(times.size):
        left = times[piece]
        end = now + left
        while True:
            if account.waiting > 0 and account.due[0] <= now:
                cut_at, is_leaving = now + act(device, account), False
                continue
            if cut_at <= now:
                cut_at, is_leaving = drop(device, account, now, is_leaving)
            if left <= 0.0:
                break
            after = min(end, cut_at)
            if account.waiting > 0:
                after = min(after, account.due[0])
            duration = after - now
            if after >= end:
                duration, after = left, end
            if duration > 0.0:
                for axis in range(AXES):
                    step[axis] = moves[piece, axis] * duration / times[piece]
                go(device, account, duration, step)
            left -= duration
            now = after
            if now >= end:
                left = 0.0
    while account.waiting > 0 and account.due[0] <= now + 1e-12:  # at the very end, to rounding
        cut_at = now + act(device, account)
    for place in range(account.waiting):
        account.due[place] -= now
    account.cut_after = cut_at - now


@outlined
def note_worst_holds(devices: Devices, account: Account) -> None:
    """Note the worst ends of the hold of the force that was written last (:func:`tick`)."""
    last = account.waiting - 1
    dues, forces, holds = account.due[: last + 1], account.queued[: last + 1], np.empty(last + 1)
    for place in range(last):
        holds[place] = account.queued_hold[place]
    holds[last] = account.longest_hold
    low, write = worst_hold(devices, dues, forces, holds, account.cut_after), dues[last]
    if devices[0].guard > 0.0:
        low = min(low, worst_guarded_hold(devices, write, account.force))
    low += account.energy
    account.lowest_end = min(account.lowest_end, low)
    if account.peak > LEAST_PEAK:
        account.share = min(account.share, low / account.peak)
    if account.peak > LARGE_PEAK:
        account.left = min(account.left, low)
    if write <= 0.0 and devices[0].lag <= 0.0:  # else the rest of an overdue force may act
        account.fallen = min(account.fallen, low - min(account.energy, 0.0))
    if account.late_hold > 0.0:
        holds[last] = account.late_hold
        late = worst_hold(devices, dues, forces, holds, account.cut_after)
        account.lowest_late_end = min(account.lowest_late_end, late + account.energy)


@outlined
def pieces_of(
    device: Device, account: Account, row: Interval, times: Floats, moves: Floats
) -> None:
    """Put the lengths, s, and the moves, m, of the pieces of an interval into the last two."""
    duration, waiting = row.duration * 1e-9, account.waiting
    # The pieces: under the old force, under the next one (there and back), after its end: it was
    # cut, or replaced.
    before = min(account.due[0], duration) if waiting > 0 else duration
    hold = account.queued_hold[0] if waiting > 0 else 0.0
    if waiting > 1:
        hold = min(hold, account.due[1] - before)
    held = min(duration - before, hold)
    times[0], times[1] = before, held * row.split
    times[2], times[3] = held - times[1], duration - before - held
    old_force = np.empty(AXES)
    for axis in range(AXES):
        old_force[axis] = device.target[axis] + device.weight[axis]
    worst_way(device, old_force, max(before, 1e-9), moves[0])
    if waiting > 0:
        worst_way(device, account.queued[0], max(held, 1e-9), moves[1])
    if waiting > 1:
        worst_way(device, account.queued[1], max(times[3], 1e-9), moves[3])
    for axis in range(device.axes):
        old, new = row.share_before * moves[0, axis], row.share_held * moves[1, axis]
        drift = row.speed[axis]
        extra = row.micro[axis] + drift * held
        moves[0, axis] = old + drift * before
        moves[1, axis] = row.split * (new + extra) + row.turn
        moves[2, axis] = (1.0 - row.split) * (new + extra) - row.turn
        after = row.share_held * moves[3, axis] if waiting > 1 else row.share_after * new
        moves[3, axis] = after + drift * times[3]


@outlined
def is_seen(device: Device, duration: float, moves: Floats) -> bool:
    """Return whether the readings before and after these ``moves``, in m, show a faster hand."""
    square = 0.0
    for axis in range(device.axes):
        way = 0.0
        for piece in range(4):
            way += moves[piece, axis]
        square += way * way
    return math.sqrt(square) > device.fastest * max(duration, device.burst) + device.seen


def tick(
    devices: Devices, accounts: Sequence[Account], plan: Sequence[Interval], index: int
) -> None:
    """Note the worst end of the written force's hold; walk to the next reading.

    Args:
        devices: The device, changed, and its copies.
        accounts: The account of the run, changed; it has the force that is written.
        plan: Of the run.
        index: Of this interval.
    """
    device, account, row = devices[0], accounts[0], plan[index]
    write = row.write * 1e-9
    account.cut_time = -1.0
    for axis in range(AXES):
        account.last_move[axis] = -device.position[axis]
    if write < math.inf:
        send(account, write)
        note_worst_holds(devices, account)
    times, moves = np.zeros(4), np.zeros((4, AXES))
    pieces_of(device, account, row, times, moves)
    if not is_seen(device, row.duration * 1e-9, moves):
        for piece in range(4):
            no_faster(moves[piece], times[piece], device.fastest)
    through(device, account, times, moves)
    account.peak = max(account.peak, account.energy)
    following = min(index + 1, len(plan) - 1)
    if account.waiting == 0 and plan[following].write <= 0.0:  # it ends with this interval
        settle(device, account)
    for axis in range(AXES):
        account.last_move[axis] += device.position[axis]
    for axis in range(AXES):
        account.reading[axis] = misread(account, device, axis, plan[following].misread[axis])
        command = plan[following].command[axis]
        account.commanded[axis] = command_of(account, device, axis, following, command)
