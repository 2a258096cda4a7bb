"""Contract of every device, and its check.

The check opens the device, twice. On a device without ground truth, which may be hardware, it
writes no force but zero. An emulated one has ground truth: it gets all that a driver must refuse.
"""

import dataclasses
import math
from typing import Any

from forcebound.errors import DeviceError
from forcebound.haptics.devices import Device, DeviceModel
from forcebound.haptics.devices.guard import guarded
from forcebound.haptics.parts import overridden
from forcebound.haptics.parts.contract import SIGNALS, VALUE, Findings, Report, is_unit
from forcebound.haptics.parts.user_module import describe_user_error
from forcebound.messages.packets import MAX_AXES, MAX_COUNT

PROMISES: dict[str, str] = {
    "states": f"states axes (1 to {MAX_AXES}), damping, friction, resolution, saturation and"
    " watchdog",
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
SENSED = ("orientation", "buttons")
#: Promises that only an open device can keep or break.
OF_OPEN = (
    *("answers", "shape", "bounded", "stamps", "set_hold_limit", "cut", "guard", *SENSED),
    *("kinematics", "reopens"),
)

PERIOD_NS = 1_000_000
HOLD = 2e-3  # s, of the checks of a watchdog
GUARD_TRIALS = 32
REST_NS = 500_000_000  # between them, until the device rests again
NO_PORT = "/nowhere/port"


def check(model: DeviceModel, ticks: int = 100, hold_limit: float = 1.25e-3) -> Report:
    """Return which of the ``PROMISES`` a device keeps.

    Args:
        model: With the parameters that matter.
        ticks: Of 1 ms, in which it is read and written; not in real time.
        hold_limit: See :meth:`forcebound.haptics.devices.DeviceModel.open`.
    """
    found = Findings()
    found.check_value(model)
    _check_statements(model, found)
    if found.is_broken("states"):
        return found.report(PROMISES, 0, unseen=("opens", *OF_OPEN))
    absent: list[str] = []
    with found.noting("opens", "a device that closes", "open(None, ...), close()"):
        device = model.open(None, hold_limit)
        if not isinstance(device, Device):
            raise TypeError(f"expected a forcebound.haptics.devices.Device, got {device!r}")
        try:
            _use(device, model, ticks, found)
            absent = _use_extras(device, model, ticks * PERIOD_NS, found)
            found.check_signals(device, model.signals)
        finally:
            device.close()
        with found.noting("reopens", "an open device", "open(None, ...) after close()"):
            model.open(None, hold_limit).close()
    unseen = [*OF_OPEN] if found.is_broken("opens") else absent
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


def _check_statements(model: Any, found: Findings) -> None:
    axes = model.axes
    if not isinstance(axes, int) or not 1 <= axes <= MAX_AXES:
        found.add("states", f"1 to {MAX_AXES}", repr(axes), "axes")
    found.check_number("states", model, "saturation", "N", above=True)
    for name, unit in (("damping", "N s/m"), ("friction", "N"), ("resolution", "m")):
        value = getattr(model, name)
        if not isinstance(value, tuple):
            found.check_number("states", model, name, unit, above=name == "damping")
        elif len(value) != axes or not all(number >= 0.0 for number in value):
            found.add("states", f"a number >= 0 {unit}, or {axes}", repr(value), name)


def _use(device: Device, model: DeviceModel, ticks: int, found: Findings) -> None:
    axes = model.axes
    is_simulated = device.truth() is not None
    forces = (0.0, 0.5, -1e3, 1e30, math.nan) if is_simulated else (0.0,)
    device.engage(0)
    for tick in range(ticks):
        time_ns = tick * PERIOD_NS
        force = (forces[tick % len(forces)],) * axes
        where = f"tick {tick}, force {force}"
        with found.noting("answers", "an answer", where):
            reading, held = device.read(time_ns), device.write(time_ns, force)
            found.check_vector(reading, axes, "m", where, finite="shape")
            is_vector = found.check_vector(held, axes, "N", where, finite="shape")
            asked = math.hypot(*force)
            largest = min(0.0 if math.isnan(asked) else asked, model.saturation) * (1 + 1e-12)
            if is_vector and not math.hypot(*held) <= largest:
                found.add("bounded", f"at most {largest:.4g} N", repr(held), where)


def _use_extras(device: Any, model: DeviceModel, time_ns: int, found: Findings) -> list[str]:
    """Check the optional members from ``time_ns`` on; return the promises of absent ones."""
    checks = {
        "stamps": lambda: _check_stamps(device, model.axes, time_ns, found),
        "set_hold_limit": lambda: _check_limit(device, found),
        "cut": lambda: _check_cut(device, model, time_ns, found),
        "orientation": lambda: _check_orientation(device, time_ns, found),
        "buttons": lambda: _check_buttons(device, time_ns, found),
        "kinematics": lambda: _check_kinematics(device, model.axes, time_ns, found),
    }
    own = overridden(device, Device)
    absent = [name for name in checks if name not in own]
    if device.kinematics is not None:
        absent.remove("kinematics")
    for name in SENSED:
        with found.noting(name, "an answer", f"{name}()"):
            if name in own and getattr(device, name)() is None:
                absent.append(name)
    for name in checks.keys() - absent:
        checks[name]()
    if device.truth() is None or model.watchdog != "guarding":
        return [*absent, "guard"]
    _check_guard(device, model, time_ns + REST_NS, found)
    return absent


def _check_stamps(device: Any, axes: int, time_ns: int, found: Findings) -> None:
    with found.noting("stamps", "two stamps", "stamps()"):
        device.read(time_ns)
        device.write(time_ns, (0.0,) * axes)
        read_ns, write_ns = device.stamps()
        if not (isinstance(read_ns, int) and isinstance(write_ns, int) and read_ns <= write_ns):
            found.add(
                "stamps", "the read, then the write", f"{read_ns!r}, {write_ns!r}", "stamps()"
            )
        jitter_ns = device.latch_jitter()
        if jitter_ns is not None and not (isinstance(jitter_ns, int) and jitter_ns >= 0):
            found.add("stamps", "at least 0 ns", repr(jitter_ns), "latch_jitter()")
        reading = device.fresh_reading()
        if reading is not None:
            found.check_vector(reading, axes, "m or rad", "fresh_reading()", finite="stamps")


def _check_limit(device: Any, found: Findings) -> None:
    with found.noting("set_hold_limit", "a hold limit > 0 s", f"set_hold_limit({HOLD})"):
        guarded(device).set_hold_limit(HOLD)


def _check_guard(device: Any, model: Any, time_ns: int, found: Findings) -> None:
    """Push the free device with forces of all sizes, and see how long it gives each of them."""
    with found.noting("guard", "a device that sets its hold limit, with stamps and cuts", "guard"):
        latest = 1.0 + (model.watchdog_tolerance or 0.0)  # hold limits
        limit_ns = round(device.set_hold_limit(HOLD) * 1e9 * latest)
        period_ns = round(model.guard_period * 1e9)
        for trial in range(GUARD_TRIALS):
            size = model.saturation * 0.5 ** (trial // 2 % 6) * (-1) ** trial
            time_ns += REST_NS + trial * period_ns // 9  # at any phase of a timer of its own
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


def _check_cut(device: Any, model: Any, time_ns: int, found: Findings) -> None:
    axes, end_ns = model.axes, time_ns + 10 * PERIOD_NS
    with found.noting("cut", "a report, or None", "cut() after a hold of 10 ms"):
        device.set_hold_limit(HOLD)
        device.write(time_ns, (0.0,) * axes)
        device.read(end_ns)
        report = device.cut()
        if report is not None:
            when, where = report
            found.check_vector(where, axes, "m or rad", "cut()", finite="cut")
            if not time_ns < when <= end_ns:
                found.add("cut", "a time within the hold, in ns", repr(when), "cut()")
        elif device.truth() is not None and model.watchdog == "reporting":
            found.add("cut", "a report", "None", "cut() after a hold of 10 ms")


def _check_orientation(device: Any, time_ns: int, found: Findings) -> None:
    with found.noting("orientation", "a quaternion", "orientation()"):
        device.read(time_ns)
        w, x, y, z = device.orientation()
        if not is_unit((w, x, y, z)):
            found.add("orientation", "length 1", repr((w, x, y, z)), "orientation()")


def _check_buttons(device: Any, time_ns: int, found: Findings) -> None:
    with found.noting("buttons", "a whole number", "buttons()"):
        device.read(time_ns)
        buttons = device.buttons()
        if not isinstance(buttons, int) or not 0 <= buttons <= MAX_COUNT:
            found.add("buttons", f"0 to {MAX_COUNT}", repr(buttons), "buttons()")


def _check_kinematics(device: Any, axes: int, time_ns: int, found: Findings) -> None:
    with found.noting("kinematics", "finite vectors", "position(), torque()"):
        angles = device.read(time_ns)
        tip = device.kinematics.position(angles)
        found.check_vector(tip, len(tip), "m", "position()", finite="kinematics")
        torque = device.kinematics.torque(angles, (1.0,) * len(tip))
        found.check_vector(torque, axes, "N m", "torque()", finite="kinematics")
