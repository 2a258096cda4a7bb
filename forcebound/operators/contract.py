"""Contract of every operator, and its check."""

import math
from itertools import pairwise

from forcebound.contract import (
    Report,
    Violation,
    describe_raised,
    first_of_each,
    value_faults,
    vector_fault,
)
from forcebound.messages.packets import Vector
from forcebound.operators import Operator

PROMISES: dict[str, str] = {
    "passive": "mass, stiffness and damping are finite and not negative",
    "answers": "has a target at every time",
    "shape": "the target is a tuple of finite numbers, always as many",
    "even": "the target moves by at most 1 mm in 1 ms",
    "pure": "the target is a function of time",
    "value": "is a frozen dataclass that can be copied, changed and pickled",
}

SPEED = 1.0  # m/s, the most that a target may move; faster than any hand in a contact task


def check(model: Operator, seconds: float = 5.0) -> Report:
    """Return which of the ``PROMISES`` an operator keeps.

    Args:
        model: With the parameters that matter.
        seconds: How much of its path is looked at.
    """
    found = list(value_faults(model))
    for name, unit in (("mass", "kg"), ("stiffness", "N/m"), ("damping", "N s/m")):
        value = getattr(model, name, None)
        if not isinstance(value, int | float) or not 0.0 <= value < math.inf:
            found.append(Violation("passive", f">= 0 {unit}", repr(value), name))
    times = [0.001 * k for k in range(round(seconds * 1000))]
    targets = [_target(model, time, found) for time in times]
    for time, (before, after) in zip(times[1:], pairwise(targets), strict=True):
        if before and after and len(before) != len(after):
            expected = f"{len(before)} numbers, as before"
            found.append(Violation("shape", expected, repr(after), f"target({time})"))
        elif before and after and math.dist(before, after) > SPEED * 0.001 * (1 + 1e-9):
            moved = f"{math.dist(before, after) * 1e3:.3g} mm in 1 ms"
            found.append(Violation("even", "at most 1 mm in 1 ms", moved, f"target({time})"))
    ignored: list[Violation] = []
    again = [_target(model, time, ignored) for time in reversed(times)]
    for time, one, other in zip(times, targets, reversed(again), strict=True):
        if one != other:
            found.append(Violation("pure", f"{one}, as before", repr(other), f"target({time})"))
    return Report(PROMISES, first_of_each(found), 2 * len(times))


def _target(model: Operator, time: float, found: list[Violation]) -> Vector:
    """The target; empty, with the broken promise, if there is none."""
    where = f"target({time})"
    try:
        target = model.target(time)
        fault = vector_fault(target, len(target), "m")
    except (Exception, SystemExit) as error:
        found.append(Violation("answers", "a target", describe_raised(error), where))
        return ()
    if fault is not None or not target or not all(map(math.isfinite, target)):
        found.append(Violation("shape", "a tuple of finite numbers in m", repr(target), where))
        return ()
    return tuple(target)
