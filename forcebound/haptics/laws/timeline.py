"""The run of time in a ledger: the old force acts until the new one takes effect.

The watchdog may drop it.
"""

import math

from forcebound.haptics.laws.hold_cost import hold_cost, rigid_cost
from forcebound.haptics.laws.ledger import GUARDING, NONE, SILENT, Ledger
from forcebound.haptics.laws.sample import AxisConstants
from forcebound.haptics.laws.waveform import retarget, run


def advance(ledger: Ledger, duration: float) -> None:
    """Let ``duration`` pass, in s: forces take effect and are dropped on the way."""
    left = duration
    while left > 0.0:
        piece = min(left, ledger.until_cut)
        is_pending = ledger.until_write >= 0.0
        if is_pending:
            piece = min(piece, ledger.until_write)
        _run_motors(ledger, piece)
        left -= piece
        if is_pending:
            ledger.until_write -= piece
            if ledger.until_write <= 0.0:
                take_effect(ledger)
        if ledger.until_cut <= 0.0 and left > 0.0:
            drop(ledger)


def _run_motors(ledger: Ledger, piece: float) -> None:
    """Let ``piece`` pass, in s, in which nothing happens."""
    cost = acting_cost(ledger, piece, 1.0 + ledger.gain)
    ledger.given += cost
    for k in range(ledger.axes):
        run(ledger.axis[k].motor, piece, ledger.lag)
    ledger.age += piece
    ledger.since += piece
    ledger.until_cut -= piece
    if ledger.watchdog == NONE and ledger.age > ledger.held_limit and not ledger.is_dropped:
        ledger.largest_leak = max(ledger.largest_leak, ledger.given - max(ledger.budget, 0.0))
    if may_be_dropped(ledger):
        ledger.is_unsure = True
        cost += dropped_cost(ledger, piece)
    ledger.spent += cost


def may_be_dropped(ledger: Ledger) -> bool:
    """Whether the watchdog may, or may not yet, have dropped the acting force.

    A reporting watchdog whose report is late may have dropped it; a guarding one need not.
    """
    if ledger.is_dropped or ledger.watchdog == NONE or ledger.watchdog == GUARDING:
        return False
    if ledger.watchdog == SILENT and ledger.tolerance == 0.0:
        return False
    return bool(ledger.age > ledger.held_limit * (1.0 - ledger.tolerance))


def take_effect(ledger: Ledger) -> None:
    """Let the force act that was written last."""
    for k in range(ledger.axes):
        retarget(ledger.axis[k].motor, ledger.axis[k].pending, ledger.lag, ledger.since == 0.0)
    limit = ledger.pending_limit
    ledger.age = ledger.given = 0.0
    ledger.is_dropped = False
    ledger.held_limit, ledger.budget, ledger.until_write = limit, ledger.pending_budget, -1.0
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
    """Return the most that the acting force can give in ``duration``, in s, in J."""
    for k in range(ledger.axes):
        axis = ledger.axis[k]
        axis.strength = gain * max(abs(axis.motor.target), abs(axis.motor.actual))
    return cost_of_strengths(ledger, duration)


def dropped_cost(ledger: Ledger, duration: float) -> float:
    """Return the most that weights which are not carried can give in ``duration``, in s, in J."""
    for k in range(ledger.axes):
        ledger.axis[k].strength = abs(ledger.axis[k].constants.dropped)
    return cost_of_strengths(ledger, duration)


def cost_of_strengths(ledger: Ledger, duration: float) -> float:
    """Return what a hold of the forces ``strength`` can cost, in J; the motors do not lag."""
    total = square = 0.0
    for k in range(ledger.axes):
        axis = ledger.axis[k]
        if ledger.is_along_path:
            square += axis.strength * axis.strength
        else:
            total += axis_cost(axis.constants, axis.strength, duration)
    if not ledger.is_along_path:
        return total
    friction, damping = ledger.constants.path_friction, ledger.axis[0].constants.damping
    return rigid_cost(math.sqrt(square) + ledger.path_error, friction, damping, duration)


def axis_cost(one: AxisConstants, force: float, duration: float) -> float:
    """Return the cost of a hold of a force on one axis, in J; friction on each axis by itself."""
    force += one.weight_error
    if one.presliding == 0.0:
        return rigid_cost(force, one.friction, one.damping, duration)
    return hold_cost(force, one.friction, one.presliding, one.damping, duration)
