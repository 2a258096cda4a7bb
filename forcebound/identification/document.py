"""The file of an identified device: ``device.yaml``.

It is a launch file with the section ``device:``, which others include, and the section
``identified:``, which says where its numbers come from and which no run reads.
"""

import dataclasses
import json
import math
from collections.abc import Mapping
from io import StringIO
from pathlib import Path
from typing import Any

from forcebound.config.document import DEVICE_FILE, MAX_BYTES
from forcebound.config.fields import fields_of
from forcebound.config.problems import Problems
from forcebound.config.resolved import member_document
from forcebound.config.tree import parse
from forcebound.errors import ConfigError
from forcebound.files import read_text
from forcebound.identification.estimators import Bounded
from forcebound.identification.procedure import Found
from forcebound.messages.packets import Vector

DIGITS = 4  # of a bound

#: How each number was measured.
METHODS = {
    "damping": "growth of the loss with the speed, passes there and back; lower bound",
    "friction": "loss of slow passes in the weakest part of the range; lower bound",
    "presliding": "way that comes back after pushes below the friction; upper bound",
    "resolution": "smallest change of a reading in motion, and noise at rest; upper bound",
    "weight_error": "force that depends on the place, largest of all parts; upper bound",
    "write_delay": "from reading to the effect of the write, 999 of 1000; upper bound",
    "lag": "by which the ripple of the speed follows a force that jumps; upper bound",
    "gain_error": "force for a hanging weight, how far motors are from their mean; upper bound",
    "largest_speed": "moved by hand, the fastest and a quarter more; a rule, no bound",
}
PLANNED = ("reach", "force", "rate")  # of the plan, for a check
COMPARED = ("damping", "friction", "presliding", "resolution")  # in a check
LOWER = ("damping", "friction")  # a lower bound is the careful one


def bounds_of(model: Any, found: Found) -> dict[str, float | Vector]:
    """Return the numbers that a device may state after an identification.

    With a weight they count in forces of the mean gain, of which each motor gives its share.
    """
    bounds: dict[str, float | Vector] = {}
    shares = _shares(found)
    for name, values in _axis_numbers(model, found).items():
        pairs = zip(values, shares, strict=True)
        if name in LOWER:
            each = [down(one.lower * share.lower) for one, share in pairs]
        elif name == "weight_error":
            each = [up(one.upper * share.upper) for one, share in pairs]
        else:
            each = [up(one.upper) for one in values]
        bounds[name] = each[0] if len(each) == 1 else tuple(each)
    bounds["write_delay"] = up(found.write_delay.upper)
    lag = lag_of(found)
    if lag is not None and (lag.lower > 0.0 or model.watchdog != "guarding"):
        bounds["lag"] = up(max(lag.upper, 0.0))
    if found.gain:
        bounds["gain_error"] = up(max(max(s.upper - 1.0, 1.0 - s.lower) for s in shares))
    if found.largest_speed is not None:
        bounds["largest_speed"] = up(found.largest_speed.upper)
    return bounds


def estimates_of(model: Any, found: Found) -> dict[str, float | Vector]:
    """Return the same numbers as they were found, without their uncertainty."""
    estimates: dict[str, float | Vector] = {}
    shares = _shares(found)
    for name, values in _axis_numbers(model, found).items():
        has_force = name in (*LOWER, "weight_error")
        pairs = zip(values, shares, strict=True)
        each = [abs(one.estimate) * (share.estimate if has_force else 1.0) for one, share in pairs]
        estimates[name] = each[0] if len(each) == 1 else tuple(each)
    estimates["write_delay"] = found.write_delay.estimate
    lag = lag_of(found)
    if lag is not None:
        estimates["lag"] = max(lag.estimate, 0.0)
    if found.gain:
        estimates["gain_error"] = max(abs(share.estimate - 1.0) for share in shares)
    if found.largest_speed is not None:
        estimates["largest_speed"] = found.largest_speed.estimate
    return estimates


def lag_of(found: Found) -> Bounded | None:
    """Return the lag of the slowest amplifier, in s; None if that of an axis is not known."""
    lags = [axis.lag for axis in found.axes if axis.lag is not None]
    if len(lags) < len(found.axes):
        return None
    return max(lags, key=lambda one: one.upper)


def _shares(found: Found) -> list[Bounded]:
    """Gain of each motor over their mean, which is the middle of what they can be."""
    if not found.gain:
        return [Bounded(1.0, 1.0, 1.0)] * len(found.axes)
    mean = mean_gain(found)
    return [Bounded(g.estimate / mean, g.lower / mean, g.upper / mean) for g in found.gain]


def mean_gain(found: Found) -> float:
    """Return the middle between the least and the largest gain that the motors can have."""
    return 0.5 * (min(g.lower for g in found.gain) + max(g.upper for g in found.gain))


def identified_model(model: Any, found: Found) -> Any:
    """Return the model with the numbers that were found.

    What a late force costs under a guarding watchdog is known only without lag and write delay; a
    device that has either states a reporting one.
    """
    bounds: dict[str, Any] = bounds_of(model, found)
    sources = {**model.sources, **dict.fromkeys(bounds, "measured")}
    if model.watchdog == "guarding" and (bounds.get("lag") or bounds["write_delay"]):
        bounds["watchdog"] = "reporting"
    return dataclasses.replace(model, **bounds, sources=sources)


def _axis_numbers(model: Any, found: Found) -> dict[str, list[Bounded]]:
    names = {"damping", "friction", "presliding", "resolution"}
    numbers = {name: [getattr(axis, name) for axis in found.axes] for name in sorted(names)}
    if "weight_error" in {each.name for each in dataclasses.fields(model)}:  # no joint has one
        numbers["weight_error"] = [axis.load for axis in found.axes]
    return numbers


def down(value: float) -> float:
    """Return a value rounded down to so many digits as are written."""
    if value == 0.0:
        return 0.0
    scale = 10.0 ** (DIGITS - 1 - math.floor(math.log10(abs(value))))
    return math.floor(value * scale * (1.0 + math.copysign(1e-6, value))) / scale


def up(value: float) -> float:
    """Return a value rounded up alike."""
    return -down(-value) if value else 0.0


def document_of(
    model: Any, found: Found, date: str, serial: str, plan: Mapping[str, Any], included: str | None
) -> dict[str, Any]:
    """Return the content of the file.

    Args:
        model: As it was given, without the numbers that were found.
        found: In the identification.
        date: Of today.
        serial: Serial number of the device; empty if it has none.
        plan: How it was identified.
        included: Launch file that it is for; None: none.
    """
    identified = identified_model(model, found)
    told = member_document("device", identified)
    kind: type = type(model)
    usual = {name: field.default for name, field in fields_of(kind).items()}
    given = {name for name in usual if getattr(identified, name) != usual[name]}
    device = {name: value for name, value in told.items() if name == "kind" or name in given}
    bounds, estimates = bounds_of(model, found), estimates_of(model, found)
    for name in (*bounds, "sources"):
        device[name] = told[name]
    if serial and "serial_number" in usual:
        device["serial_number"] = serial
    numbers = {
        name: {"found": _plain(estimates[name]), "stated": told[name], "method": METHODS[name]}
        for name in bounds
    }
    load = [{"mean": _short(a.load.estimate), "largest": _short(a.load.upper)} for a in found.axes]
    return {
        "forcebound": 1,
        **({"include": included} if included else {}),
        "device": device,
        "identified": {
            "date": date,
            "serial_number": serial,
            "plan": dict(plan),
            "range": [[_short(a), _short(b)] for a, b in found.measured_range],
            "numbers": numbers,
            **_further(found),
            "load": load,
            "inertia": [_short(axis.inertia) for axis in found.axes],
            "interval": {
                "median": _short(found.interval.estimate),
                "longest": _short(found.interval.upper),
            },
        },
    }


def _further(found: Found) -> dict[str, Any]:
    """Lag and gain with both bounds, also where the device does not state them so."""
    lag = lag_of(found)
    each = {"lag": [] if lag is None else [lag], "gain": found.gain}
    return {
        name: {
            "found": [_short(one.estimate) for one in values],
            "lower": [_short(one.lower) for one in values],
            "upper": [_short(one.upper) for one in values],
        }
        for name, values in each.items()
        if values
    }


def _plain(value: float | Vector) -> Any:
    return [_short(one) for one in value] if isinstance(value, tuple) else _short(value)


def _short(value: float) -> float:
    return float(f"{value:.{DIGITS}g}")


def write(path: Path, document: Mapping[str, Any], command: str) -> None:
    """Write the file.

    Raises:
        ConfigError: If it cannot be written.
    """
    from ruamel.yaml import YAML

    yaml = YAML()  # the kind that keeps the order
    yaml.default_flow_style = None
    yaml.width = 200  # a line for each number
    text = StringIO()
    yaml.dump(json.loads(json.dumps(document)), text)  # no object twice: that gives anchors
    use = f"`device: {{include: {path.name}}}` in a launch file"
    head = f"# Written by `{command}`. Use: {use}.\n"
    try:
        path.write_text(head + text.getvalue(), encoding="utf-8")
    except OSError as error:
        raise ConfigError(f"cannot write {DEVICE_FILE} {path}: {error.strerror}") from error


def read(path: Path) -> dict[str, Any]:
    """Return the content of such a file.

    Raises:
        ConfigError: If it cannot be read, or is none.
    """
    problems = Problems()
    root = parse(read_text(path, DEVICE_FILE, MAX_BYTES), str(path), problems)
    problems.raise_if_any()
    document: dict[str, Any] = {} if root is None else root.plain
    identified = document.get("identified")
    if not isinstance(identified, dict) or not isinstance(identified.get("numbers"), dict):
        raise ConfigError(
            f"{path} has no section identified: write it with `forcebound identify DEVICE -o FILE`"
        )
    return document


def check_whole(path: Path, identified: Mapping[str, Any], axes: int) -> None:
    """Check that the section ``identified`` has what a check of the device needs.

    Raises:
        ConfigError: If it was damaged, or is of a device with another number of axes.
    """
    plan = identified.get("plan")
    told = plan if isinstance(plan, dict) else {}
    wrong = [f"plan: {name}" for name in PLANNED if not _is_positive(told.get(name))]
    for name in COMPARED:
        one = identified["numbers"].get(name)
        for key in ("found", "stated"):
            values = one.get(key) if isinstance(one, dict) else None
            each = values if isinstance(values, list) else [values]
            if len(each) != axes or not all(map(_is_number, each)):
                wrong.append(f"numbers: {name}: {key}")
    if not isinstance(identified.get("serial_number"), str):
        wrong.append("serial_number")
    if wrong:
        raise ConfigError(
            f"{path}: no numbers for a device of {axes} axes in identified: {', '.join(wrong)}; the"
            " file is damaged, or of another device: identify it again with `forcebound identify`"
        )


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and math.isfinite(value)


def _is_positive(value: Any) -> bool:
    return _is_number(value) and value > 0.0
