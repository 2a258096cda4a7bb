"""The command that plays a device on a pseudo-terminal."""

from pathlib import Path
from typing import TextIO

import click

from forcebound.cli.common import reports_errors, show

KINDS = ("haply_2diy",)  # those of forcebound.emulators, which is imported when it is used


@click.command(short_help="Play a device on a pseudo-terminal.")
@click.argument("kind", type=click.Choice(KINDS))
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
    help="short, noise, nan: spoil one reply, or those of a time; stall; unplug. TIME counts from "
    "the first reply; default: at=1s. Repeatable.",
)
@click.option("--until-unused", is_flag=True, help="End when the port is closed.")
@click.option("--values", type=click.File(), hidden=True, help="Mechanism and hand, as JSON.")
@reports_errors
def emulate(
    kind: str,
    link: Path | None,
    faults: tuple[str, ...],
    until_unused: bool,
    values: TextIO | None,
) -> None:
    """Play a device on a pseudo-terminal, for tests and trials without hardware."""
    from forcebound.emulators import program
    from forcebound.emulators.faults import parse_fault

    wanted = [parse_fault(text) for text in faults]
    nothing = '{"mechanism": {}, "operator": null}'
    mechanism, operator = program.given_values(nothing if values is None else values.read())
    link = program.default_link(kind) if link is None else link
    program.run(kind, mechanism, operator, link, wanted, until_unused, show)
