"""Contract of every device, and its check.

The check opens the device. On a device without ground truth, which may be hardware, it writes no
force but zero.
"""

import math
from typing import Any

from forcebound.devices import Device, DeviceModel
from forcebound.messages.packets import MAX_AXES
from forcebound.parts.contract import VALUE, Findings, Report

PROMISES: dict[str, str] = {
    "states": f"states axes (1 to {MAX_AXES}), damping, friction, resolution and saturation",
    "opens": "opens without an operator, and closes",
    "answers": "answers every read and write",
    "shape": "readings and held forces are tuples with one finite number per axis",
    "bounded": "holds no more than it was asked for, and no more than its saturation",
    **VALUE,
}
OF_OPEN = ("answers", "shape", "bounded")  # promises that only an open device can keep or break

PERIOD_NS = 1_000_000


def check(model: DeviceModel, ticks: int = 100, hold_limit: float = 1.25e-3) -> Report:
    """Return which of the ``PROMISES`` a device keeps.

    Args:
        model: With the parameters that matter.
        ticks: Of 1 ms, in which it is read and written; not in real time.
        hold_limit: See :meth:`forcebound.devices.DeviceModel.open`.
    """
    found = Findings()
    found.check_value(model)
    _check_statements(model, found)
    if found.is_broken("states"):
        return found.report(PROMISES, 0, unseen=("opens", *OF_OPEN))
    with found.noting("opens", "a device that closes", "open(None, ...), close()"):
        device = model.open(None, hold_limit)
        try:
            _use(device, model, ticks, found)
        finally:
            device.close()
    unseen = OF_OPEN if found.is_broken("opens") else ()
    return found.report(PROMISES, 3 * ticks, unseen=unseen)


def _check_statements(model: Any, found: Findings) -> None:
    axes = getattr(model, "axes", None)
    if not isinstance(axes, int) or not 1 <= axes <= MAX_AXES:
        found.add("states", f"1 to {MAX_AXES}", repr(axes), "axes")
    for name, unit in (("damping", "N s/m"), ("saturation", "N")):
        found.check_number("states", model, name, unit, above=True)
    for name, unit in (("friction", "N"), ("resolution", "m")):
        found.check_number("states", model, name, unit, above=False)


def _use(device: Device, model: DeviceModel, ticks: int, found: Findings) -> None:
    axes = model.axes
    is_simulated = device.truth() is not None
    forces = (0.0, 0.5, -1e3, 1e30) if is_simulated else (0.0,)
    device.engage(0)
    for tick in range(ticks):
        time_ns = tick * PERIOD_NS
        force = (forces[tick % len(forces)],) * axes
        where = f"tick {tick}, force {force}"
        with found.noting("answers", "an answer", where):
            reading, held = device.read(time_ns), device.write(time_ns, force)
            found.check_vector(reading, axes, "m", where, finite="shape")
            is_vector = found.check_vector(held, axes, "N", where, finite="shape")
            largest = min(math.hypot(*force), model.saturation) * (1 + 1e-12)
            if is_vector and not math.hypot(*held) <= largest:
                found.add("bounded", f"at most {largest:.4g} N", repr(held), where)
