"""The command that plays a device on a pseudo-terminal."""

from pathlib import Path
from typing import TextIO

import click

from forcebound.cli.common import ARGUMENTS, duration_option_for, reports_errors, show

#: Kinds of emulators, and the launch file of each: its hand holds an emulator started by hand.
KINDS = {"haply_2diy": "haply_2diy", "odrive": "odrive_knob"}
#: Watchdog limit of a launch with such an emulator: that of an emulator which the launch starts.
PATIENCE = "100 ms"


@click.command(short_help="Play a device on a pseudo-terminal.")
@click.argument("kind", type=click.Choice(list(KINDS)))
@click.argument("arguments", nargs=-1, metavar=ARGUMENTS)
@click.option(
    "--link",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Path of the port. Default: a name in your runtime folder, which is printed.",
)
@click.option(
    "--fault",
    "faults",
    multiple=True,
    metavar="KIND[:at=TIME][,for=TIME]",
    help="short, noise, nan: spoil one reply, or those of a time; lost; reset; stall; unplug; "
    "reversed. TIME counts from the first reply; default: at=1s. Repeatable.",
)
@duration_option_for("Time from a message to its reply, beyond the terminal's.", "--latency")
@click.option("--no-hand", is_flag=True, help="Nobody holds it, as `forcebound identify` needs it.")
@click.option("--until-unused", is_flag=True, help="End when the port is closed.")
@click.option("--values", type=click.File(), hidden=True, help="Mechanism and hand, as JSON.")
@reports_errors
def emulate(
    kind: str,
    arguments: tuple[str, ...],
    link: Path | None,
    faults: tuple[str, ...],
    latency: float | None,
    no_hand: bool,
    until_unused: bool,
    values: TextIO | None,
) -> None:
    r"""Play a device on a pseudo-terminal, for tests and trials without hardware.

    Mechanism and hand are those of its launch file, whose arguments can be set.

    \b
    forcebound emulate haply_2diy approach_speed:=50mm/s
    forcebound emulate haply_2diy --fault short:at=3s --fault stall:at=5s,for=50ms
    """
    from forcebound.emulators import program
    from forcebound.emulators.faults import parse_fault

    wanted = [parse_fault(text) for text in faults]
    link = program.default_link(kind) if link is None else link.absolute()
    if values is not None:
        mechanism, operator = program.given_values(values.read())
        advice = ""
    else:
        mechanism, operator = program.launch_file_values(KINDS[kind], arguments)
        operator = None if no_hand else operator
        command = f"`forcebound identify {kind} device:={link}`"
        if operator is not None:
            words = f'{KINDS[kind]} device:={link} watchdog_limit:="{PATIENCE}"'
            command = f"`forcebound launch {words}`"
        advice = f"in another terminal: {command}"
    program.run(kind, mechanism, operator, link, wanted, latency or 0.0, until_unused, show, advice)
