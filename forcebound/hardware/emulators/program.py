"""The program of an emulator: its parts made, its port shown, its time begun."""

import json
import math
import os
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

from forcebound import realtime
from forcebound.errors import ConfigError
from forcebound.folders import runtime_folder
from forcebound.graph.parts import part_of
from forcebound.haptics.devices.joint_device import Joints
from forcebound.haptics.devices.true_values import TrueServos
from forcebound.haptics.hands import Operator
from forcebound.haptics.laws.dissipation import per_axis
from forcebound.hardware.dynamixel import Dynamixel
from forcebound.hardware.emulators.dynamixel_bus import DynamixelBus, DynamixelServo
from forcebound.hardware.emulators.emulation import Board, Emulation
from forcebound.hardware.emulators.faults import Fault, Faults
from forcebound.hardware.emulators.feetech_bus import FeetechBus, FeetechServo
from forcebound.hardware.emulators.haply_board import HaplyBoard
from forcebound.hardware.emulators.mechanism import Mechanism
from forcebound.hardware.emulators.odrive_board import ODriveBoard
from forcebound.hardware.emulators.pty import PseudoPort, serve
from forcebound.hardware.emulators.servo_bus import ServoBoard, Wiring
from forcebound.hardware.feetech import Feetech
from forcebound.hardware.hapi import WIRINGS
from forcebound.hardware.haply_2diy import Haply2DIY
from forcebound.hardware.odrive import ODrive
from forcebound.hardware.servo_bus import ServoBus
from forcebound.messages.topology import Document
from forcebound.stop import Stop

FIVE_VOLTS = (1190, 1200, 1240)  # model numbers of Dynamixels whose supply it is; else 12 V
PRIORITY = 20  # of SCHED_FIFO; below that of the nodes


def haply_2diy(model: Haply2DIY, operator: Operator | None) -> tuple[Board, Mechanism]:
    """Return a Haply board on a simulated five-bar, whose encoders are those of its version."""
    wiring = WIRINGS[model.version]
    arm = replace(model, resolution=math.tau / wiring.counts)
    home = arm.geometry().position(tuple([math.radians(angle) for angle in wiring.home]))
    board = HaplyBoard(arm.true_numbers().resolution, wiring.directions)
    return board, Mechanism(arm, operator, home)


def odrive(model: ODrive, operator: Operator | None) -> tuple[Board, Mechanism]:
    """Return an ODrive on simulated knobs; the hand begins at 0 m, where the encoders begin.

    Their encoders are as fine as it takes to report positions in steps of the resolution.
    """
    joints = model.joints
    reported = per_axis("resolution", model.resolution, joints)
    knobs = replace(model, resolution=tuple([0.5 * step for step in reported]))
    return ODriveBoard(joints), Mechanism(knobs, operator, (0.0,) * joints)


def dynamixel(model: Dynamixel, operator: Operator | None) -> tuple[Board, Mechanism]:
    """Return Dynamixels at the supply of their data sheet, or the true one."""
    supply = 5.0 if all(one.number in FIVE_VOLTS for one in model.types) else 12.0
    mechanism, truth, wirings = _joints(model, operator)
    servos = [DynamixelServo(one, supply) for one in wirings]
    return DynamixelBus(servos, model.baud, truth, supply, mechanism.brake), mechanism


def feetech(model: Feetech, operator: Operator | None) -> tuple[Board, Mechanism]:
    """Return Feetech servos at the largest supply that is stated, or the true one."""
    supply = model.largest_supply
    mechanism, truth, wirings = _joints(model, operator)
    servos = [FeetechServo(one, supply) for one in wirings]
    return FeetechBus(servos, model.baud, truth, supply, mechanism.brake), mechanism


def _joints(
    model: ServoBus, operator: Operator | None
) -> tuple[Mechanism, TrueServos, list[Wiring]]:
    """Return the joints that servos turn, what is true of them, and how each is built in."""
    truth = model.truth or TrueServos()
    names = ("joints", "inertia", "damping", "friction", "presliding", "gain_error", "saturation")
    stated = {name: getattr(model, name) for name in names}
    joints = Joints(**stated, resolution=0.0, truth=truth)  # the registers have steps
    each = [per_axis(name, getattr(model, name), model.axes) for name in ("direction", "zero")]
    rows = zip(model.servos, *each, model.constants, model.types, strict=True)
    wirings = [
        Wiring(number, int(sense), round(zero), *rest) for number, sense, zero, *rest in rows
    ]
    return Mechanism(joints, operator, (0.0,) * model.axes), truth, wirings


#: By the kind of device that is emulated: the function that makes board and mechanism of its model
#: and a hand, or None.
EMULATORS: Mapping[str, Callable[[Any, Operator | None], tuple[Board, Mechanism]]] = {
    "dynamixel": dynamixel,
    "feetech": feetech,
    "haply_2diy": haply_2diy,
    "odrive": odrive,
}


def run(
    kind: str,
    parts: tuple[Any, Operator | None],
    link: Path,
    faults: Sequence[Fault],
    until_unused: bool,
    say: Callable[[str], None],
    advice: str = "",
) -> None:
    """Run an emulator until it is interrupted, unplugs itself or is no longer used.

    Kind and parts, the model of a device and a hand, are those of ``EMULATORS``. With
    ``until_unused`` it ends when its user has closed the port. ``say`` takes the lines for the
    terminal, the last of which may be ``advice``.
    """
    be_punctual()
    with Stop() as stop, PseudoPort(link) as port:
        board, mechanism = EMULATORS[kind](*parts)
        planned = Faults(faults)
        if isinstance(board, ServoBoard):
            board.plan(planned)
        emulation = Emulation(board, mechanism, planned, port.truth)
        realtime.freeze_garbage()
        emulation.start(time.monotonic_ns())
        port.show(port.name)
        say(f"an emulated {kind} at {link}; Ctrl-C ends it")  # a driver that starts it waits for it
        if advice:
            say(advice)
        serve(emulation, port, stop, until_unused)
    say(
        f"{emulation.replies} replies; lowest energy {emulation.lowest_energy:.3g} J;"
        f" torque held without a message for at most {1e3 * emulation.longest_hold:.3g} ms"
    )


def be_punctual() -> None:
    """Answer as soon as a board would: beside the core of the graph's nodes, before other work."""
    realtime.enter(realtime.Settings(core=realtime.choose_core("auto")), "emulator")
    with suppress(OSError):  # not permitted
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))


def default_link(kind: str) -> Path:
    """Return the path of the port of an emulator that is started by hand; else ConfigError."""
    folder = runtime_folder()
    if folder is None:
        raise ConfigError("there is no private folder for the port: give a path with --link")
    return folder / f"forcebound-{kind}"


def launch_file_parts(file: str, arguments: Sequence[str]) -> tuple[Any, Operator | None]:
    """Return device model and operator of a launch file whose device can be emulated."""
    from forcebound.graph.loader import load  # a driver that starts an emulator reads none

    config = load(file, arguments)
    return config.only.device, config.only.operator


def given_parts(text: str) -> tuple[Any, Operator | None]:
    """Return device model and operator that :func:`forcebound.hardware.emulated.start` gives."""
    document = json.loads(text)
    return _part("device", document["device"]), _part("operator", document["operator"])


def _part(section: str, values: Document | None) -> Any:
    return None if values is None else part_of(section, values)
