"""The run of time in a ledger: each force acts from its time until the next one takes effect.

Forces that were written and do not act yet wait in order. The watchdog may drop the one that acts.
"""

import math

from forcebound.haptics.laws.hold_cost import hold_cost, rigid_cost
from forcebound.haptics.laws.ledger import GUARDING, NONE, PLACES, SILENT, Ledger
from forcebound.haptics.laws.sample import AxisConstants
from forcebound.haptics.laws.waveform import retarget, run, wait

HALF_NS = 0.5e-9  # s; times are whole nanoseconds


def advance(ledger: Ledger, duration: float) -> None:
    """Let ``duration`` pass, in s: forces take effect and are dropped on the way."""
    left = duration
    while left > 0.0:
        piece = min(left, ledger.until_cut)
        if ledger.waiting > 0:
            piece = min(piece, ledger.until_write[0])
        _run_motors(ledger, piece)
        left -= piece
        for place in range(ledger.waiting):
            ledger.until_write[place] -= piece
        if ledger.waiting > 0 and ledger.until_write[0] <= 0.0:
            take_effect(ledger)
        if ledger.until_cut <= 0.0 and left > 0.0:
            drop(ledger)


def advance_to_reading(ledger: Ledger, duration: float) -> None:
    """Let ``duration`` pass, in s, of which the true interval need not have what was inserted."""
    inserted = min(ledger.inserted, duration) if ledger.lag > 0.0 else 0.0
    advance(ledger, duration - inserted)
    if inserted > 0.0:
        ledger.is_waiting = True
        advance(ledger, inserted)
        ledger.is_waiting = False


def send(ledger: Ledger, delay: float, limit: float, budget: float) -> None:
    """Let the force of ``trial`` act after ``delay``, in s, in place of all that would act later.

    ``limit`` is its hold limit, in s, and ``budget`` what it was planned for, in J; if it is later
    than was planned, the forces before it take more of that.
    """
    late = max(delay - ledger.write_delay, 0.0)
    if late > HALF_NS:
        largest = 1.0 + ledger.gain
        budget -= cost_before(ledger, largest, delay)
        budget += cost_before(ledger, largest, ledger.write_delay)
    while ledger.waiting > 0 and ledger.until_write[ledger.waiting - 1] >= delay:
        ledger.waiting -= 1
    place = ledger.waiting
    if place == PLACES:  # then this force is zero, as the one before it is: that one lasts longer
        longer = delay - ledger.until_write[place - 1] + limit
        ledger.waiting_limit[place - 1] = max(ledger.waiting_limit[place - 1], longer)
        return
    for k in range(ledger.axes):
        ledger.axis[k].waiting[place] = ledger.axis[k].trial
    ledger.until_write[place], ledger.waiting_limit[place] = delay, limit
    ledger.waiting_budget[place], ledger.waiting_late[place] = budget, late
    ledger.waiting += 1
    if delay <= 0.0:
        take_effect(ledger)


def _run_motors(ledger: Ledger, piece: float) -> None:
    """Let ``piece`` pass, in s, in which nothing happens."""
    cost = acting_cost(ledger, piece, 1.0 + ledger.gain)
    ledger.given += cost
    for k in range(ledger.axes):
        if ledger.is_waiting:
            wait(ledger.axis[k].motor, piece, ledger.lag)
        else:
            run(ledger.axis[k].motor, piece, ledger.lag)
    ledger.age += piece
    ledger.since += piece
    ledger.quiet += piece
    ledger.until_cut -= piece
    is_overdue = ledger.watchdog == NONE and ledger.age > ledger.held_limit
    if (is_overdue or ledger.is_late) and not ledger.is_dropped:
        # What is left of the force when it ends decays, as if it lasted half the lag longer.
        given = given_so_far(ledger)
        budget = ledger.budget if ledger.is_late else max(ledger.budget, 0.0)
        if given > 0.0:  # else friction has paid for it
            ledger.largest_leak = max(ledger.largest_leak, given - budget)
    if may_be_dropped(ledger):
        ledger.is_unsure, ledger.quiet = True, 0.0
        cost += dropped_cost(ledger, piece)
    ledger.spent += cost


def given_so_far(ledger: Ledger) -> float:
    """Return the most that the acting force gives if it ends now, in J: as one hold."""
    gain = 1.0 + ledger.gain
    given = ledger.given + acting_cost(ledger, 0.5 * ledger.lag, gain)
    if ledger.hand_speed == math.inf:
        return given
    for k in range(ledger.axes):
        axis = ledger.axis[k]
        axis.strength = gain * (
            max(axis.onset, abs(axis.held)) if ledger.lag > 0.0 else abs(axis.held)
        )
    decay = cost_within(ledger, 0.5 * ledger.lag, math.inf)
    return min(given, cost_of_strengths(ledger, ledger.age) + decay)


def may_be_dropped(ledger: Ledger) -> bool:
    """Return whether the watchdog may, or may not yet, have dropped the acting force.

    A reporting watchdog whose report is late may have dropped it; a guarding one need not.
    """
    if ledger.is_dropped or ledger.watchdog == NONE or ledger.watchdog == GUARDING:
        return False
    if ledger.watchdog == SILENT and ledger.tolerance == 0.0:
        return False
    return bool(ledger.age > ledger.held_limit * (1.0 - ledger.tolerance))


def take_effect(ledger: Ledger) -> None:
    """Let the first of the waiting forces act."""
    ledger.was_unsure = ledger.was_unsure or ledger.is_unsure
    limit, ledger.budget = ledger.waiting_limit[0], ledger.waiting_budget[0]
    ledger.is_late = ledger.waiting_late[0] > HALF_NS
    is_none = True  # then nobody needs to know whether it was dropped
    for k in range(ledger.axes):
        axis = ledger.axis[k]
        axis.held = axis.waiting[0]
        axis.onset = max(abs(axis.motor.actual), abs(axis.motor.target))
        is_none = is_none and axis.held == axis.constants.dropped
        retarget(axis.motor, axis.held, ledger.lag, ledger.since == 0.0)
    ledger.waiting -= 1
    for place in range(ledger.waiting):
        ledger.until_write[place] = ledger.until_write[place + 1]
        ledger.waiting_limit[place] = ledger.waiting_limit[place + 1]
        ledger.waiting_budget[place] = ledger.waiting_budget[place + 1]
        ledger.waiting_late[place] = ledger.waiting_late[place + 1]
        for k in range(ledger.axes):
            ledger.axis[k].waiting[place] = ledger.axis[k].waiting[place + 1]
    ledger.age = ledger.given = 0.0
    ledger.is_dropped = is_none
    ledger.held_limit = limit
    if ledger.watchdog == SILENT:
        ledger.until_cut = limit * (1.0 + ledger.tolerance)
    elif ledger.watchdog == NONE:
        ledger.until_cut = ledger.watchdog_limit
    else:  # it will be reported
        ledger.until_cut = math.inf


def drop(ledger: Ledger) -> None:
    """Let the watchdog drop the force."""
    for k in range(ledger.axes):
        axis = ledger.axis[k]
        retarget(axis.motor, axis.constants.dropped, ledger.lag, ledger.since == 0.0)
    ledger.until_cut, ledger.is_dropped = math.inf, True


def acting_cost(ledger: Ledger, duration: float, gain: float) -> float:
    """Return the most that the acting force can give any hand in ``duration``, in s, in J."""
    set_acting(ledger, gain)
    return cost_within(ledger, duration, math.inf)


def set_acting(ledger: Ledger, gain: float) -> None:
    """Let the strengths be those of the acting force."""
    for k in range(ledger.axes):
        axis = ledger.axis[k]
        axis.strength = gain * max(abs(axis.motor.target), abs(axis.motor.actual))


def cost_before(ledger: Ledger, gain: float, delay: float, is_any_hand: bool = False) -> float:
    """Return the most that can be given until a force written now acts, after ``delay``, in J.

    Until then those before it act in turn. With a lag it is what any hand can get.
    """
    is_any_hand = is_any_hand or ledger.lag > 0.0
    first = min(delay, ledger.until_cut)
    if ledger.waiting > 0:
        first = min(first, ledger.until_write[0])
    if delay <= 0.0 or first < 0.0:
        return 0.0
    set_acting(ledger, gain)
    total = cost_within(ledger, first, math.inf if is_any_hand else reach(ledger, first))
    for place in range(ledger.waiting):
        end = ledger.until_write[place + 1] if place + 1 < ledger.waiting else delay
        duration = min(end, delay) - ledger.until_write[place]
        for k in range(ledger.axes):
            axis = ledger.axis[k]
            force = gain * abs(axis.waiting[place])
            axis.strength = max(axis.strength, force) if ledger.lag > 0.0 else force
        if duration > 0.0:
            way = math.inf if is_any_hand else reach(ledger, duration)
            total += cost_within(ledger, duration, way)
    return total


def dropped_cost(ledger: Ledger, duration: float) -> float:
    """Return the most that weights which are not carried can give in ``duration``, in s, in J."""
    for k in range(ledger.axes):
        ledger.axis[k].strength = abs(ledger.axis[k].constants.dropped)
    return cost_within(ledger, duration, math.inf)


def reach(ledger: Ledger, duration: float) -> float:
    """Return how far a hand of the stated speed gets in a hold, in m.

    No reading shows where in a period it was fast; a lag may divide a hold in two.
    """
    if ledger.hand_speed == math.inf:
        return math.inf
    period = ledger.constants.period
    way = ledger.hand_speed * max(duration, period) + 2.0 * ledger.resolution
    return way if ledger.lag == 0.0 else way + ledger.hand_speed * period + 2.0 * ledger.resolution


def cost_of_strengths(ledger: Ledger, duration: float) -> float:
    """Return what a hold of the forces ``strength`` can cost, in J; the motors do not lag."""
    return cost_within(ledger, duration, reach(ledger, duration))


def cost_within(ledger: Ledger, duration: float, way: float) -> float:
    """Return the same if the hand moves by at most ``way``, in m."""
    total = square = 0.0
    for k in range(ledger.axes):
        axis = ledger.axis[k]
        if ledger.is_along_path:
            square += axis.strength * axis.strength
        else:
            total += axis_cost(axis.constants, axis.strength, duration, way)
    if not ledger.is_along_path:
        return total
    friction, damping = ledger.constants.path_friction, ledger.axis[0].constants.damping
    return rigid_cost(math.sqrt(square) + ledger.path_error, friction, damping, duration, way)


def axis_cost(one: AxisConstants, force: float, duration: float, way: float) -> float:
    """Return the cost of a hold of a force on one axis, in J; friction on each axis by itself."""
    force += one.weight_error
    if one.presliding == 0.0:
        return rigid_cost(force, one.friction, one.damping, duration, way)
    return hold_cost(force, one.friction, one.presliding, one.damping, duration, way)
