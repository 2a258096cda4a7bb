"""The work of ``forcebound identify``: a device is named, measured, written down and judged."""

import datetime
import logging
import os
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from forcebound import realtime
from forcebound.analysis.plots import check_picture
from forcebound.config.document import find
from forcebound.config.loader import load_tried
from forcebound.config.parts import device_of, member_of
from forcebound.config.resolved import kind_of
from forcebound.devices import DEVICES, Device, DeviceModel
from forcebound.devices.simulated import SimulatedDevice
from forcebound.devices.truth_file import SUFFIX
from forcebound.errors import ConfigError
from forcebound.files import check_writable
from forcebound.hardware import ports
from forcebound.hardware.line import EMULATED
from forcebound.identification import document as device_file
from forcebound.identification.clock import Clock, RealClock, VirtualClock
from forcebound.identification.picture import draw
from forcebound.identification.procedure import Found, Plan, identify
from forcebound.identification.verdict import BETTER, verdict
from forcebound.messages.packets import Vector
from forcebound.quantities import POSITIVE
from forcebound.units import parse_quantity

_logger = logging.getLogger(__name__)

REACHES = {"m": 0.03, "rad": 0.35}  # of the axes of a point, of joints
GRAVITY = 9.81  # m/s^2
FORCE_SHARE = 0.5  # of the saturation
HOLD = 1.25  # periods
PATIENCE = 20.0  # s, watchdog limit: a stall of the machine costs a repetition, not the run
CHANGED = 0.2  # a number that differs by a larger share has changed
#: What is found beside the numbers of a device, in the same section of the file.
FURTHER = {
    "lag": "of the slowest amplifier, in s; a guarding watchdog states none that may be 0",
    "gain": "of each motor, over what it is told",
}
WARNING = (
    "The motors will move the device by themselves, each axis by up to {reach:.3g} {place} to"
    " either side of the middle, with at most {force:.3g} {unit}. Put it in the middle, take"
    " everything out of its way, let go of it, and keep the emergency stop at hand."
)

THROWN = (
    "This machine was late, and the force that was on has thrown the device far away. There is no"
    " force now: bring it back to where it began, and let go of it."
)


@dataclass(frozen=True)
class Target:
    """A device to be identified.

    Attributes:
        model: What it states.
        rate: Of its servo, in Hz.
        launch_file: That it is of; None: a kind was named.
    """

    model: Any
    rate: float
    launch_file: str | None


@dataclass(frozen=True)
class Wishes:
    """What a user says of an identification, as text with units; None: what is usual.

    Attributes:
        reach: How far each axis may move.
        force: Largest force of an axis.
        weight: Mass that the user hangs on each axis; None: none.
        lever: Radius at which it pulls at a joint.
        by_hand: Time for which the user moves the device; None: not at all.
    """

    reach: str | None = None
    force: str | None = None
    weight: str | None = None
    lever: str | None = None
    by_hand: str | None = None


@dataclass(frozen=True)
class Session:
    """What came of an identification: what was found, and what is needed to judge it."""

    found: Found
    start: Vector
    kinematics: Any
    serial: str
    is_virtual: bool


def target_of(name: str, arguments: Sequence[str]) -> Target:
    """Return the device that a kind, or a launch file, names; a launch file goes first.

    Raises:
        ConfigError: If there is none, or anything is wrong with it.
    """
    if find(Path(name)) is not None or (name.endswith((".yaml", ".yml")) and name not in DEVICES):
        config = load_tried(name, arguments)
        return Target(config.device.model, config.device.servo.rate, name)
    return Target(member_of("device", name, arguments), 1000.0, None)


def plan_of(target: Target, is_joint: bool, wishes: Wishes) -> Plan:
    """Return how a device is identified: as the user wishes, or as its kind usually may.

    Raises:
        ConfigError: If a wish is no quantity of the right kind.
    """
    place, unit = ("rad", "N m") if is_joint else ("m", "N")
    reach, force = _wish("reach", wishes.reach, place), _wish("force", wishes.force, unit)
    mass, lever = _wish("weight", wishes.weight, "kg"), _wish("lever", wishes.lever, "m")
    if mass is not None and is_joint != (lever is not None):
        raise ConfigError(
            "a weight on a joint needs --lever, the radius at which its thread pulls"
            if is_joint
            else "--lever is for joints: the axes of this device move along straight lines"
        )
    return Plan(
        reach=REACHES[place] if reach is None else reach,
        force=FORCE_SHARE * target.model.saturation if force is None else force,
        rate=target.rate,
        weight=GRAVITY * (mass or 0.0) * (1.0 if lever is None else lever),
        by_hand=_wish("by-hand", wishes.by_hand, "s") or 0.0,
    )


def _wish(option: str, text: str | None, unit: str) -> float | None:
    if text is None:
        return None
    try:
        return POSITIVE.check(parse_quantity(text, unit), unit)
    except ConfigError as error:
        raise ConfigError(f"--{option}: {error}") from None


def measure(
    target: Target,
    plan: Callable[[bool], Plan],
    say: Callable[[str], None],
    ready: Callable[[str], None],
    accept: Callable[[str], None] = lambda serial: None,
) -> Session:
    """Open a device, identify it, and close it.

    Args:
        target: The device.
        plan: Returns how, for a device with joints or without.
        say: Is told what comes next.
        ready: Is told what the user has to do, and returns when it is done.
        accept: Is told the serial number before anything moves; raises if it is another device.

    Raises:
        DeviceError: As :func:`forcebound.identification.procedure.identify`.
    """
    model: DeviceModel = target.model
    device = _patient(model).open(None, HOLD / target.rate)
    try:
        kinematics = device.kinematics
        serial = device.serial_number or _serial_number(model)
        accept(serial)
        chosen = plan(kinematics is not None)
        is_virtual = isinstance(device, SimulatedDevice)
        clock: Clock = VirtualClock() if is_virtual else RealClock()
        if not is_virtual:
            place, unit = units(kinematics)
            ready(WARNING.format(reach=chosen.reach, place=place, force=chosen.force, unit=unit))
        with realtime.without_garbage_collection(), nullcontext() if is_virtual else _punctual():
            middle, bring_back = _middle_of(model), lambda: _bring_back(device, ready)
            found = identify(device, model, clock, chosen, say, middle, bring_back)
    finally:
        device.close()
    start = tuple(0.5 * (low + high) for low, high in found.measured_range)
    return Session(found, start, kinematics, serial, is_virtual)


def _bring_back(device: Device, ready: Callable[[str], None]) -> None:
    """Let the emulated hand, or the user, bring a device back to where it began."""
    if not device.hand_over():
        ready(THROWN)


def _patient(model: DeviceModel) -> DeviceModel:
    """Return the model, patient with an emulator, whose stalls are those of a busy machine.

    No law runs, so no force is planned for that time, and nobody holds the device.
    """
    is_emulated = model.port == EMULATED or Path(f"{model.port}{SUFFIX}").exists()
    if not is_emulated or model.watchdog_limit != "auto":
        return model
    return replace(model, watchdog_limit=PATIENCE)


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
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
        os.sched_setaffinity(0, cores)


def _middle_of(model: DeviceModel) -> Vector | None:
    """Return the readings for which the tip is at 0 m; None if the model cannot say."""
    return model.angles((0.0,) * model.axes)


def units(kinematics: Any) -> tuple[str, str]:
    """Return the units of readings and of forces."""
    return ("m", "N") if kinematics is None else ("rad", "N m")


def run(
    name: str,
    arguments: Sequence[str],
    out: Path,
    wishes: Wishes,
    say: Callable[[str], None],
    ready: Callable[[str], None],
) -> dict[str, Any]:
    """Identify a device; write ``out`` and a picture beside it; return what was found.

    Args:
        name: Kind of device, or launch file.
        arguments: Of either, each ``name:=value``.
        out: File to write.
        wishes: How it goes.
        say: Is told what comes next.
        ready: Is told what the user has to do, and returns when it is done.

    Raises:
        ConfigError: If there is no such device, or a file cannot be written.
        DeviceError: If the device fails.
    """
    target = target_of(name, arguments)
    picture = out.with_suffix(".png")
    check_picture(picture)
    for path, what in ((out, "the file of the device"), (picture, "the picture")):
        check_writable(path, what)
    session = measure(target, lambda is_joint: plan_of(target, is_joint, wishes), say, ready)
    found = session.found
    plan = plan_of(target, session.kinematics is not None, wishes)
    identified = device_file.identified_model(target.model, found)
    estimates = device_file.estimates_of(target.model, found)
    judged = verdict(identified, estimates, target.rate, session.start, session.kinematics)
    date = datetime.datetime.now(datetime.UTC).date().isoformat()
    told = {"reach": plan.reach, "force": plan.force, "rate": plan.rate}
    content = device_file.document_of(
        target.model, found, date, session.serial, told, target.launch_file
    )
    device_file.write(out, content, " ".join(("forcebound", "identify", name, *arguments)))
    kind = kind_of("device", target.model)
    draw(found, units(session.kinematics), f"{kind}, identified on {date}", picture)
    return {**content, "verdict": asdict(judged), "file": str(out), "picture": str(picture)}


def check(path: Path, say: Callable[[str], None], ready: Callable[[str], None]) -> dict[str, Any]:
    """Repeat a short identification of the device of a file; say whether it has changed.

    Raises:
        ConfigError: If it is no such file, or of another device.
        DeviceError: If the device fails.
    """
    content = device_file.read(path)
    model, identified = device_of(path, device_file.METHODS), content["identified"]
    device_file.check_whole(path, identified, model.axes)
    plan, number = identified["plan"], identified["serial_number"]
    target = Target(model, plan["rate"], None)
    short = Plan(plan["reach"], plan["force"], plan["rate"], poses=(0.0,), pushes=8, strokes=0)

    def accept(serial: str) -> None:
        if serial != number:
            raise ConfigError(
                f"{path} is of the device with the serial number {number or '-'}, this one has"
                f" {serial or '-'}: identify this one"
            )

    session = measure(target, lambda is_joint: short, say, ready, accept)
    rows = [
        _compared(name, numbers, getattr(axis, name), number)
        for name, numbers in identified["numbers"].items()
        if name in device_file.COMPARED
        for number, axis in enumerate(session.found.axes)
    ]
    return {"file": str(path), "numbers": rows, "passed": all(row["holds"] for row in rows)}


def _compared(name: str, numbers: Mapping[str, Any], now: Any, axis: int) -> dict[str, Any]:
    was, stated = np.atleast_1d(numbers["found"])[axis], np.atleast_1d(numbers["stated"])[axis]
    is_lower = name in ("damping", "friction")
    # Broken only if even the other end of what is seen now lies beyond what is stated.
    holds = now.upper >= stated if is_lower else now.lower <= stated
    return {
        "number": name,
        "axis": axis + 1,
        "stated": float(stated),
        "then": float(was),
        "now": now.estimate,
        "holds": bool(holds),
        "changed": bool(was > 0.0 and abs(now.estimate / was - 1.0) > CHANGED),
    }


def lines(content: Mapping[str, Any]) -> list[str]:
    """Return the result of :func:`run` as lines of text."""
    text = []
    for name, one in content["identified"]["numbers"].items():
        text.append(f"{name:<13} stated {_shown(one['stated'])}, found {_shown(one['found'])}")
        text.append(f"{'':<13} {one['method']}")
    for name, what in FURTHER.items():
        one = content["identified"].get(name)
        if one is not None:
            least, most = _shown(one["lower"]), _shown(one["upper"])
            text.append(
                f"{name:<13} found {_shown(one['found'])}; at least {least}, at most {most}"
            )
            text.append(f"{'':<13} {what}")
    if "lag" not in content["identified"]:
        text.append("lag           not told: too many late ticks; it stays as the device states it")
    judged = content["verdict"]
    shown = judged["stiffness"] / 1e3
    text.append(f"a wall of the law certified, pressed by 2 mm: at most {shown:.3g} N/mm")
    for name, gain in judged["gains"].items():
        better = BETTER[name][1]
        measured = gain.get("measured")
        known = "" if measured is None else f"; measured exactly: {_percent(measured)}"
        text.append(f"  {name:<13} {better}: {_percent(gain['built'])}{known}")
    text.append(f"what limits it most: {judged['limit']}")
    text.append(f"written: {content['file']}, {content['picture']}")
    return text


def check_lines(content: Mapping[str, Any]) -> list[str]:
    """Return the result of :func:`check` as lines of text."""
    text = []
    for row in content["numbers"]:
        word = "holds" if row["holds"] else "BROKEN"
        changed = ", but has changed" if row["holds"] and row["changed"] else ""
        text.append(
            f"{word:<7} {row['number']} of axis {row['axis']}: stated {row['stated']:.4g}, then"
            f" {row['then']:.4g}, now {row['now']:.4g}{changed}"
        )
    return text


def _shown(value: Any) -> str:
    return ", ".join(f"{one:.4g}" for one in np.atleast_1d(value))


def _percent(ratio: float) -> str:
    return f"{100.0 * (ratio - 1.0):+.1f} %"


def is_terminal() -> bool:
    """Return whether somebody can answer."""
    return sys.stdin.isatty()
