"""Contract of every device, and its check.

The check opens the device, twice. On a device without ground truth, which may be hardware, it
writes no force but zero. An emulated one has ground truth: it gets all that a driver must refuse.
"""

import dataclasses
import math
from collections.abc import Callable
from typing import Any

from forcebound.axes import units_on
from forcebound.errors import DeviceError
from forcebound.haptics.devices import Device, DeviceModel
from forcebound.haptics.devices.guard import GuardedDevice
from forcebound.haptics.parts.contract import SIGNALS, VALUE, Findings, Report
from forcebound.haptics.parts.user_module import describe_user_error
from forcebound.messages.packets import MAX_AXES, MAX_COUNT

PROMISES: dict[str, str] = {
    "states": f"states axes, 1 to {MAX_AXES}",
    "opens": "opens without an operator, and closes",
    "answers": "answers every read and write",
    "shape": "readings and held forces are tuples with one finite number per axis",
    "bounded": "holds no more than it was asked for, and no more than its saturation",
    "stamps": "stamps of a read and of the write after it, in whole ns, in this order",
    "cut": "a reported cut has a time within the hold, and one finite reading per axis",
    "set_hold_limit": "returns the hold limit that it has set, in s",
    "guard": "a guarding watchdog: a force that has moved back is gone at the hold limit; later, at"
    " most guard_period after the last look that saw nothing",
    "orientation": "the orientation of the tip is a quaternion w x y z of length 1",
    "buttons": f"buttons are a whole number from 0 to {MAX_COUNT}, a bit for each",
    "kinematics": "finite positions of the tip, and one finite torque per joint",
    "reopens": "opens again after it was closed: nothing is left locked or out of order",
    "port": "says with a DeviceError that there is no such port",
    **SIGNALS,
    **VALUE,
}
#: Promises that only an open device can keep or break.
NEED_OPEN_DEVICE = (
    *("answers", "shape", "bounded", "stamps", "set_hold_limit", "cut", "guard", "orientation"),
    *("buttons", "kinematics", "reopens"),
)

PERIOD_NS = 1_000_000
HOLD = 2e-3  # s, of the checks of a watchdog
GUARD_TRIALS = 32
REST_NS = 500_000_000  # between them, until the device rests again
NO_PORT = "/nowhere/port"


def check(model: DeviceModel, ticks: int = 100, hold_limit: float = 1.25e-3) -> Report:
    """Return which of the ``PROMISES`` a device keeps in so many ticks, not in real time."""
    found = Findings()
    found.check_value(model)
    if not isinstance(model.axes, int) or not 1 <= model.axes <= MAX_AXES:
        found.add("states", f"1 to {MAX_AXES}", repr(model.axes), "axes")
        return found.report(PROMISES, 0, unseen=("opens", *NEED_OPEN_DEVICE))
    absent: list[str] = []
    with found.noting("opens", "a device that closes", "open(None, ...), close()"):
        device = model.open(None, hold_limit)
        if not isinstance(device, Device):
            raise TypeError(f"expected a forcebound.haptics.devices.Device, got {device!r}")
        try:
            device.published.declare(model.declared())
            _use(device, model, ticks, found)
            absent = _use_extras(device, model, ticks * PERIOD_NS, found)
        finally:
            device.close()
        with found.noting("reopens", "an open device", "open(None, ...) after close()"):
            model.open(None, hold_limit).close()
    unseen = [*NEED_OPEN_DEVICE] if found.is_broken("opens") else absent
    if model.port:
        _check_port(model, hold_limit, found)
    else:
        unseen = [*unseen, "port"]
    return found.report(PROMISES, 3 * ticks, unseen=unseen)


def _check_port(model: Any, hold_limit: float, found: Findings) -> None:
    where = f"open(None, ...) with the port {NO_PORT}"
    try:
        dataclasses.replace(model, port=NO_PORT).open(None, hold_limit).close()
    except DeviceError:
        return
    except Exception as error:
        found.add("port", "a DeviceError", describe_user_error(error), where)
    else:
        found.add("port", "a DeviceError", "an open device", where)


def reading_units(model: DeviceModel) -> tuple[str, str]:
    """Return the units of a device's readings and forces: of an arm's joints, or of its axes."""
    if model.kinematics() is not None:
        return "rad", "N m"
    return units_on(model.named_axes, "m"), units_on(model.named_axes, "N")


def _use(device: Device, model: DeviceModel, ticks: int, found: Findings) -> None:
    axes = model.axes
    is_simulated = device.truth() is not None
    place, effort = reading_units(model)
    forces = (0.0, 0.5, -1e3, 1e30, math.nan) if is_simulated else (0.0,)
    device.engage(0)
    with found.noting("stamps", PROMISES["stamps"], "stamps() before the first write"):
        device.read(0)
        GuardedDevice(device).stamps()
    for tick in range(ticks):
        time_ns = tick * PERIOD_NS
        force = (forces[tick % len(forces)],) * axes
        where = f"tick {tick}, force {force}"
        with found.noting("answers", "an answer", where):
            reading, held = device.read(time_ns), device.write(time_ns, force)
            found.check_vector(reading, axes, place, where, finite="shape")
            is_vector = found.check_vector(held, axes, effort, where, finite="shape")
            asked = math.hypot(*force)
            largest = min(0.0 if math.isnan(asked) else asked, model.saturation) * (1 + 1e-12)
            if is_vector and not math.hypot(*held) <= largest:
                found.add("bounded", f"at most {largest:.4g} N", repr(held), where)


def _use_extras(device: Device, model: DeviceModel, time_ns: int, found: Findings) -> list[str]:
    """Check the optional members from ``time_ns`` on; return the promises of absent ones."""
    guard, zero = GuardedDevice(device), (0.0,) * model.axes

    def stamps() -> object:
        guard.write(time_ns, zero)
        guard.latch_jitter()
        guard.fresh_reading()
        both = guard.stamps()
        if both is not None and both[0] > both[1]:
            raise DeviceError(f"expected the read, then the write, got {both}")
        return both

    def cut() -> object:
        end_ns = time_ns + 10 * PERIOD_NS
        guard.set_hold_limit(HOLD)
        guard.write(time_ns, zero)
        device.read(end_ns)
        report = guard.cut()
        if report is not None and not time_ns < report[0] <= end_ns:
            raise DeviceError(f"expected a time within the hold of 10 ms, got {report[0]} ns")
        if report is None and device.truth() is not None and model.watchdog == "reporting":
            raise DeviceError("expected a report of a hold of 10 ms, got None")
        return report

    def kinematics() -> object:
        if guard.kinematics is None:
            return None
        angles = device.read(time_ns)
        return guard.kinematics.torque(angles, (1.0,) * len(guard.kinematics.position(angles)))

    checks: dict[str, Callable[[], object]] = {
        "stamps": stamps,
        "set_hold_limit": lambda: guard.set_hold_limit(HOLD),
        "cut": cut,
        "orientation": guard.orientation,
        "buttons": guard.buttons,
        "kinematics": kinematics,
    }
    absent = []
    for name, check_member in checks.items():
        with found.noting(name, PROMISES[name], name):
            device.read(time_ns)
            if check_member() is None:
                absent.append(name)
    if device.truth() is None or model.watchdog != "guarding":
        return [*absent, "guard"]
    _check_guard(device, model, time_ns + REST_NS, found)
    return absent


def _check_guard(device: Any, model: Any, time_ns: int, found: Findings) -> None:
    """Push the free device with forces of all sizes, and see how long it gives each of them."""
    with found.noting("guard", "a device that sets its hold limit, with stamps and cuts", "guard"):
        latest = 1.0 + (model.watchdog_tolerance or 0.0)  # hold limits
        limit_ns = round(device.set_hold_limit(HOLD) * 1e9 * latest)
        period_ns = round(model.guard_period * 1e9)
        for trial in range(GUARD_TRIALS):
            size = model.saturation * 0.5 ** (trial // 2 % 6) * (-1) ** trial
            time_ns += REST_NS + trial * period_ns // 9  # at any phase of its timer
            start = device.read(time_ns)
            device.write(time_ns, (size / math.sqrt(model.axes),) * model.axes)
            limit_at = device.stamps()[1] + limit_ns
            for now_ns in range(limit_at, limit_at + 2 * limit_ns, max(period_ns // 20, 1)):
                moved = zip(device.read(now_ns), start, strict=True)
                if any(size * (now - then) < 0.0 for now, then in moved):
                    latest_ns = now_ns + (now_ns > limit_at) * period_ns
                    device.read(latest_ns + 4 * PERIOD_NS)
                    report = device.cut()
                    if report is None or report[0] > latest_ns:
                        where = f"force {size:.3g} at {time_ns} ns, hold limit {limit_ns} ns"
                        found.add("guard", f"a cut by {latest_ns} ns", repr(report), where)
                    break
