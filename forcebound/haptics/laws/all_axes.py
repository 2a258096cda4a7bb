"""The bounder of any number of axes as compiled functions.

They work on one record (:mod:`forcebound.haptics.laws.ledger`), so that a call from Python costs
little: a tick runs once a millisecond, with cold caches, and there interpreted arithmetic costs
several times more than compiled.

A motor whose gain is uncertain has two ledgers, one for each end of the range. Loss and work are
linear in the gain, penalties and costs of holds convex; so what both ledgers allow, every gain
between allows. Several motors may have different gains. With J_i the work on axis i in the ledger,
the worst of all their combinations has x (Σ|J_i| - |Σ J_i|) less than the worse of the two ledgers;
that is then paid beforehand (:func:`spread_price`), and what holds cost, also that of the old force
until the new one takes effect, is that of the largest gain.
"""

import math
from collections.abc import Callable, Sequence
from functools import cache
from typing import TypeAlias

from forcebound.compiled import allow_in_kernels, jit
from forcebound.haptics.laws.allowance import gain_at, largest_force, strongest_gain, surplus
from forcebound.haptics.laws.attenuation import attenuated_price
from forcebound.haptics.laws.error_prices import drift_price, spread_price
from forcebound.haptics.laws.fast_hand import is_fast, owe
from forcebound.haptics.laws.hold_cost import hold_cost
from forcebound.haptics.laws.law import BoundingLaw
from forcebound.haptics.laws.ledger import (
    PLACES,
    SETTLED,
    SILENT,
    Ledger,
    store_axis,
    store_force,
    store_memory,
)
from forcebound.haptics.laws.sample import (
    NO_MEMORY,
    NO_MOTION,
    NO_WRITE,
    Motion,
    Sample,
    Write,
    observe,
    observe_axis,
    start_axis,
)
from forcebound.haptics.laws.timeline import (
    advance_to_reading,
    cost_before,
    drop,
    may_be_dropped,
    send,
)
from forcebound.haptics.laws.waveform import begin_interval, mean_force, penalty

Ledgers: TypeAlias = Sequence[Ledger]  # an array of one
Start: TypeAlias = Callable[[Ledgers], float]
Limit: TypeAlias = Callable[
    [Ledgers, float, int, float, float, int], tuple[float, float, bool, bool]
]
Settle: TypeAlias = Callable[[Ledgers, float], float]

#: Verdict on a reading: it is refused, taken in, or the ledger starts again from it.
REFUSED, TAKEN, RESTART = 0, 1, 2
_UNSURE = 3  # taken in, after a hold that was cut at an unknown time
_NEW = 4  # a new ledger: the motor's force was not known for a while

LARGEST_READING = 1e6  # m; a reading beyond is none


@cache
def compiled(law: BoundingLaw) -> tuple[Start, Limit, Settle]:
    """Return what a bounder does with its ledger, compiled.

    ``start(ledgers) -> estimated energy``, with the first ``reading``;
    ``limit(ledgers, magnitude, read_ns, duration, dt, verdict) -> (largest force, added damping,
    is_wrong, is_taken)``, with the ``reading`` at ``read_ns`` and the commanded ``force``, its
    ``magnitude``, ``duration`` since the last call, ``dt`` since the last reading that was taken
    in, and the ``verdict`` by its time; it returns whether the reading cannot be, and whether it
    was taken in;
    and ``settle(ledgers, delay) -> estimated energy``, with the applied ``force`` and ``delay``
    until it takes effect.
    """
    allow_in_kernels([law.start, law.limit, law.settle, law.energy])
    return jit(_start(law)), jit(_limit(law)), jit(_settle(law))


def _start(law: BoundingLaw) -> Start:
    start_law, energy = law.start, law.energy

    def start(ledgers: Ledgers) -> float:
        ledger = ledgers[0]
        begin(ledger)
        ledger.state[0] = ledger.state[1] = start_law(ledger.constants)
        return energy(ledger.state[0], NO_WRITE, ledger.constants)

    return start


def _limit(law: BoundingLaw) -> Limit:
    limit_force, energy, limits_holds = law.limit, law.energy, law.limits_holds
    least_energy = _least_energy(law)

    def limit(
        ledgers: Ledgers, magnitude: float, read_ns: int, duration: float, dt: float, verdict: int
    ) -> tuple[float, float, bool, bool]:
        ledger = ledgers[0]
        device = ledger.constants
        verdict = judge(ledger, read_ns, dt, verdict)
        is_wrong = verdict == REFUSED
        advance_to_reading(ledger, duration)
        if limits_holds and verdict != REFUSED:
            verdict = verdict_on_reading(ledger, verdict)
            if verdict != REFUSED and ledger.hand_speed < math.inf and is_fast(ledger):
                owe(ledger, least_energy(ledger))
        largest, added_damping = math.inf if limits_holds else 0.0, 0.0
        if verdict == _NEW:
            restart(ledger)
            renew(ledger)
        elif verdict == RESTART:
            restart(ledger)
        elif verdict != REFUSED:
            motion, cost, price = observe_axes(ledger, dt, verdict == _UNSURE)
            saturated = min(magnitude, ledger.saturation)
            memory, sample = observe(ledger.memory, motion, cost, price, saturated, dt, device)
            store_memory(ledger.memory, memory)
            # At least all of the drift in both ledgers, also in that whose gain is less than 1.
            ledger.held_price = sample.held_price + drift_price(ledger) / (1.0 - ledger.gain)
            # The cap is on what is left after the spread, which may grow without end.
            spread = spread_price(ledger) if ledger.axes > 1 and ledger.gain > 0.0 else 0.0
            for end in range(ledger.ends):
                gain = gain_at(ledger, end)
                seen = scaled(sample, gain, ledger.held_price + spread / gain)
                state, largest, added_damping = limit_force(ledger.state[end], seen, device)
                ledger.state[end] = state
        if verdict != REFUSED:
            ledger.spent = ledger.since = 0.0
            ledger.is_unsure = ledger.was_unsure = ledger.has_candidate = False
        if limits_holds:
            for end in range(ledger.ends):
                gain = gain_at(ledger, end)
                held = Write(0.0, gain * ledger.held_price, 0.0)
                before = cost_before(ledger, strongest_gain(ledger, end), ledger.write_delay)
                available = energy(ledger.state[end], held, device) - ledger.spent
                ledger.before[end], ledger.available[end] = before, available - before
            if ledger.axes > 1 and ledger.gain > 0.0:
                least = min(ledger.available[0], ledger.available[1]) - spread_price(ledger)
                ledger.available[0] = ledger.available[1] = least
            want_direction(ledger, magnitude)
            largest = min(largest, largest_force(ledger))
            if ledger.is_unsure and ledger.lag > 0.0:
                largest = 0.0  # what the motor still gives is not known
        if ledger.waiting >= PLACES - 1:
            largest = 0.0
        return min(largest, ledger.saturation), added_damping, is_wrong, verdict != REFUSED

    return limit


def _least_energy(law: BoundingLaw) -> Callable[[Ledger], float]:
    energy = law.energy

    def least_energy(ledger: Ledger) -> float:
        least = math.inf
        for end in range(ledger.ends):
            held = Write(0.0, gain_at(ledger, end) * ledger.held_price, 0.0)
            least = min(least, energy(ledger.state[end], held, ledger.constants))
        if ledger.axes > 1 and ledger.gain > 0.0:
            least -= spread_price(ledger)
        return least

    return least_energy


def _settle(law: BoundingLaw) -> Settle:
    settle_law, energy, limits_holds = law.settle, law.energy, law.limits_holds

    def settle(ledgers: Ledgers, delay: float) -> float:
        ledger = ledgers[0]
        square = 0.0
        for k in range(ledger.axes):
            axis, force = ledger.axis[k], ledger.force[k]
            axis.trial = force
            store_force(axis.memory, force)
            square += force * force
        budget, least = ledger.available[0], math.inf
        for end in range(ledger.ends):
            price = gain_at(ledger, end) * ledger.held_price
            left = surplus(ledger, end, 1.0) if limits_holds else 0.0
            if limits_holds and ledger.axes > 1 and ledger.gain > 0.0:
                left = min(left, surplus(ledger, 1 - end, 1.0))  # one limit serves both ends
            write = Write(square, price, left)
            ledger.state[end] = settle_law(ledger.state[end], write, ledger.constants)
            budget = min(budget, ledger.available[end])
            least = min(least, energy(ledger.state[end], write, ledger.constants))
        if ledger.waiting >= PLACES - 1:
            ledger.crowded += 1
        send(ledger, delay, ledger.planned_limit, budget)
        if limits_holds and ledger.axes > 1 and ledger.gain > 0.0:
            least -= spread_price(ledger)
        return least

    return settle


def cut(ledgers: Ledgers) -> None:
    """Let the watchdog drop the force."""
    drop(ledgers[0])


def begin(ledger: Ledger) -> None:
    """Put every axis at its first reading, without force."""
    store_memory(ledger.memory, NO_MEMORY)
    for k in range(ledger.axes):
        axis, reading = ledger.axis[k], ledger.reading[k]
        store_axis(axis.memory, start_axis(reading))
        axis.motor.target = axis.motor.actual = 0.0
        begin_interval(axis.motor)
        axis.held = axis.onset = axis.trial = axis.work = 0.0
        axis.origin, axis.rubbed = reading, axis.constants.friction
    ledger.held_price = ledger.spent = ledger.since = ledger.speed_leak = 0.0
    ledger.fast_holds = 0
    ledger.available[0] = ledger.available[1] = ledger.largest_leak = 0.0
    ledger.before[0] = ledger.before[1] = 0.0
    ledger.age = ledger.given = ledger.budget = 0.0
    ledger.held_limit, ledger.until_cut = ledger.planned_limit, math.inf
    ledger.waiting = ledger.crowded = 0
    ledger.is_unsure = ledger.was_unsure = ledger.has_candidate = False
    ledger.quiet = ledger.inserted = 0.0
    ledger.is_dropped, ledger.is_waiting, ledger.is_late = True, False, False


def judge(ledger: Ledger, read_ns: int, dt: float, verdict: int) -> int:
    """Return the verdict on a reading, to which the device may not have been able to move.

    A second one that confirms the first that was refused: then those before may be wrong, and the
    ledger begins again, without credit for the motion.
    """
    length = distance = from_candidate = 0.0
    for k in range(ledger.axes):
        reading = ledger.reading[k]
        move, rest = reading - ledger.axis[k].memory.reading, reading - ledger.candidate[k]
        length += reading * reading
        distance += move * move
        from_candidate += rest * rest
    if verdict == REFUSED or not math.sqrt(length) < LARGEST_READING:
        return REFUSED
    if math.sqrt(distance) > ledger.largest_speed * dt + ledger.resolution:
        ledger.has_candidate, ledger.candidate_ns = True, read_ns
        for k in range(ledger.axes):
            ledger.candidate[k] = ledger.reading[k]
        return REFUSED
    since = (read_ns - ledger.candidate_ns) / 1e9
    reach = ledger.largest_speed * since + ledger.resolution
    return RESTART if ledger.has_candidate and math.sqrt(from_candidate) <= reach else TAKEN


def verdict_on_reading(ledger: Ledger, verdict: int) -> int:
    """Decide whether a reading is taken in or refused, or restarts the ledger.

    The watchdog may have dropped the force before it.
    """
    if not ledger.is_unsure:
        return verdict
    if ledger.lag > 0.0:  # the motor's force is known again once what is left of that one is gone
        return _NEW if verdict != REFUSED and ledger.quiet > SETTLED * ledger.lag else REFUSED
    if may_be_dropped(ledger) and ledger.write_delay > 0.0:
        return REFUSED  # when it was dropped is known only once the next force acts
    is_one_hold = ledger.age == ledger.since and ledger.lag == 0.0 and ledger.attenuates == 0
    for k in range(ledger.axes):
        is_one_hold = is_one_hold and ledger.axis[k].constants.dropped == 0.0
    return _UNSURE if is_one_hold and verdict == TAKEN else RESTART


def observe_axes(ledger: Ledger, dt: float, is_unsure: bool) -> tuple[Motion, float, float]:
    """Take in the new readings; return the sums, and penalty and price of the change, in J."""
    motion = NO_MOTION
    lag, gain = ledger.lag, 1.0 + ledger.gain
    capability = work = uncertain = price = 0.0
    step = deviation = most_steps = 0.0
    for k in range(ledger.axes):
        axis, reading = ledger.axis[k], ledger.reading[k]
        one, before, motor = axis.constants, axis.memory, axis.motor
        force, move = axis.held, reading - before.reading
        mean = mean_force(motor, dt, lag)
        full = mean
        if ledger.attenuates > 0:
            mean *= 0.5 * (1.0 + ledger.least_share)
        change = abs(mean - before.mean_force)
        step += motor.step * motor.step
        if ledger.attenuates == 0:
            deviation += penalty(motor, dt, lag, gain, move, one)
        else:
            deviation += attenuated_price(ledger, k, dt, move, full)
        most_steps = max(most_steps, motor.steps)
        if is_unsure:
            mean, change = 0.0, unsure_change(before.mean_force, force)
            capability += force * force * dt / (4.0 * one.damping)
            work += force * move
            uncertain += ledger.gain * abs(force * move)
        dear = one.half_resolution * change
        if motor.unknown > 0.0:
            dear += motor.unknown / dt * (abs(move) + 2.0 * one.half_resolution)
        price += dear
        axis.work += mean * move - dear
        after, motion = observe_axis(before, ledger.memory, reading, mean, motion, one)
        store_axis(before, after)
        begin_interval(motor)
    if is_unsure:
        cost = unsure_cost(ledger, gain * gain * capability, work - uncertain, dt)
        return motion, cost, price
    if most_steps == 1.0 and deviation > 0.0 and lag == 0.0 and ledger.is_along_path:
        distance = math.sqrt(motion.distance_square) + ledger.resolution
        return motion, path_penalty(ledger, gain * math.sqrt(step), deviation, distance), price
    return motion, deviation, price


def path_penalty(ledger: Ledger, step: float, penalty: float, distance: float) -> float:
    """Return the penalty of a step of all axes together, with friction along the path, in J.

    ``penalty`` is that of the axes without friction, ``distance`` the longest between the readings.
    """
    damping = ledger.axis[0].constants.damping
    duration = 4.0 * damping * penalty / (step * step)
    return hold_cost(step, 2.0 * ledger.constants.path_friction, distance, damping, duration)


def unsure_cost(ledger: Ledger, capability: float, work: float, dt: float) -> float:
    r"""Return the most that a hold can have cost that was cut at an unknown time, in J.

    .. math:: \bar s (1 - \bar s) \frac{|F|^2 dt}{4b} - \bar s F \cdot \Delta q

    is concave in the share :math:`\bar s` of the interval, so the worst share of those possible is
    known. ``capability`` is the largest first factor, ``work`` the least of the last, in J.
    """
    earliest: float = ledger.held_limit * (1.0 - ledger.tolerance) / dt
    latest: float = 1.0
    if ledger.watchdog == SILENT:
        latest = min(ledger.held_limit * (1.0 + ledger.tolerance) / dt, 1.0)
    share = 0.5 - 0.5 * work / capability if capability > 0.0 else latest
    share = min(max(share, earliest), latest)
    return capability * share * (1.0 - share) - work * share


def unsure_change(mean: float, force: float) -> float:
    r"""Return the most that a change to an unknown mean force, then to none, can be, in N.

    :math:`|\bar F(n-2) - \bar s F| + \bar s |F|` is convex in the share, so an end is the worst.
    """
    return max(abs(mean), abs(mean - force) + abs(force))


def restart(ledger: Ledger) -> None:
    """Forget what was measured before this reading, at its price; the forces stay."""
    for k in range(ledger.axes):
        axis, reading = ledger.axis[k], ledger.reading[k]
        force, mean = axis.memory.force, axis.memory.mean_force
        store_axis(axis.memory, start_axis(reading))
        store_force(axis.memory, force)
        axis.work -= axis.constants.half_resolution * abs(mean)
        axis.origin = reading
        begin_interval(axis.motor)
    for end in range(ledger.ends):
        price = ledger.spent + gain_at(ledger, end) * ledger.held_price
        ledger.state[end] -= price + ledger.constants.start_price
    ledger.held_price = 0.0
    store_memory(ledger.memory, NO_MEMORY)


def renew(ledger: Ledger) -> None:
    """Keep nothing: loss and work are not negative, since every force so far has been paid."""
    for k in range(ledger.axes):
        ledger.axis[k].work = 0.0
    ledger.state[0] = ledger.state[1] = -ledger.constants.start_price


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


def want_direction(ledger: Ledger, magnitude: float) -> None:
    """Set ``trial`` to the direction of the commanded force; without one the first axis."""
    for k in range(ledger.axes):
        share = ledger.force[k] / magnitude if magnitude > 0.0 else 1.0 - min(k, 1)
        ledger.axis[k].trial = share
