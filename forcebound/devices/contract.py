"""Contract of every device, and its check.

The check opens the device. On a device without ground truth, which may be hardware, it writes no
force but zero.
"""

import math
from typing import Any

from forcebound.contract import (
    Report,
    Violation,
    describe_raised,
    first_of_each,
    value_faults,
    vector_fault,
)
from forcebound.devices import Device, DeviceModel
from forcebound.messages.packets import MAX_AXES

PROMISES: dict[str, str] = {
    "states": f"states axes (1 to {MAX_AXES}), damping, friction, resolution and saturation",
    "opens": "opens without an operator, and closes",
    "answers": "answers every read and write",
    "shape": "readings and held forces are tuples with one finite number per axis",
    "bounded": "holds no more than it was asked for, and no more than its saturation",
    "value": "is a frozen dataclass that can be copied, changed and pickled",
}

PERIOD_NS = 1_000_000


def check(model: DeviceModel, ticks: int = 100, hold_limit: float = 1.25e-3) -> Report:
    """Return which of the ``PROMISES`` a device keeps.

    Args:
        model: With the parameters that matter.
        ticks: Of 1 ms, in which it is read and written; not in real time.
        hold_limit: See :meth:`forcebound.devices.DeviceModel.open`.
    """
    found = list(value_faults(model)) + _stated_faults(model)
    if any(violation.promise == "states" for violation in found):
        return Report(PROMISES, first_of_each(found), 0)
    try:
        device = model.open(None, hold_limit)
        try:
            _use(device, model, ticks, found)
        finally:
            device.close()
    except (Exception, SystemExit) as error:
        raised = describe_raised(error)
        found.append(Violation("opens", "a device, and an end", raised, "open(None, ...), close()"))
    return Report(PROMISES, first_of_each(found), 3 * ticks)


def _stated_faults(model: Any) -> list[Violation]:
    found = []
    axes = getattr(model, "axes", None)
    if not isinstance(axes, int) or not 1 <= axes <= MAX_AXES:
        found.append(Violation("states", f"1 to {MAX_AXES}", repr(axes), "axes"))
    for name, unit, lowest in (
        ("damping", "N s/m", math.ulp(0.0)),
        ("saturation", "N", math.ulp(0.0)),
        ("friction", "N", 0.0),
        ("resolution", "m", 0.0),
    ):
        value = getattr(model, name, None)
        if not isinstance(value, int | float) or not lowest <= value < math.inf:
            bound = "> 0" if lowest else ">= 0"
            found.append(Violation("states", f"{bound} {unit}", repr(value), name))
    return found


def _use(device: Device, model: DeviceModel, ticks: int, found: list[Violation]) -> None:
    axes = model.axes
    is_simulated = device.truth() is not None
    forces = (0.0, 0.5, -1e3, 1e30) if is_simulated else (0.0,)
    device.engage(0)
    for tick in range(ticks):
        time_ns = tick * PERIOD_NS
        force = (forces[tick % len(forces)],) * axes
        where = f"tick {tick}, force {force}"
        try:
            reading, held = device.read(time_ns), device.write(time_ns, force)
        except (Exception, SystemExit) as error:
            found.append(Violation("answers", "an answer", describe_raised(error), where))
            continue
        for answer, unit in ((reading, "m"), (held, "N")):
            fault = vector_fault(answer, axes, unit)
            if fault is not None:
                found.append(Violation("shape", fault.expected, fault.got, where))
                return
            if not all(map(math.isfinite, answer)):
                found.append(Violation("shape", "finite numbers", repr(answer), where))
        largest = min(math.hypot(*force), model.saturation) * (1 + 1e-12)
        if not math.hypot(*held) <= largest:
            found.append(Violation("bounded", f"at most {largest:.4g} N", repr(held), where))
