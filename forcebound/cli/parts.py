"""Commands about devices, and about parts of a user's own: list, play, measure, check."""

import time
from functools import partial
from pathlib import Path
from typing import TextIO

import click

from forcebound.cli import complete
from forcebound.cli import options as opt
from forcebound.cli.common import (
    UNKNOWN,
    Group,
    command,
    print_document,
    print_json,
    show,
)
from forcebound.cli.lazy import when_used
from forcebound.errors import RunError
from forcebound.results.printing import print_rows

with when_used():
    from forcebound.hardware import inverse_service, ports
    from forcebound.hardware.emulators import faults as emulated
    from forcebound.hardware.emulators import program, service
    from forcebound.observe import control
    from forcebound.run import check as contract

#: Kinds of emulators, and the launch file of each: its hand holds an emulator started by hand.
EMULATED = {
    "dynamixel": "dynamixel_arm",
    "feetech": "feetech_arm",
    "haply_2diy": "haply_2diy",
    "haply_inverse3": "haply_inverse3",
    "odrive": "odrive_knob",
}

CHECKED = ("law", "device", "operator", "controller", "environment")

device = Group(
    "device", help="List devices on serial ports; let a graph continue with one that was lost."
)


@command("list", device)
def list_devices(as_json: bool = opt.as_json) -> None:
    r"""List the serial ports of this machine, with the likely device at each, and Inverse3.

    Those are at the maker's service on this machine, if it runs.

    \b
    forcebound device list --json
    """
    listed = [*ports.listed(), *inverse_service.listed()]
    if as_json:
        print_json(listed)
        return
    rows = []
    for port in listed:
        known = (port.path, port.seems, port.serial_number, port.description)
        opening = "yes" if port.is_permitted else "no: `forcebound doctor`"
        rows.append((*(one or UNKNOWN for one in known), opening))
    if rows:
        print_rows(("port", "seems to be", "serial number", "description", "may be opened"), rows)
    else:
        show("no serial port has a device; plug it in, or try `forcebound emulate haply_2diy`")


@command("resume", device, short_help="Let a graph go on with a device that was lost.")
def resume(
    hand: str | None = opt.argument(complete.hands, required=False),
    run: Path = opt.graph,
) -> None:
    r"""Let a running graph open its lost device again (on_loss: wait), of HAND if it has several.

    First plug it in, switch it on, and hold it in its home pose if it has one.

    \b
    forcebound device resume --run haply_2diy
    forcebound device resume left
    """
    control.resume_device(run, hand)
    show("the device is back; its force engages")


def emulate(
    kind: str = opt.argument(type=click.Choice(list(EMULATED))),
    arguments: tuple[str, ...] = opt.settings,
    link: Path | None = opt.file(
        "Path of the port. Default: a name in your runtime folder, which is printed."
    ),
    faults: tuple[str, ...] = opt.repeated(
        "short, noise, nan: spoil one reply, or those of a time; lost; reset; stall; unplug; "
        "reversed; docs/devices.md has those of haply_inverse3 and of servos, which may name one. "
        "TIME counts from the first reply; default: at=1s. Repeatable.",
        "--fault",
        metavar="KIND[:at=TIME][,for=TIME][,servo=ID]",
    ),
    no_hand: bool = opt.flag("Without a hand, as `forcebound identify` needs it."),
    until_unused: bool = opt.flag("End when the port is closed."),
    port: int = opt.port(
        "Of haply_inverse3, which has its events at 19 more; 0: two that are free.",
        type=click.IntRange(0, 65516),
        default=10001,
        show_default=True,
    ),
    idle: float = opt.duration(
        "Of haply_inverse3: age at which its force ends.", default="50 ms", show_default=True
    ),
    parts: TextIO | None = opt.option("Device and hand, as JSON.", type=click.File(), hidden=True),
) -> None:
    r"""Emulate a device on a pseudo-terminal, or as a service, for tests without hardware.

    Mechanism and hand are those of its launch file, whose arguments can be set.

    \b
    forcebound emulate haply_2diy approach_speed:=50mm/s
    forcebound emulate haply_2diy --fault short:at=3s --fault stall:at=5s,for=50ms
    """
    is_service = kind == "haply_inverse3"
    kinds = emulated.KINDS_OF.get(kind, emulated.KINDS)
    planned = [emulated.parse_fault(text, kinds) for text in faults]
    link = program.default_link(kind) if link is None else link.absolute()
    if parts is not None:
        model, operator = program.given_parts(parts.read())
    else:
        model, operator = program.launch_file_parts(EMULATED[kind], arguments)
    advice, operator = "", None if no_hand else operator
    if parts is None:
        advice = f"`forcebound launch {EMULATED[kind]} device:={link}`"
        advice = f"`forcebound identify {kind} device:={link}`" if no_hand else advice
        advice = f"in another terminal: {advice}"
    if is_service:
        listen = port if parts is None else 0
        service.run((model, operator), link, listen, idle, planned, until_unused, show, advice)
    else:
        program.run(kind, (model, operator), link, planned, until_unused, show, advice)


class Progress:
    """Progress of a check, on standard error, every two seconds."""

    EVERY = 2.0  # s

    def __init__(self) -> None:
        self._shown_at, self._every = time.monotonic(), self.EVERY  # it may travel to a child

    def show(self, doing: str, done: int, total: int) -> None:
        """Print the progress if it is due: answers so far and in all, or the step that begins."""
        if time.monotonic() - self._shown_at < self._every:
            return
        self._shown_at = time.monotonic()
        show(f"{done} of {total} answers" if total else doing, err=True)


def check(
    part: str = opt.argument(type=click.Choice(CHECKED)),
    kind: str = opt.argument(complete.parts, metavar="FILE[:NAME]"),
    arguments: tuple[str, ...] = opt.settings,
    axes: tuple[int, ...] = opt.repeated(
        "Number of axes of an environment; repeatable. Default: 1 to 8.",
        type=click.IntRange(1, 6),
    ),
    rest: tuple[str, ...] = opt.repeated(
        "Expected force of an environment at rest on the first axis, e.g. 0mm=0N; repeatable.",
        metavar="POSITION=FORCE",
    ),
    as_json: bool = opt.as_json,
) -> None:
    r"""Check a part, of a Python file or an installed kind, against its contract.

    An environment gets some thousand queries, at random and at the limits, fewer if it is slow; the
    time per answer is reported, not judged. A device is opened, and hardware gets zero force. Of a
    law `forcebound audit` tests whether it is passive.

    Exit status 1: a promise is broken; 2: no such part, or its code does not return.

    \b
    forcebound check environment my_environment.py --axes 1 --rest 0mm=0N
    forcebound check law my_law.py
    forcebound check device my_arm.yaml
    """
    if part != "environment" and (axes or rest):
        raise click.UsageError("--axes and --rest are for environments")
    checked = contract.check_part(part, kind, arguments, axes, rest, progress=Progress().show)
    print_document(checked, as_json, partial(contract.lines, part))
    if not checked.passed:
        raise RunError(f"{kind} breaks its contract")
