"""Commands that make something of a recording."""

import sys
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

import click

from forcebound.cli import complete
from forcebound.cli.common import (
    ARGUMENTS,
    duration_option,
    file_option,
    json_option,
    print_json,
    record_option,
    reports_errors,
    show,
    slow_bar,
)
from forcebound.errors import ConfigError

if TYPE_CHECKING:
    from forcebound.recording import Recording

_run_argument = click.argument(
    "run",
    metavar="RUN.mcap",
    type=click.Path(path_type=Path, dir_okay=False),
    shell_complete=complete.recordings,
)
_folder_option = click.Path(path_type=Path, file_okay=False)


def _read(run: Path, topics: Sequence[str] | None = None) -> "Recording":
    """Return a recording, with these topics or all, and say if it is incomplete."""
    from forcebound.recording import read

    recording = read(run) if topics is None else read(run, topics)
    if not recording.complete:
        show(f"forcebound: recording incomplete: using the readable part of {run}", err=True)
    return recording


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
    from forcebound.recordings.export import export as write_tables

    wanted = {"csv": csv, "parquet": parquet}
    if not any(wanted.values()):
        raise click.UsageError("choose --csv DIR or --parquet DIR")
    recording = _read(run)
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
    r"""Write what can be read of a cut or damaged recording as a complete one; says what is lost.

    \b
    forcebound recover cut.mcap -o whole.mcap
    """
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
@click.option("--network", is_flag=True, help="Feed the recorded delays, in place of those set.")
@click.option(
    "--environment", is_flag=True, help="Feed the recorded replies; they do not react to the hand."
)
@click.option("--live", is_flag=True, help="In real time. Default: in virtual time.")
@duration_option
@record_option
@json_option
@reports_errors
def replay(
    run: Path,
    settings: tuple[str, ...],
    verify: bool,
    network: bool,
    environment: bool,
    live: bool,
    duration: float | None,
    record: Path | None,
    as_json: bool,
) -> None:
    r"""Run the graph of a recording once more, its hand fed from the recording.

    NAME:=VALUE puts another part in place of the recorded one (law, device, operator, controller,
    environment) or changes a key of the launch file (environment.stiffness).

    --verify runs no graph: the recorded inputs through the same law give the recorded forces, to
    the bit. Exit status 1: a force differs, or a tick is missing. If the recording begins after the
    force engaged, verification begins at a new law.

    \b
    forcebound replay run.mcap law:=none
    forcebound replay run.mcap --network --live --record again.mcap controller:=local_model
    forcebound replay run.mcap --environment law:=tdpa
    forcebound replay run.mcap --verify
    """
    if verify:
        if live or network or environment or duration or record:
            raise click.UsageError("--verify runs no graph: give it alone, or with NAME:=VALUE")
        _verify(run, settings, as_json)
    from forcebound.cli.run import report, status_line
    from forcebound.launch.live import run_live
    from forcebound.launch.virtual import run_virtual
    from forcebound.messages.packets import TOPIC_OF, Telemetry
    from forcebound.recordings.rerun import duration_of, graph_of

    if record is not None and record.exists() and record.samefile(run):
        raise click.UsageError(f"--record: {record} is the recording itself")
    recording = _read(run, (TOPIC_OF[Telemetry],))
    wanted = {"hand": True, "network": network, "environment": environment}
    config = graph_of(recording, settings, [feed for feed, is_fed in wanted.items() if is_fed])
    seconds = duration_of(recording, config) if duration is None else duration
    if live:
        described = " ".join((str(run), *settings))
        with status_line(as_json) as screen:
            result = run_live(config, seconds, record, file=described, screen=screen)
    else:
        with slow_bar("ms of virtual time", as_json) as tell:
            result = run_virtual(config, seconds, record, may_end_early=True, progress=tell)
    report(result, record, as_json)


def _verify(run: Path, settings: Sequence[str], as_json: bool) -> NoReturn:
    from forcebound.files import content_of
    from forcebound.recordings.rerun import device_of
    from forcebound.recordings.verification import TOPICS
    from forcebound.recordings.verification import verify as verify_recording

    recording = _read(run, TOPICS)
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
            show(f"not verified: {found.unknown} ticks of an earlier ledger, see --help")
        if found.verified + found.unknown < found.ticks:
            show("a tick is missing from the recording; what follows it cannot be verified")
        show(
            f"commands: {found.commands} forces follow from a recorded one,"
            f" of {found.unknown_commands} it is not recorded"
        )
    sys.exit(0 if found.is_same else 1)
