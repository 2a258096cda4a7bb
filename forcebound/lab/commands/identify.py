"""Command ``forcebound identify``: measures what a device may state."""

import sys
from pathlib import Path

import click

from forcebound.cli import options as opt
from forcebound.cli.common import print_document, say
from forcebound.cli.lazy import when_used
from forcebound.errors import ConfigError, RunError
from forcebound.extras import check_installed

with when_used():
    from forcebound.lab.identification import command as identification


def identify(
    device: str | None = opt.argument(required=False),
    arguments: tuple[str, ...] = opt.settings,
    output: Path = opt.output("File to write.", Path("device.yaml")),
    checked: Path | None = opt.file(
        "Test whether a device has changed.", "--check", metavar="DEVICE.yaml"
    ),
    reach: str | None = opt.option("How far an axis may move to either side, e.g. 30mm or 20deg."),
    force: str | None = opt.option("Largest force of an axis, e.g. 2N or '0.05 N m'."),
    weight: str | None = opt.option(
        "Mass that you hang on each axis, e.g. 100g, to measure the gain."
    ),
    lever: str | None = opt.option("Radius at which it pulls at a joint, e.g. 40mm."),
    yes: bool = opt.flag("Do not wait for Enter before the device moves."),
    as_json: bool = opt.as_json,
) -> None:
    r"""Measure DEVICE, a kind of device or a launch file, and write what it may state.

    The motors move the device by themselves. With --check: a short test of the device of a file;
    exit status 1 if it no longer keeps what the file states. Needs the extra lab: pip install
    'forcebound[lab]'.

    \b
    forcebound identify five_bar
    forcebound identify haply_2diy device:=auto --weight 30g --lever 70mm
    forcebound identify --check device.yaml
    """
    check_installed("identify", "scipy")

    def ready(line: str) -> None:
        say(line)
        if not yes and sys.stdin.isatty():
            click.prompt("Press Enter when ready", default="", show_default=False, err=True)

    if checked is not None:
        if device is not None:
            raise ConfigError(f"--check names the device by its file: leave out {device!r}")
        found = identification.check(checked, say, ready)
        print_document(found, as_json, identification.check_lines)
        if not found.passed:
            raise RunError(f"{checked} promises what the device no longer keeps: identify it again")
        return
    if device is None:
        raise ConfigError("name a device: a kind such as five_bar, or a launch file")
    document = identification.run(
        device, arguments, output, say, ready, reach=reach, force=force, weight=weight, lever=lever
    )
    print_document(document, as_json, identification.lines)
