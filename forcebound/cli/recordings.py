"""Commands that make something of a recording."""

import sys
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

import click

from forcebound.cli.common import (
    ARGUMENTS,
    file_option,
    json_option,
    print_json,
    reports_errors,
    show,
)
from forcebound.errors import ConfigError

_run_argument = click.argument(
    "run", metavar="RUN.mcap", type=click.Path(path_type=Path, dir_okay=False)
)
_folder_option = click.Path(path_type=Path, file_okay=False)


@click.command(short_help="Write the topics of a recording as tables.")
@_run_argument
@click.option("--csv", type=_folder_option, metavar="DIR", help="Into this folder, as CSV.")
@click.option("--parquet", type=_folder_option, metavar="DIR", help="The same, as Parquet.")
@click.option("--overwrite", is_flag=True, help="Replace files that are there.")
@reports_errors
def export(run: Path, csv: Path | None, parquet: Path | None, overwrite: bool) -> None:
    r"""Write each topic of a recording as a table; columns.csv has their units and meanings.

    \b
    forcebound export run.mcap --csv tables
    forcebound export run.mcap --parquet tables --overwrite
    """
    from forcebound.recording import read
    from forcebound.recordings.export import export as write_tables

    wanted = {"csv": csv, "parquet": parquet}
    if not any(wanted.values()):
        raise click.UsageError("choose --csv DIR or --parquet DIR")
    recording = read(run)
    if not recording.complete:
        show(f"forcebound: recording incomplete: using the readable part of {run}", err=True)
    for kind, folder in wanted.items():
        if folder is not None:
            for file in write_tables(recording, folder, kind, overwrite):
                show(str(file))


@click.command(short_help="Make a complete recording of a cut one.")
@_run_argument
@file_option("-o", "--output", required=True, metavar="OUT.mcap", help="The recording to write.")
@click.option("--overwrite", is_flag=True, help="Replace a file that is there.")
@json_option
@reports_errors
def recover(run: Path, output: Path, overwrite: bool, as_json: bool) -> None:
    """Write what can be read of a cut or damaged recording as a complete one; says what is lost."""
    from forcebound.recordings.recovery import recover as write_recovered

    if output.exists() and not overwrite:
        raise ConfigError(f"{output} exists: choose another name, or add --overwrite")
    found = write_recovered(run, output)
    if as_json:
        print_json(asdict(found))
        return
    show(f"recovered: {found.messages} messages, {found.duration:.3f} s")
    if found.lost_bytes:
        show(f"lost: the last {found.lost_bytes} bytes, which cannot be read")
    show("lost: what the recorder had not yet written; in a live run, at most the last 0.25 s")
    show(f"recording: {output}")


@click.command(short_help="Verify a recording, or run it once more with other parts.")
@_run_argument
@click.argument("settings", nargs=-1, metavar=ARGUMENTS)
@click.option("--verify", is_flag=True, help="Compare the forces that its inputs give, to the bit.")
@json_option
@reports_errors
def replay(run: Path, settings: tuple[str, ...], verify: bool, as_json: bool) -> None:
    r"""Verify a recording: its inputs through the same law give the recorded forces, to the bit.

    Exit status 1: a force differs, or a tick is missing. If the recorder missed the first ticks,
    verification begins when the force engages, and with it the ledger.

    \b
    forcebound replay run.mcap --verify
    forcebound replay run.mcap law:=my_law.py --verify
    """
    if not verify:
        raise click.UsageError("choose --verify")
    _verify(run, settings, as_json)


def _verify(run: Path, settings: Sequence[str], as_json: bool) -> None:
    from forcebound.files import content_of
    from forcebound.recording import read
    from forcebound.recordings.rerun import device_of
    from forcebound.recordings.verification import TOPICS
    from forcebound.recordings.verification import verify as verify_recording

    recording = read(run, TOPICS)
    device = device_of(recording, settings)
    with content_of(run):
        found = verify_recording(recording, device)
    if as_json:
        print_json(asdict(found) | {"is_same": found.is_same})
    else:
        show(f"verified: {found.verified} of {found.ticks} ticks, {found.differing} differ")
        if found.difference:
            show(f"first difference: {found.difference}")
        if found.unknown:
            show(f"not verified: {found.unknown} ticks before the force engaged, see --help")
        if found.verified + found.unknown < found.ticks:
            show("a tick is missing from the recording; what follows it cannot be verified")
        show(
            f"commands: {found.commands} forces follow from a recorded one,"
            f" of {found.unknown_commands} it is not recorded"
        )
    sys.exit(0 if found.is_same else 1)
