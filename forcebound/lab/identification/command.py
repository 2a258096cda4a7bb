"""The work of ``forcebound identify``: a device is named, measured, written down and judged."""

import datetime
import logging
import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from msgspec import Struct

from forcebound import realtime
from forcebound.axes import shown_on
from forcebound.errors import ConfigError
from forcebound.files import check_writable
from forcebound.graph.document import find
from forcebound.graph.loader import load_tried
from forcebound.graph.parts import device_of, member_of
from forcebound.graph.resolved import kind_of
from forcebound.haptics.devices import DEVICES, DeviceModel
from forcebound.haptics.devices.contract import reading_units
from forcebound.haptics.devices.simulated import SimulatedDevice
from forcebound.hardware import ports
from forcebound.hardware.line import EMULATED
from forcebound.lab.identification import document as device_file
from forcebound.lab.identification.document import COMPARED, LOWER, METHODS, Number
from forcebound.lab.identification.estimators import Bounded
from forcebound.lab.identification.procedure import Found, Plan, identify
from forcebound.lab.identification.rig import Clock, VirtualClock
from forcebound.lab.identification.verdict import BETTER, verdict
from forcebound.messages.topology import Document
from forcebound.quantities import POSITIVE
from forcebound.units import MM, N_MM, in_unit, parse_quantity

_logger = logging.getLogger(__name__)

Report = Callable[[str], None]

REACHES = {"m": 0.03, "rad": 0.35}  # of the axes of a point, of joints
GRAVITY = 9.81  # m/s^2
FORCE_SHARE = 0.5  # of the saturation
HOLD = 1.25  # periods
CHANGED = 0.2  # a number that differs by a larger share has changed
#: What is found beside the numbers of a device, in the same section of the file.
FURTHER = {
    "lag": "of the slowest amplifier, in s; a guarding watchdog states none that may be 0",
    "gain": "of each motor, over its command",
}
WARNING = (
    "The motors will move the device by themselves, each axis by up to {reach:.3g} {place} to"
    " either side of the middle, with at most {force:.3g} {unit}. Put it in the middle, take"
    " everything out of its way, let go of it, and keep the emergency stop at hand."
)


class Target(NamedTuple):
    """A device to be identified."""

    model: DeviceModel
    rate: float  # Hz, of its servo
    launch_file: str | None = None  # from which it comes; None: a kind was named

    @property
    def units(self) -> tuple[str, str]:
        """Units of readings and of forces."""
        units = reading_units(self.model)
        if units[0] not in REACHES:
            raise ConfigError("identify takes a device of lengths, or one of angles, not of both")
        return units


def target_of(name: str, arguments: Sequence[str]) -> Target:
    """Return the device that a kind, or a launch file, names; a launch file goes first.

    Raises:
        ConfigError: If there is none, or anything is wrong with it.
    """
    if find(Path(name)) is not None or (name.endswith((".yaml", ".yml")) and name not in DEVICES):
        config = load_tried(name, arguments)
        return Target(config.only.device, config.only.servo.rate, name)
    return Target(member_of("device", name, arguments), 1000.0)


def plan_of(
    target: Target,
    *,
    reach: str | None = None,
    force: str | None = None,
    weight: str | None = None,
    lever: str | None = None,
) -> Plan:
    """Return how a device is identified: as the user wishes, or as its kind usually may.

    Args:
        target: The device.
        reach: How far each axis may move, as text with a unit, like the others.
        force: Largest force of an axis.
        weight: Mass that the user hangs on each axis; None: none.
        lever: Radius at which it pulls at a joint.

    Raises:
        ConfigError: If one is no quantity of the right kind.
    """
    place, unit = target.units
    mass, radius = _quantity("weight", weight, "kg"), _quantity("lever", lever, "m")
    if mass is not None and (place == "rad") != (radius is not None):
        raise ConfigError(
            "a weight on a joint needs --lever, the radius at which its thread pulls"
            if place == "rad"
            else "--lever is for joints: the axes of this device move along straight lines"
        )
    return Plan(
        reach=_quantity("reach", reach, place) or REACHES[place],
        force=_quantity("force", force, unit) or FORCE_SHARE * target.model.saturation,
        rate=target.rate,
        weight=GRAVITY * (mass or 0.0) * (radius or 1.0),
    )


def _quantity(option: str, text: str | None, unit: str) -> float | None:
    if text is None:
        return None
    try:
        return POSITIVE.check(parse_quantity(text, unit), unit)
    except ConfigError as error:
        raise ConfigError(f"--{option}: {error}") from None


def measure(
    target: Target, plan: Plan, report: Report, ready: Report, expected: str | None = None
) -> tuple[Found, str]:
    """Open a device, identify it, and close it; return what was found, and its serial number.

    Args:
        target: The device.
        plan: Of the identification.
        report: Is called with what comes next.
        ready: Is called with what the user has to do, and returns when it is done.
        expected: Serial number that it must have; None: any.

    Raises:
        ConfigError: If it has another serial number.
        DeviceError: As :func:`forcebound.lab.identification.procedure.identify`.
    """
    model = target.model
    device = model.open(None, HOLD / target.rate)
    try:
        serial = device.serial_number or _serial_number(model)
        if expected is not None and serial != expected:
            raise ConfigError(
                f"the file is of the device with the serial number {expected or '-'}, this one has"
                f" {serial or '-'}: identify this one"
            )
        is_virtual = isinstance(device, SimulatedDevice)
        if not is_virtual:
            place, unit = target.units
            ready(WARNING.format(reach=plan.reach, place=place, force=plan.force, unit=unit))
        with realtime.without_garbage_collection(), nullcontext() if is_virtual else _punctual():
            clock = VirtualClock() if is_virtual else Clock()
            middle = model.angles((0.0,) * model.axes)
            return identify(device, model, clock, plan, report, middle), serial
    finally:
        device.close()


def _serial_number(model: DeviceModel) -> str:
    """Return the serial number of the USB device at a model's port; empty if there is none."""
    if model.port in ("", EMULATED):
        return ""
    return ports.serial_number(ports.find(model.port, kind_of("device", model)))


@contextmanager
def _punctual() -> Iterator[None]:
    """Be as punctual within as this process may be."""
    cores = os.sched_getaffinity(0)
    for fact in realtime.enter(realtime.Settings(core=realtime.choose_core("auto")), "device"):
        _logger.info("%s", fact.sentence)
    try:
        yield
    finally:
        realtime.be_ordinary()
        os.sched_setaffinity(0, cores)


def run(
    name: str,
    arguments: Sequence[str],
    out: Path,
    report: Report,
    ready: Report,
    **wishes: str | None,
) -> Document:
    """Identify a device; write ``out``; return what was found.

    Args:
        name: Kind of device, or launch file.
        arguments: Of either, each ``name:=value``.
        out: File to write.
        report: Is called with what comes next.
        ready: Is called with what the user has to do, and returns when it is done.
        wishes: As :func:`plan_of` takes them.

    Raises:
        ConfigError: If there is no such device, or a file cannot be written.
        DeviceError: If the device fails.
    """
    target = target_of(name, arguments)
    check_writable(out, "the file of the device")
    plan = plan_of(target, **wishes)
    found, serial = measure(target, plan, report, ready)
    middle = tuple(0.5 * (low + high) for low, high in found.measured_range)
    identified = device_file.identified_model(target.model, found)
    judged = verdict(identified, target.rate, middle)
    date = datetime.datetime.now(datetime.UTC).date().isoformat()
    content = device_file.document_of(target.model, found, date, serial, plan, target.launch_file)
    device_file.write(out, content, " ".join(("forcebound", "identify", name, *arguments)))
    return {**content, "verdict": judged._asdict(), "file": str(out)}


class Compared(Struct, frozen=True):
    """A number of an axis: as stated, as it was found, and as it is now."""

    number: str
    axis: int  # from 1
    stated: float
    then: float
    now: float
    holds: bool
    changed: bool


class Checked(Struct, frozen=True):
    """Result of a check."""

    file: str
    numbers: list[Compared]
    passed: bool


def check(path: Path, report: Report, ready: Report) -> Checked:
    """Repeat a short identification of the device of a file; report whether it has changed.

    Raises:
        ConfigError: If it is no such file, or of another device.
        DeviceError: If the device fails.
    """
    written = device_file.read(path)
    plan, target = written.plan, Target(device_of(path, METHODS), written.plan.rate)
    for name in COMPARED:
        number = getattr(written.numbers, name)
        if {np.size(number.found), np.size(number.stated)} != {target.model.axes}:
            raise ConfigError(f"{path}: identified: {name} is not of {target.model.axes} axes")
    short = Plan(plan.reach, plan.force, plan.rate, poses=(0.0,), pushes=8, strokes=0)
    found, _ = measure(target, short, report, ready, written.serial_number)
    rows = [
        _compared(name, getattr(written.numbers, name), getattr(axis, name), number)
        for name in COMPARED
        for number, axis in enumerate(found.axes)
    ]
    return Checked(str(path), rows, all(row.holds for row in rows))


def _compared(name: str, number: Number, now: Bounded, axis: int) -> Compared:
    was, stated = (float(np.atleast_1d(one)[axis]) for one in (number.found, number.stated))
    # Broken only if even the other end of what is seen now lies beyond what is stated.
    holds = now.upper >= stated if name in LOWER else now.lower <= stated
    changed = was > 0.0 and abs(now.estimate / was - 1.0) > CHANGED
    return Compared(name, axis + 1, stated, was, now.estimate, bool(holds), bool(changed))


def lines(content: Document) -> list[str]:
    """Return the result of :func:`run` as lines of text."""
    text, identified = [], content["identified"]
    for name, one in identified["numbers"].items():
        text.append(f"{name:<13} stated {_shown(one['stated'])}, found {_shown(one['found'])}")
        text.append(f"{'':<13} {one['method']}")
    for name, what in FURTHER.items():
        if name in identified:
            found, least, most = (_shown(identified[name][k]) for k in ("found", "lower", "upper"))
            text.append(f"{name:<13} found {found}; at least {least}, at most {most}")
            text.append(f"{'':<13} {what}")
    if "lag" not in identified:
        text.append(
            "lag           not found: too many late ticks; it stays as the device states it"
        )
    judged = content["verdict"]
    kind, now = judged["kind"], judged["stiffness"]
    depth, unit = in_unit(judged["depth"], shown_on(kind, MM).unit, 3), shown_on(kind, N_MM).unit
    text.append(f"stiffest wall under certified, pressed by {depth}: {in_unit(now, unit, 3)}")
    for name, then in judged["better"].items():
        shown = f"{100.0 * (then / now - 1.0):+.1f} %" if now else in_unit(then, unit, 3)
        text.append(f"  {name:<13} {BETTER[name][1]}: {shown}")
    text.append(f"what limits it most: {judged['limit']}")
    text.append(f"written: {content['file']}")
    return text


def check_lines(content: Checked) -> list[str]:
    """Return the result of :func:`check` as lines of text."""
    text = []
    for row in content.numbers:
        word = "holds" if row.holds else "BROKEN"
        changed = ", but has changed" if row.holds and row.changed else ""
        text.append(
            f"{word:<7} {row.number} of axis {row.axis}: stated {row.stated:.4g}, then"
            f" {row.then:.4g}, now {row.now:.4g}{changed}"
        )
    return text


def _shown(value: Any) -> str:
    return ", ".join(f"{one:.4g}" for one in np.atleast_1d(value))
