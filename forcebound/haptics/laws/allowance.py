"""The largest force for which a hold costs no more than the ledger can pay.

For rigid friction in one direction this is a formula (``rigid_force``). With a lag, presliding, or
axes that differ, it is found by bisection along the commanded direction, from the safe side: the
cost grows with the force.

Without a watchdog there are two conditions: a hold of the hold limit may cost what the ledger has,
one as long as the force can stay on may cost the allowance more.
"""

import math

from forcebound.haptics.laws.hold_cost import lagging_cost, rigid_force
from forcebound.haptics.laws.ledger import NONE, Ledger
from forcebound.haptics.laws.timeline import cost_of_strengths, reach

HALVINGS = 40  # of the saturation: 8 pN


def gain_at(ledger: Ledger, end: int) -> float:
    """Return the gain at one end of its range, 0 or 1; 1 if it has no error."""
    return 1.0 + (2.0 * end - 1.0) * ledger.gain


def strongest_gain(ledger: Ledger, end: int) -> float:
    """Return the gain with which forces before the new one cost most: motors may differ."""
    return gain_at(ledger, end) if ledger.axes == 1 else 1.0 + ledger.gain


def largest_force(ledger: Ledger) -> float:
    """Return the largest force in the direction ``trial`` that may be held, in N."""
    low, high = 0.0, ledger.saturation
    if ledger.is_rigid:
        one = ledger.axis[0].constants
        friction, error = one.friction, one.weight_error
        if ledger.is_along_path:
            friction, error = ledger.constants.path_friction, ledger.path_error
        for end in range(ledger.ends):
            for level in range(_levels(ledger)):
                most, duration = _most(ledger, end, level), _duration(ledger, level)
                way = reach(ledger, duration)
                force = rigid_force(most, friction, one.damping, duration, way)
                if ledger.write_delay > 0.0:  # and if it already acted
                    most, delay = most + ledger.before[end], ledger.write_delay
                    again = rigid_force(most, friction, one.damping, duration, way, delay)
                    force = min(force, again)
                high = min(high, max(force - error, 0.0) / gain_at(ledger, end))
        return high
    force = high
    for _ in range(HALVINGS):  # the saturation itself comes first
        if _may_be_held(ledger, force):
            low = force
        else:
            high = force
        force = 0.5 * (low + high)
    return low


def surplus(ledger: Ledger, end: int, size: float) -> float:
    """Return what ``size`` times the force ``trial`` leaves of the energy available, in J."""
    left = math.inf
    for level in range(_levels(ledger)):
        most = _most(ledger, end, level)
        left = min(left, most - cost(ledger, end, size, _duration(ledger, level)))
    return left


def _levels(ledger: Ledger) -> int:
    """Conditions that a force meets: for a punctual hold and, without a watchdog, a late one."""
    return 2 if ledger.watchdog == NONE else 1


def _most(ledger: Ledger, end: int, level: int) -> float:
    """Most that a hold may cost, in J."""
    return ledger.available[end] + level * ledger.allowance


def _duration(ledger: Ledger, level: int) -> float:
    """Return the longest duration of a hold of this level, in s."""
    return ledger.watchdog_limit if level == 1 else planned_hold(ledger)


def planned_hold(ledger: Ledger) -> float:
    """Return how long the next force must be expected to last, in s, if it is punctual."""
    if ledger.watchdog == NONE:
        return ledger.planned_limit
    return ledger.planned_limit * (1.0 + ledger.tolerance)


def _may_be_held(ledger: Ledger, force: float) -> bool:
    """Return whether ``force`` in the direction ``trial`` costs at most what there is.

    In deficit it may cost what no force at all does: the rest of the old one, paid for before.
    """
    for end in range(ledger.ends):
        for level in range(_levels(ledger)):
            duration = _duration(ledger, level)
            charged = cost(ledger, end, force, duration)
            if charged > _most(ledger, end, level) and charged > cost(ledger, end, 0.0, duration):
                return False
    return True


def cost(ledger: Ledger, end: int, size: float, duration: float) -> float:
    """Return what is charged for a hold of ``size`` times the force ``trial``, in J.

    It is what the hold can cost, or more, if it would cost more with this force as the one that
    acts already: so a force lasts (``docs/theory.md``, lemma 9). Zero is charged its own cost.
    """
    more = 0.0
    if ledger.write_delay > 0.0 and size > 0.0:
        _set_strengths(ledger, size * strongest_gain(ledger, end))
        more = max(cost_of_strengths(ledger, ledger.write_delay) - ledger.before[end], 0.0)
    _set_strengths(ledger, size * gain_at(ledger, end))
    if ledger.lag == 0.0:
        return more + cost_of_strengths(ledger, duration)
    lag, way = ledger.lag, reach(ledger, duration)
    again = (1.0 + ledger.gain) / gain_at(ledger, end)
    total = square = before_square = 0.0
    for k in range(ledger.axes):
        axis = ledger.axis[k]
        one, force = axis.constants, axis.strength
        before = max(_strongest(ledger, k), again * force)
        square += force * force
        before_square += before * before
        error = one.weight_error - (one.friction if one.presliding == 0.0 else 0.0)
        if not ledger.is_along_path:
            before, after = max(before + error, 0.0), max(force + error, 0.0)
            total += lagging_cost(before, after, one.damping, duration, lag, way)
    if not ledger.is_along_path:
        return more + total
    error = ledger.path_error - ledger.constants.path_friction
    before = max(math.sqrt(before_square) + error, 0.0)
    after = max(math.sqrt(square) + error, 0.0)
    b = ledger.axis[0].constants.damping
    return more + lagging_cost(before, after, b, duration, lag, way)


def _set_strengths(ledger: Ledger, scale: float) -> None:
    for k in range(ledger.axes):
        ledger.axis[k].strength = abs(scale * ledger.axis[k].trial)


def _strongest(ledger: Ledger, k: int) -> float:
    """Return the largest force of a motor, in N, when the next takes effect."""
    axis = ledger.axis[k]
    force = abs(axis.motor.actual)
    if ledger.write_delay > 0.0 or ledger.inserted > 0.0:
        force = max(force, abs(axis.motor.target))
    for place in range(ledger.waiting):
        force = max(force, abs(axis.waiting[place]))
    return force * (1.0 + ledger.gain)
