"""Commands for audits, sweeps and the paper's experiments."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import click

from forcebound.cli import complete
from forcebound.cli.common import (
    COUNT,
    FILE,
    FOLDER,
    Command,
    Group,
    all_of,
    arguments_argument,
    json_option,
    output_option,
    print_document,
    print_json,
    run_duration_option,
    show,
)
from forcebound.errors import RunError

NUMBER = click.IntRange(min=0)
_number_option = partial(click.option, type=NUMBER, show_default=True)

workers_option = click.option(
    "--workers",
    type=NUMBER,
    help="Number of processes; 0: only this one. Default: one per core.",
)


def _campaign_options(of_each: str, runs: int) -> Callable[[Command], Command]:
    """Return the options of an audit: laws, numbers of runs, seed, report."""
    return all_of(
        _number_option("--runs", default=runs, help=f"Random runs of {of_each}."),
        _number_option(
            "--search",
            "searched",
            default=runs,
            help="Runs of each in a CMA-ES search for the lowest energy.",
        ),
        click.option(
            "--law",
            "laws",
            multiple=True,
            shell_complete=complete.laws,
            help="Only this law; repeatable.",
        ),
        _number_option("--seed", default=1, help="Seed of the runs."),
        workers_option,
        output_option("out", metavar="REPORT.md", help="Write the report to this file."),
        click.option(
            "--rows",
            type=FILE,
            metavar="RUNS.parquet",
            help="Keep all runs in this file; an audit that was interrupted goes on.",
        ),
        json_option,
    )


@contextmanager
def _continued(words: str = "the same command") -> Iterator[None]:
    """If the user interrupts a campaign that keeps its parts, say how it goes on."""
    try:
        yield
    except KeyboardInterrupt:
        if words:
            show(f"forcebound: {words} continues with what is left", err=True)
        raise


@click.group(invoke_without_command=True, short_help="Attack the laws in simulation.", cls=Group)
@_campaign_options("each law, and of it with each certificate", 1000)
@click.option(
    "--certificate", "certificates", multiple=True, help="Only this certificate; repeatable."
)
@click.pass_context
def audit(context: click.Context, /, as_json: bool, **campaign: Any) -> None:
    r"""Attack the laws and their certificates; exit status 1 if a certified law leaks energy.

    With --law alone the certificates are left out, with --certificate alone the laws.

    \b
    forcebound audit
    forcebound audit --law tdpa --runs 100 --search 0
    """
    if context.invoked_subcommand is not None:
        return
    from forcebound.lab.audit import holds, lines, run

    with _continued("the same command" if campaign["rows"] else ""):
        document = run(**campaign)
    print_document(document, as_json, lines)
    sys.exit(0 if holds(document) else 1)


@audit.command(short_help="Repeat one run of an audit.")
@click.argument("law")
@click.argument("case")
@run_duration_option
@output_option("out", metavar="RUN.png", help="Draw the run to this file, .png or .svg.")
@json_option
def replay(law: str, case: str, duration: float | None, out: Path | None, as_json: bool) -> None:
    r"""Repeat one run of an audit: LAW under CASE, a seed or a code, or one of a certificate.

    \b
    forcebound audit replay tdpa 7 -o attack.png
    """
    from forcebound.lab.audit_replay import lines, run_again

    print_document(run_again(law, case, duration, out), as_json, lines)


@audit.command(short_help="Attack the laws through worlds, in two and three axes.")
@_campaign_options("each law with each world and controller", 100)
@click.option("--world", "worlds", multiple=True, help="Only this world; repeatable.")
@click.option("--controller", "controllers", multiple=True, help="Only this one; repeatable.")
def worlds(as_json: bool, **campaign: Any) -> None:
    r"""Attack the certified laws through every world and controller; status 1 if one leaks.

    The law none meets some of the random cases, to show what the attacks can do.

    \b
    forcebound audit worlds --world mesh --runs 20 --search 0
    """
    from forcebound.lab.audit import holds
    from forcebound.lab.worlds import lines, run

    with _continued("the same command" if campaign["rows"] else ""):
        document = run(**campaign)
    print_document(document, as_json, lines)
    sys.exit(0 if holds(document) else 1)


@audit.command(short_help="Show what a wrong number of a device costs.")
@click.option(
    "--device", "kind", default="phantom_premium_1_5", show_default=True, help="Kind of device."
)
@_number_option("--runs", type=COUNT, default=2000, help="Runs of the search for each.")
@workers_option
@json_option
def sensitivity(kind: str, runs: int, workers: int | None, as_json: bool) -> None:
    r"""Show what each wrong number of a device costs: the lowest energy that a search finds.

    \b
    forcebound audit sensitivity --device knob --runs 100
    """
    from forcebound.lab.sensitivity import run
    from forcebound.lab.views import energy

    document = run(kind, runs, workers)
    if as_json:
        print_json(document)
        return
    for row in document["mistakes"]:
        click.echo(f"{row['summary']:<46}{energy(row['energy_min_j']):>12}")


@click.command(short_help="Repeat the paper's experiments.")
@click.argument("names", nargs=-1, metavar="[NAME]...")
@output_option(
    "out",
    type=FOLDER,
    default=Path("results/reproduce"),
    show_default=True,
    help="Folder for pictures and numbers.",
)
@json_option
def reproduce(names: tuple[str, ...], out: Path, as_json: bool) -> None:
    r"""Repeat the paper's experiments: table1, fig4 to fig21, eq41_42. Default: all.

    \b
    forcebound reproduce table1
    forcebound reproduce -o results/paper
    """
    from forcebound.lab.paper.reproduce import reproduce, tables
    from forcebound.lab.paper.setup import Runs

    done = reproduce(names, out, Runs(lambda line: show(line, err=True)))
    if as_json:
        print_json(done.document)
        return
    from rich.console import Console

    for table in tables(done):
        Console().print(table)
    show(f"pictures and numbers: {out}")


@click.command(short_help="Run a graph over a grid of its parameters.")
@click.argument("file", shell_complete=complete.sweeps)
@arguments_argument()
@output_option(help="Parquet file to write. Default: name of the sweep file.")
@click.option("--workers", type=COUNT, help="Number of processes. Default: one per core.")
@click.option(
    "--cluster", metavar="ADDRESS", help="Run on a dask cluster; address of its scheduler."
)
@click.option("--restart", is_flag=True, help="Discard earlier parts.")
@click.option("--overwrite", is_flag=True, help="Replace the result of another sweep.")
@click.option("--plot", is_flag=True, help="Also draw the map of the sweep.")
@json_option
def sweep(file: str, restart: bool, as_json: bool, **options: Any) -> None:
    r"""Run a sweep file, e.g. z_width or stability_map; continue an interrupted sweep.

    \b
    forcebound sweep stability_map --plot
    forcebound sweep my_sweep.yaml -o my_sweep.parquet --workers 2
    """
    from forcebound.lab.sweep.runner import run_file

    with _continued("the same command without --restart" if restart else "the same command"):
        document = run_file(file, restart=restart, **options)
    if as_json:
        print_json(document)
    else:
        for name, value in document.items():
            if value is not None:
                show(f"{name.replace('_', ' ')}: {value}")
    if document["failed"] == document["cases"]:
        raise RunError(f"every case failed; the first: {document['first_error']}")


@click.command("map", short_help="Draw the map of a sweep's result.")
@click.argument("result", type=FILE)
@output_option(help="Picture file, .png or .svg. Default: name of the result, .png.")
def draw_map(result: Path, output: Path | None) -> None:
    r"""Draw the map of a sweep's RESULT.parquet, with theoretical limits.

    \b
    forcebound map stability_map.parquet -o map.svg
    """
    from forcebound.lab.sweep.maps import draw

    output = output or result.with_suffix(".png")
    draw(result, output)
    show(f"map: {output}")
