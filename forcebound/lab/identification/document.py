"""The file of an identified device: ``device.yaml``.

It is a launch file with the section ``device:``, which others include, and the section
``identified:``, which says where its numbers come from and which no run reads.
"""

import dataclasses
import json
import math
from collections.abc import Sequence
from io import StringIO
from pathlib import Path
from typing import Annotated, Any

import msgspec
import numpy as np

from forcebound.errors import ConfigError
from forcebound.files import read_text
from forcebound.graph.document import DEVICE_FILE, MAX_BYTES
from forcebound.graph.fields import fields_of
from forcebound.graph.problems import Problems
from forcebound.graph.resolved import part_document
from forcebound.graph.servo import ServoSettings, dissipation_of
from forcebound.graph.tree import parse
from forcebound.haptics.devices import DeviceModel
from forcebound.haptics.laws.dissipation import per_axis
from forcebound.lab.identification.estimators import Bounded
from forcebound.lab.identification.procedure import Found, Plan
from forcebound.messages.topology import Document

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
}
SCALED = "by the force for a hanging weight, each motor for itself; the middle of its bounds"
COUPLED = ("damping", "friction", "resolution")  # along an axis no bound of what is between two
LOWER = ("damping", "friction")  # a lower bound is the careful one


_Positive = Annotated[float, msgspec.Meta(gt=0.0)]


class RecordedPlan(msgspec.Struct):
    """How a device was identified; see :class:`forcebound.lab.identification.procedure.Plan`."""

    reach: _Positive
    force: _Positive
    rate: _Positive


class Number(msgspec.Struct):
    """A number of a device, for each axis: as it was found, and the bound that it may state."""

    found: float | Sequence[float]
    stated: float | Sequence[float]


class RecordedNumbers(msgspec.Struct):
    """The numbers that a check compares."""

    damping: Number
    friction: Number
    presliding: Number
    resolution: Number


class Identified(msgspec.Struct):
    """The section ``identified`` of a device file, as a check needs it."""

    plan: RecordedPlan
    serial_number: str
    numbers: RecordedNumbers


COMPARED = RecordedNumbers.__struct_fields__  # in a check


def numbers_of(model: DeviceModel, found: Found) -> dict[str, Number]:
    """Return the numbers of a device after an identification.

    With a weight they count in forces of the mean gain, of which each motor gives its share; or,
    where a number scales the torque of each joint, in N m: that number is corrected by the gain.
    """
    scale = model.torque_scale
    scales = per_axis(scale, getattr(model, scale), model.axes) if scale else ()
    shares = _shares(found, bool(scales))
    numbers, known = {}, {field.name for field in dataclasses.fields(model)}
    for name in (*COMPARED, "weight_error"):
        if name not in known:  # no joint has a weight error
            continue
        each = [axis.load if name == "weight_error" else getattr(axis, name) for axis in found.axes]
        if name in (*LOWER, "weight_error"):
            each = [one.times(share) for one, share in zip(each, shares, strict=True)]
        numbers[name] = _number(each, name in LOWER)
    numbers["write_delay"] = _number([found.write_delay])
    lag = lag_of(found)
    if lag is not None and (lag.lower > 0.0 or model.watchdog != "guarding"):
        numbers["lag"] = Number(max(lag.estimate, 0.0), up(max(lag.upper, 0.0)))
    if scales and any(found.gain):
        middles = [0.5 * (share.lower + share.upper) for share in shares]
        stated = tuple([_short(k * middle) for k, middle in zip(scales, middles, strict=True)])
        numbers[scale] = Number(stated, stated)
        corrected = zip(shares, scales, stated, strict=True)
        shares = [one.times(_exact(before / after)) for one, before, after in corrected]
    if any(found.gain) and (scales or None not in found.gain):
        error = max(abs(share.estimate - 1.0) for share in shares)
        most = max(max(share.upper - 1.0, 1.0 - share.lower) for share in shares)
        not_weighed = model.gain_error if None in found.gain else 0.0
        numbers["gain_error"] = Number(error, up(max(most, not_weighed)))
    for name in _unproved(model) & numbers.keys():
        stated = getattr(model, name)
        is_of_axes = name == "presliding" and model.axes > 1
        numbers[name].stated = per_axis(name, stated, model.axes) if is_of_axes else stated
    for name in COUPLED if model.has_coupled_axes else ():
        stated = per_axis(name, getattr(model, name), model.axes)
        careful = min if name in LOWER else max
        both = zip(stated, np.atleast_1d(numbers[name].stated), strict=True)
        numbers[name].stated = tuple([float(careful(pair)) for pair in both])
    return numbers


def _unproved(model: DeviceModel) -> set[str]:
    """Return the numbers that a model may not state, as its motors attenuate: found, not stated."""
    if model.attenuates == "never":
        return set()
    return {"lag", "gain_error", *(["presliding"] if model.attenuates == "freely" else [])}


def _number(values: Sequence[Bounded], is_lower: bool = False) -> Number:
    found = tuple(abs(one.estimate) for one in values)
    stated = tuple(down(one.lower) if is_lower else up(one.upper) for one in values)
    return Number(found, stated) if len(values) > 1 else Number(found[0], stated[0])


def lag_of(found: Found) -> Bounded | None:
    """Return the lag of the slowest amplifier, in s; None if that of an axis is not known."""
    lags = [axis.lag for axis in found.axes if axis.lag is not None]
    if len(lags) < len(found.axes):
        return None
    return max(lags, key=lambda one: one.upper)


def _shares(found: Found, is_scaled: bool) -> list[Bounded]:
    """Gain of each motor over the mean: the middle of the least and the largest that can be.

    With a scale of its own for each joint: the gain itself, 1 where it was not measured.
    """
    known = [gain for gain in found.gain if gain]
    if is_scaled or len(known) < len(found.axes):
        gains = found.gain if is_scaled and known else [None] * len(found.axes)
        return [gain or _exact(1.0) for gain in gains]
    mean = 0.5 * (min(g.lower for g in known) + max(g.upper for g in known))
    return [gain.times(_exact(1.0 / mean)) for gain in known]


def _exact(value: float) -> Bounded:
    return Bounded(value, value, value)


def identified_model(model: Any, found: Found) -> Any:
    """Return the model with the numbers that were found.

    What a late force costs under a guarding watchdog is known only without lag and write delay; a
    device that has either states a reporting one.
    """
    bounds: dict[str, object] = {name: one.stated for name, one in numbers_of(model, found).items()}
    measured = bounds.keys() - _unproved(model)
    measured -= {model.torque_scale} if None in found.gain else set()
    measured -= set(COUPLED) if model.has_coupled_axes else set()
    sources = {**model.sources, **dict.fromkeys(measured, "measured")}
    if model.watchdog == "guarding" and (bounds.get("lag") or bounds["write_delay"]):
        bounds["watchdog"] = "reporting"
    return dataclasses.replace(model, **bounds, sources=sources)


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
    model: Any,
    found: Found,
    date: str,
    serial: str,
    plan: Plan,
    included: str | None,
) -> Document:
    """Return the content of the file.

    Args:
        model: As it was given, without the numbers that were found.
        found: In the identification.
        date: Of today.
        serial: Number of the device; empty if it has none.
        plan: How it was identified.
        included: Launch file that it is for; None: none.
    """
    identified, numbers = identified_model(model, found), numbers_of(model, found)
    values = part_document("device", identified)
    kind: type = type(model)
    defaults = {name: field.default for name, field in fields_of(kind).items()}
    kept = {name for name in defaults if getattr(identified, name) != defaults[name]}
    kept |= {"kind", "sources", *numbers}
    if not _takes_a_speed(identified):  # a launch file that states one says null, too
        values["hand_speed"], kept = None, kept | {"hand_speed"}
    device = {name: value for name, value in values.items() if name in kept}
    if serial and "serial_number" in defaults:
        device["serial_number"] = serial
    methods = METHODS | {model.torque_scale: SCALED}
    numbers_found = {
        name: {"found": _short(one.found), "stated": values[name], "method": methods[name]}
        for name, one in numbers.items()
    }
    return {
        "forcebound": 1,
        **({"include": included} if included else {}),
        "device": device,
        "identified": {
            "date": date,
            "serial_number": serial,
            "plan": {"reach": plan.reach, "force": plan.force, "rate": plan.rate},
            "range": _short(found.measured_range),
            "numbers": numbers_found,
            **_further(found),
        },
    }


def _takes_a_speed(model: Any) -> bool:
    """Whether there is a proof with a speed of the hand and the other numbers of a model."""
    try:
        dissipation_of(dataclasses.replace(model, hand_speed=1.0), ServoSettings())
    except ConfigError as error:
        return error.field != "hand_speed"
    return True


def _further(found: Found) -> dict[str, object]:
    """Return the estimates beside the numbers of a device."""
    lag, ends = lag_of(found), {"found": "estimate", "lower": "lower", "upper": "upper"}
    both = {"lag": [] if lag is None else [lag], "gain": found.gain}
    bounds = {
        name: {key: _short([getattr(one, end) for one in each]) for key, end in ends.items()}
        for name, each in both.items()
        if each and None not in each
    }
    loads = [
        {"mean": _short(axis.load.estimate), "largest": _short(axis.load.upper)}
        for axis in found.axes
    ]
    interval = found.interval
    return {
        **bounds,
        "load": loads,
        "inertia": _short([axis.inertia for axis in found.axes]),
        "interval": {"median": _short(interval.estimate), "longest": _short(interval.upper)},
    }


def _short(value: Any) -> Any:
    """Round a number, or those in sequences."""
    if isinstance(value, Sequence):
        return [_short(one) for one in value]
    return float(f"{value:.{DIGITS}g}")


def use_of(path: Path, no_speed: bool) -> str:
    """Return the section of a launch file that uses a device file; what it says itself wins."""
    return f"device: {{include: {path.name}{', hand_speed: null' * no_speed}}}"


def write(path: Path, document: Document, command: str) -> None:
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
    no_speed = document["device"].get("hand_speed", "") is None
    head = f"# Written by `{command}`. Use: `{use_of(path, no_speed)}` in a launch file.\n"
    head += "# SI units: at a joint N m and rad, else N and m. One number for each joint or axis.\n"
    try:
        path.write_text(head + text.getvalue(), encoding="utf-8")
    except OSError as error:
        raise ConfigError(f"cannot write {DEVICE_FILE} {path}: {error.strerror}") from error


def read(path: Path) -> Identified:
    """Return the identification in a device file.

    Raises:
        ConfigError: If it cannot be read, is none, or is damaged.
    """
    problems = Problems()
    root = parse(read_text(path, DEVICE_FILE, MAX_BYTES), str(path), problems)
    problems.raise_if_any()
    content: Document = {} if root is None else root.plain
    if "identified" not in content:
        raise ConfigError(
            f"{path} has no section identified: write it with `forcebound identify DEVICE -o FILE`"
        )
    try:
        return msgspec.convert(content["identified"], Identified)
    except msgspec.ValidationError as error:
        raise ConfigError(
            f"{path}: identified: {error}; identify the device again with `forcebound identify`"
        ) from error
