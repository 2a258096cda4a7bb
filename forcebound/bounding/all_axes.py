"""The bounder of any number of axes as compiled functions.

They work on one array (:mod:`forcebound.bounding.timeline`), so that a call from Python costs
little: a tick runs once a millisecond, with cold caches, and there interpreted arithmetic costs
several times more than compiled.

A motor whose gain is uncertain has two ledgers, one for each end of the range. Loss and work are
linear in the gain, penalties and costs of holds convex; so what both ledgers allow, every gain
between allows. Several motors may have different gains. With P_i the work on axis i in the ledger,
the worst of all their combinations has x (Σ|P_i| - |Σ P_i|) less than the worse of the two ledgers;
that is then paid beforehand (:func:`spread_price`), and the hold's cost is that of the largest
gain.
"""

import math
from collections.abc import Callable
from functools import cache
from typing import TypeAlias

from forcebound.bounding.allowance import gain_at, largest_force, surplus
from forcebound.bounding.hold_cost import hold_cost
from forcebound.bounding.law import BoundingLaw
from forcebound.bounding.sample import (
    NO_MEMORY,
    NO_MOTION,
    Floats,
    Memory,
    Motion,
    Sample,
    Write,
    load_axis,
    load_device,
    load_memory,
    observe,
    observe_axis,
    start_axis,
    store_axis,
    store_memory,
)
from forcebound.bounding.timeline import (
    AGE,
    AVAILABLE,
    AXES,
    BLOCK,
    BUDGET,
    DEVICE,
    ENDS,
    FORCE,
    GAIN,
    GIVEN,
    HELD_LIMIT,
    HELD_PRICE,
    IS_ALONG_PATH,
    IS_DROPPED,
    IS_UNSURE,
    LAG,
    LARGEST_LEAK,
    MEMORY,
    MOTOR,
    ORIGIN,
    PATH_FRICTION,
    PENDING,
    PENDING_BUDGET,
    PENDING_LIMIT,
    PLANNED_LIMIT,
    RESOLUTION,
    SATURATION,
    SILENT,
    SINCE,
    SPENT,
    STATE,
    TOLERANCE,
    UNTIL_CUT,
    UNTIL_WRITE,
    WANTED,
    WATCHDOG,
    WORK,
    WRITE_DELAY,
    acting_cost,
    advance,
    load_constants,
    may_be_dropped,
    take_effect,
)
from forcebound.bounding.waveform import (
    NO_FORCE,
    begin_interval,
    load_motor,
    mean_force,
    penalty,
    store_motor,
)
from forcebound.compiled import allow_in_kernels, jit

Start: TypeAlias = Callable[[Floats, Floats], float]
Limit: TypeAlias = Callable[
    [Floats, Floats, Floats, float, float, float, int], tuple[float, float, int]
]
Settle: TypeAlias = Callable[[Floats, Floats, float], float]

#: What becomes of a reading: it is refused, taken in, or the ledger starts anew from it.
REFUSED, TAKEN, RESTART = 0, 1, 2
_UNSURE = 3  # taken in, after a hold that was cut at an unknown time


@cache
def compiled(law: BoundingLaw) -> tuple[Start, Limit, Settle]:
    """Return what a bounder does with its array, compiled.

    ``start(rows, position) -> estimated energy``;
    ``limit(rows, position, commanded, magnitude, duration, dt, closing) -> (largest force, added
    damping, closing)``, with ``duration`` since the last call and ``dt`` since the last reading
    that was taken in; and ``settle(rows, applied, delay) -> estimated energy``, with ``delay``
    until the force takes effect.
    """
    start_law, limit_force, settle_law, energy = law.start, law.limit, law.settle, law.energy
    limits_holds = law.limits_holds

    def start(rows: Floats, position: Floats) -> float:
        device = load_device(rows, DEVICE, 1)
        store_memory(rows, MEMORY, 1, NO_MEMORY)
        begin(rows, position)
        rows[STATE] = rows[STATE + 1] = start_law(device)
        return energy(rows[STATE], Write(0.0, 0.0, 0.0), device)

    def limit(
        rows: Floats,
        position: Floats,
        commanded: Floats,
        magnitude: float,
        duration: float,
        dt: float,
        closing: int,
    ) -> tuple[float, float, int]:
        device = load_device(rows, DEVICE, 1)
        axes = position.size
        advance(rows, axes, duration)
        if limits_holds and closing != REFUSED:
            closing = closing_of(rows, axes, closing)
        largest, added_damping = math.inf if limits_holds else 0.0, 0.0
        if closing == RESTART:
            restart(rows, position)
            for end in range(int(rows[ENDS])):
                price = rows[SPENT] + gain_at(rows, end) * rows[HELD_PRICE]
                rows[STATE + end] -= price + device.start_price
            rows[HELD_PRICE] = 0.0
            store_memory(rows, MEMORY, 1, NO_MEMORY)
        elif closing != REFUSED:
            memory = load_memory(rows, MEMORY, 1)
            is_unsure = closing == _UNSURE
            motion = observe_axes(rows, position, memory, dt, is_unsure)
            saturated = min(magnitude, rows[SATURATION])
            memory, sample = observe(memory, motion, saturated, dt, device)
            store_memory(rows, MEMORY, 1, memory)
            rows[HELD_PRICE] = sample.held_price + drift_price(rows, position)
            for end in range(int(rows[ENDS])):
                seen = scaled(sample, gain_at(rows, end), rows[HELD_PRICE])
                state, largest, added_damping = limit_force(rows[STATE + end], seen, device)
                rows[STATE + end] = state
        if closing != REFUSED:
            rows[SPENT] = rows[SINCE] = rows[IS_UNSURE] = 0.0
        if limits_holds:
            plan = min(rows[WRITE_DELAY], rows[UNTIL_CUT])
            for end in range(int(rows[ENDS])):
                gain = gain_at(rows, end)
                held = Write(0.0, gain * rows[HELD_PRICE], 0.0)
                available = energy(rows[STATE + end], held, device) - rows[SPENT]
                if plan > 0.0:
                    available -= acting_cost(rows, axes, plan, gain)
                rows[AVAILABLE + end] = available
            if axes > 1 and rows[GAIN] > 0.0:
                least = min(rows[AVAILABLE], rows[AVAILABLE + 1]) - spread_price(rows, axes)
                rows[AVAILABLE] = rows[AVAILABLE + 1] = least
            want_direction(rows, commanded, magnitude)
            largest = min(largest, largest_force(rows, axes))
        return min(largest, rows[SATURATION]), added_damping, closing

    def settle(rows: Floats, applied: Floats, delay: float) -> float:
        device = load_device(rows, DEVICE, 1)
        axes = applied.size
        square = 0.0
        for axis in range(axes):
            block = AXES + axis * BLOCK
            rows[block + PENDING] = rows[block + WANTED] = applied[axis]
            rows[block + FORCE] = applied[axis]
            square += applied[axis] * applied[axis]
        rows[PENDING_LIMIT] = rows[PLANNED_LIMIT]
        rows[PENDING_BUDGET] = rows[AVAILABLE]
        least = math.inf
        for end in range(int(rows[ENDS])):
            price = gain_at(rows, end) * rows[HELD_PRICE]
            left = surplus(rows, axes, end) if limits_holds else 0.0
            write = Write(square, price, left)
            rows[STATE + end] = settle_law(rows[STATE + end], write, device)
            rows[PENDING_BUDGET] = min(rows[PENDING_BUDGET], rows[AVAILABLE + end])
            least = min(least, energy(rows[STATE + end], write, device))
        rows[UNTIL_WRITE] = delay
        if delay <= 0.0:
            take_effect(rows, axes)
        if limits_holds and axes > 1 and rows[GAIN] > 0.0:
            least -= spread_price(rows, axes)
        return least

    allow_in_kernels([start_law, limit_force, settle_law, energy])
    return jit(start), jit(limit), jit(settle)


def begin(rows: Floats, position: Floats) -> None:
    """Put every axis at its first reading, without force."""
    for axis in range(position.size):
        block = AXES + axis * BLOCK
        store_axis(rows, block, 1, start_axis(position[axis]))
        store_motor(rows, block + MOTOR, NO_FORCE)
        rows[block + PENDING] = rows[block + WANTED] = rows[block + WORK] = 0.0
        rows[block + ORIGIN] = position[axis]
    rows[HELD_PRICE] = rows[SPENT] = rows[SINCE] = rows[IS_UNSURE] = 0.0
    rows[AVAILABLE] = rows[AVAILABLE + 1] = rows[LARGEST_LEAK] = 0.0
    rows[AGE] = rows[GIVEN] = rows[BUDGET] = rows[PENDING_BUDGET] = 0.0
    rows[HELD_LIMIT] = rows[PENDING_LIMIT] = rows[PLANNED_LIMIT]
    rows[UNTIL_CUT], rows[UNTIL_WRITE], rows[IS_DROPPED] = math.inf, -1.0, 1.0


def closing_of(rows: Floats, axes: int, closing: int) -> int:
    """Return what becomes of a reading, given what the watchdog may have done before it."""
    if rows[IS_UNSURE] == 0.0:
        return closing
    if may_be_dropped(rows) and rows[WRITE_DELAY] > 0.0:
        return REFUSED  # when it was dropped is known only once the next force acts
    is_one_hold = rows[AGE] == rows[SINCE] and rows[LAG] == 0.0
    for axis in range(axes):
        is_one_hold = is_one_hold and load_constants(rows, axis).dropped == 0.0
    return _UNSURE if is_one_hold and closing == TAKEN else RESTART


def observe_axes(
    rows: Floats, position: Floats, memory: Memory, dt: float, is_unsure: bool
) -> Motion:
    """Take in the new reading of every axis, ``dt`` after the last, in s.

    If the force was cut at an unknown time, see :func:`unsure_cost`.
    """
    motion = NO_MOTION
    lag, gain = rows[LAG], 1.0 + rows[GAIN]
    capability = work = uncertain = price = 0.0
    step = deviation = most_steps = 0.0
    for axis in range(position.size):
        block = AXES + axis * BLOCK
        one = load_constants(rows, axis)
        before = load_axis(rows, block, 1)
        motor = load_motor(rows, block + MOTOR)
        move = position[axis] - before.reading
        mean, cost = mean_force(motor, dt, lag), penalty(motor, dt, lag, gain, move, one)
        step += motor.step * motor.step
        deviation += cost
        most_steps = max(most_steps, motor.steps)
        if is_unsure:
            mean = cost = 0.0
            capability += before.force * before.force * dt / (4.0 * one.damping)
            work += before.force * move
        after, motion = observe_axis(before, memory, position[axis], mean, cost, motion, one)
        change = abs(mean - before.mean)
        if is_unsure:
            change = unsure_change(before.mean, before.force)
            uncertain += rows[GAIN] * abs(before.force * move)
            price += one.half_resolution * change
        rows[block + WORK] += mean * move - one.half_resolution * change
        store_axis(rows, block, 1, after)
        store_motor(rows, block + MOTOR, begin_interval(motor))
    if is_unsure:
        cost = unsure_cost(rows, gain * gain * capability, work - uncertain, dt)
        return with_prices(motion, cost, price)
    if most_steps == 1.0 and deviation > 0.0 and lag == 0.0 and rows[IS_ALONG_PATH] == 1.0:
        way = math.sqrt(motion.distance_square) + rows[RESOLUTION]
        cost = path_penalty(rows, gain * math.sqrt(step), deviation, way)
        return with_prices(motion, cost, motion.change_price)
    return motion


def path_penalty(rows: Floats, step: float, penalty: float, way: float) -> float:
    """Return the penalty of a step of all axes together, with friction along the path, in J.

    Args:
        rows: Of the bounder.
        step: Length of the step, in N.
        penalty: Of the axes without friction, in J.
        way: Longest way from reading to reading, in m.
    """
    damping = load_constants(rows, 0).damping
    duration = 4.0 * damping * penalty / (step * step)
    return hold_cost(step, 2.0 * rows[PATH_FRICTION], way, damping, duration)


def unsure_cost(rows: Floats, capability: float, work: float, dt: float) -> float:
    r"""Return the most that a hold can have cost that was cut at an unknown time, in J.

    For a cut at the share :math:`\bar s` of the interval, mean force and penalty give

    .. math:: \bar s (1 - \bar s) \frac{|F|^2 dt}{4b} - \bar s F \cdot \Delta q

    which is concave in :math:`\bar s`, so the worst share of those possible is known.

    Args:
        rows: Of the bounder, at the end of the hold.
        capability: :math:`|F|^2 dt / (4b)`, the most that it can be, in J.
        work: :math:`F \cdot \Delta q`, the least that it can be, in J.
        dt: Length of the interval, in s.
    """
    earliest: float = rows[HELD_LIMIT] * (1.0 - rows[TOLERANCE]) / dt
    latest: float = 1.0
    if rows[WATCHDOG] == SILENT:
        latest = min(rows[HELD_LIMIT] * (1.0 + rows[TOLERANCE]) / dt, 1.0)
    share = 0.5 - 0.5 * work / capability if capability > 0.0 else latest
    share = min(max(share, earliest), latest)
    return capability * share * (1.0 - share) - work * share


def unsure_change(mean: float, force: float) -> float:
    r"""Return the most that a change to an unknown mean force, then to none, can be, in N.

    :math:`|\bar F(n-2) - \bar s F| + \bar s |F|` is convex in the share, so an end is the worst.
    """
    return max(abs(mean), abs(mean - force) + abs(force))


def restart(rows: Floats, position: Floats) -> None:
    """Forget what was measured before ``position``; the forces stay."""
    for axis in range(position.size):
        block = AXES + axis * BLOCK
        before = load_axis(rows, block, 1)
        store_axis(rows, block, 1, start_axis(position[axis]))
        rows[block + FORCE] = before.force
        rows[block + WORK] -= load_constants(rows, axis).half_resolution * abs(before.mean)
        rows[block + ORIGIN] = position[axis]
        store_motor(rows, block + MOTOR, begin_interval(load_motor(rows, block + MOTOR)))


def spread_price(rows: Floats, axes: int) -> float:
    """Return what motors with different gains can give beyond motors with the same gain, in J."""
    total = magnitudes = 0.0
    for axis in range(axes):
        block = AXES + axis * BLOCK
        held = load_constants(rows, axis).half_resolution * abs(load_axis(rows, block, 1).mean)
        work = rows[block + WORK] - held
        total += work
        magnitudes += abs(work)
    return float(rows[GAIN] * (magnitudes - abs(total)))


def drift_price(rows: Floats, position: Floats) -> float:
    """Return what an error of the weights can have given since the start, in J."""
    price = 0.0
    for axis in range(position.size):
        one = load_constants(rows, axis)
        way = abs(position[axis] - rows[AXES + axis * BLOCK + ORIGIN])
        price += one.weight_error * (way + 2.0 * one.half_resolution)
    return price


def scaled(sample: Sample, gain: float, held_price: float) -> Sample:
    """Return the sample of a motor with this gain."""
    return Sample(
        sample.commanded,
        sample.dt,
        sample.distance,
        gain * sample.work,
        sample.held,
        sample.viscous_loss,
        sample.friction_loss,
        sample.penalty,
        gain * sample.change_price,
        gain * held_price,
    )


def with_prices(motion: Motion, penalty: float, change_price: float) -> Motion:
    """Return ``motion`` with other prices, in J."""
    return Motion(
        motion.distance_square,
        motion.held_square,
        motion.step,
        motion.older,
        motion.younger,
        motion.path_square,
        motion.slid,
        motion.work,
        penalty,
        change_price,
        motion.held_price,
    )


def want_direction(rows: Floats, commanded: Floats, magnitude: float) -> None:
    """Put the direction of the commanded force into ``WANTED``; without one the first axis."""
    for axis in range(commanded.size):
        share = commanded[axis] / magnitude if magnitude > 0.0 else 1.0 - min(axis, 1)
        rows[AXES + axis * BLOCK + WANTED] = share
