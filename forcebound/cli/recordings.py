"""Commands that make something of a recording."""

from pathlib import Path

import click

from forcebound.cli.common import file_option, json_option, print_json, reports_errors, show
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
    from dataclasses import asdict

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
