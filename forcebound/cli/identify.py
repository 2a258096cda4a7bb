"""The command that identifies a device."""

from pathlib import Path

import click

from forcebound.cli.common import (
    ARGUMENTS,
    file_option,
    json_option,
    print_document,
    reports_errors,
    show,
)
from forcebound.errors import ConfigError, RunError


@click.command(short_help="Measure the numbers that a device's certificate rests on.")
@click.argument("device", required=False)
@click.argument("arguments", nargs=-1, metavar=ARGUMENTS)
@file_option(
    "-o",
    "--output",
    default=Path("device.yaml"),
    show_default=True,
    help="File to write; a picture goes beside it.",
)
@file_option("--check", "checked", metavar="DEVICE.yaml", help="Test whether a device has changed.")
@click.option("--reach", help="How far an axis may move to either side, e.g. 30mm or 20deg.")
@click.option("--force", help="Largest force of an axis, e.g. 2N or '0.05 N m'.")
@click.option("--weight", help="Mass that you hang on each axis, e.g. 100g: measures the gain.")
@click.option("--lever", help="Radius at which it pulls at a joint, e.g. 40mm.")
@click.option("--by-hand", help="How long you move the device, e.g. 10s: measures its speed.")
@click.option("--yes", is_flag=True, help="Do not wait for Enter before the device moves.")
@json_option
@reports_errors
def identify(
    device: str | None,
    arguments: tuple[str, ...],
    output: Path,
    checked: Path | None,
    reach: str | None,
    force: str | None,
    weight: str | None,
    lever: str | None,
    by_hand: str | None,
    yes: bool,
    as_json: bool,
) -> None:
    r"""Measure DEVICE, a kind of device or a launch file, and write what it may state.

    The motors move the device by themselves. With --check: a short test of the device of a file;
    exit status 1 if it no longer keeps what the file states.

    \b
    forcebound identify five_bar
    forcebound identify haply_2diy device:=auto --weight 30g --lever 70mm --by-hand 10s
    forcebound identify --check device.yaml
    """
    from forcebound.identification import command

    def say(line: str) -> None:
        show(line, err=True)

    def ready(line: str) -> None:
        say(line)
        if not yes and command.is_terminal():
            click.prompt("Press Enter when ready", default="", show_default=False, err=True)

    if checked is not None:
        if device is not None:
            raise ConfigError(f"--check names the device by its file: leave out {device!r}")
        document = command.check(checked, say, ready)
        print_document(document, as_json, command.check_lines)
        if not document["passed"]:
            raise RunError(f"{checked} promises what the device no longer keeps: identify it again")
        return
    if device is None:
        raise ConfigError("name a device: a kind such as five_bar, or a launch file")
    wishes = command.Wishes(reach, force, weight, lever, by_hand)
    document = command.run(device, arguments, output, wishes, say, ready)
    print_document(document, as_json, command.lines)
