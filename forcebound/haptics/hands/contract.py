"""Contract of every operator, and its check."""

import math
from itertools import pairwise

from forcebound.haptics.hands import Operator
from forcebound.haptics.parts.contract import VALUE, Findings, Report, vector_fault
from forcebound.messages.packets import Vector

PROMISES: dict[str, str] = {
    "passive": "mass, stiffness and damping are finite and not negative",
    "answers": "has a target at every time",
    "shape": "the target is a tuple of finite numbers, always as many",
    "even": "the target moves by at most 1 mm in 1 ms",
    "pure": "the target is a function of time",
    **VALUE,
}

SPEED = 1.0  # m/s, the most that a target may move; faster than any hand in a contact task


def check(model: Operator, seconds: float = 5.0) -> Report:
    """Return which of the ``PROMISES`` an operator keeps in this time of its path."""
    found = Findings()
    found.check_value(model)
    for name, unit in (("mass", "kg"), ("stiffness", "N/m"), ("damping", "N s/m")):
        found.check_number("passive", model, name, unit)
    times = [0.001 * k for k in range(round(seconds * 1000))]
    targets = [_target(model, time, found) for time in times]
    for time, (before, after) in zip(times[1:], pairwise(targets), strict=True):
        if before and after and len(before) != len(after):
            expected = f"{len(before)} numbers, as before"
            found.add("shape", expected, repr(after), f"target({time})")
        elif before and after and math.dist(before, after) > SPEED * 0.001 * (1 + 1e-9):
            moved = f"{math.dist(before, after) * 1e3:.3g} mm in 1 ms"
            found.add("even", "at most 1 mm in 1 ms", moved, f"target({time})")
    again = [_target(model, time, Findings()) for time in reversed(times)]
    found.check_repeats(targets, again[::-1], f"targets at {len(times)} times, one per ms")
    return found.report(PROMISES, 2 * len(times))


def _target(model: Operator, time: float, found: Findings) -> Vector:
    """The target; empty, with the broken promise noted, if there is none."""
    where = f"target({time})"
    with found.noting("answers", "a target", where):
        target = model.target(time)
        fault = vector_fault(target, len(target), "m")
        if fault is None and target and all(map(math.isfinite, target)):
            return tuple(target)
        found.add("shape", "a tuple of finite numbers in m", repr(target), where)
    return ()
