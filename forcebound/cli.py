"""The command line. Heavy imports happen inside the commands that need them.

Exit status: 0 done, 1 the run failed, 2 the input was wrong. With ``--json`` a command prints one
JSON document on standard output and nothing else there.
"""

import json
import logging
import sys
from collections.abc import Callable
from dataclasses import asdict
from functools import wraps
from importlib.metadata import version
from pathlib import Path
from typing import Any, ParamSpec

import click

from forcebound.errors import ConfigError, ForceboundError, RunError

P = ParamSpec("P")

_ARGUMENTS = "[NAME:=VALUE]..."


def _reports_errors(command: Callable[P, None]) -> Callable[P, None]:
    """Turn our own errors into a message and an exit status; leave bugs their traceback."""

    @wraps(command)
    def wrapper(*args: P.args, **kwargs: P.kwargs) -> None:
        try:
            command(*args, **kwargs)
        except ForceboundError as error:
            click.echo(f"forcebound: {error}", err=True)
            sys.exit(2 if isinstance(error, ConfigError) else 1)
        except KeyboardInterrupt:
            click.echo("forcebound: interrupted", err=True)
            sys.exit(130)

    return wrapper


def _duration(_: click.Context, parameter: click.Parameter, text: str | None) -> float | None:
    if text is None:
        return None
    from forcebound.quantities import parse_quantity

    try:
        seconds = parse_quantity(text, "s")
    except ConfigError as error:
        raise click.BadParameter(str(error)) from None
    if not seconds > 0:
        raise click.BadParameter(f"must be > 0 s, got {text}")
    return seconds


_json_option = click.option("--json", "as_json", is_flag=True, help="Print one JSON document.")
_duration_option = click.option(
    "--duration", callback=_duration, metavar="TIME", help="How long to run, such as 5s or 500ms."
)
_record_option = click.option(
    "--record",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="RUN.mcap",
    help="Keep the recording in this file.",
)


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(version("forcebound"), prog_name="forcebound")
def main() -> None:
    """Force feedback over a network that provably stays passive."""
    logging.basicConfig(format="%(levelname)s %(name)s: %(message)s", level=logging.INFO)


@main.command("launch")
@click.argument("file")
@click.argument("arguments", nargs=-1, metavar=_ARGUMENTS)
@_duration_option
@_record_option
@click.option("--check", is_flag=True, help="Check the launch file and start nothing.")
@click.option("--show-args", is_flag=True, help="Show the arguments that the file takes.")
@_json_option
@_reports_errors
def launch_graph(
    file: str,
    arguments: tuple[str, ...],
    duration: float | None,
    record: Path | None,
    check: bool,
    show_args: bool,
    as_json: bool,
) -> None:
    """Start the graph of processes of a launch file, e.g. stiff_wall.yaml law:=certified."""
    from forcebound.launch.loader import load

    if show_args:
        _show_arguments(file, as_json)
        return
    config = load(file, arguments)
    if check:
        _print_document(config) if as_json else click.echo(f"{file}: correct")
        return
    from forcebound.launch.live import run_live

    _report(run_live(config, duration, record), record, as_json)


@main.command()
@click.argument("file")
@click.argument("arguments", nargs=-1, metavar=_ARGUMENTS)
@_duration_option
@_record_option
@click.option("--seed", type=click.IntRange(min=0), help="Replace the seed of the launch file.")
@_json_option
@_reports_errors
def simulate(
    file: str,
    arguments: tuple[str, ...],
    duration: float | None,
    record: Path | None,
    seed: int | None,
    as_json: bool,
) -> None:
    """Run the same launch file in virtual time: deterministic, faster than real time."""
    from dataclasses import replace

    from forcebound.launch.loader import load
    from forcebound.launch.virtual import run_virtual

    config = load(file, arguments)
    if seed is not None:
        config = replace(config, seed=seed)
    result = run_virtual(config, duration, record)
    click.echo(f"virtual time: {result.times_real_time:.0f} times real time", err=True)
    _report(result, record, as_json)


@main.command()
@click.argument("kind", type=click.Choice(["device", "controller", "environment", "recorder"]))
@click.argument("file")
@click.argument("arguments", nargs=-1, metavar=_ARGUMENTS)
@click.option(
    "--run-dir",
    type=click.Path(exists=True, file_okay=False, path_type=Path),
    help="Folder of the run's sockets; every node of a run names the same. Without it, an "
    "environment serves a graph on another machine, as remote: in FILE says.",
)
@click.option(
    "--supervised",
    is_flag=True,
    hidden=True,
    help="End with the process that started it; engage at its word.",
)
@_reports_errors
def node(
    kind: str, file: str, arguments: tuple[str, ...], run_dir: Path | None, supervised: bool
) -> None:
    """Run one node of a launch file by hand, on this machine or for a graph on another one."""
    from forcebound.launch.worker import run_node

    sys.exit(run_node(kind, Path(file), run_dir, supervised, arguments))


_run_option = click.option(
    "--run",
    "run_dir",
    type=click.Path(path_type=Path),
    metavar="DIR",
    help="Run directory of the graph that is meant, if several run.",
)


@main.command()
@click.argument("node_name", metavar="NODE")
@_run_option
@_reports_errors
def stop(node_name: str, run_dir: Path | None) -> None:
    """Stop NODE (environment or controller) of a running graph, until it is started again."""
    from forcebound.launch.orders import stop_node
    from forcebound.launch.runs import find

    stop_node(find(run_dir), node_name)
    click.echo(f"{node_name} is stopped; the device shows zero force until somebody answers")


@main.command()
@click.argument("node_name", metavar="NODE")
@_run_option
@_reports_errors
def start(node_name: str, run_dir: Path | None) -> None:
    """Start NODE (environment or controller) of a running graph again after a stop."""
    from forcebound.launch.orders import start_node
    from forcebound.launch.runs import find

    start_node(find(run_dir), node_name)
    click.echo(f"{node_name} runs")


@main.command()
def schema() -> None:
    """Print the JSON schema of launch files, for completion in an editor."""
    from forcebound.launch.schema import json_schema

    _print_json(json_schema())


@main.command()
@click.argument("runs", nargs=-1, required=True, metavar="RUN.mcap...")
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Picture to write, .png or .svg; beside the first recording by default.",
)
@_json_option
@_reports_errors
def plot(runs: tuple[str, ...], output: Path | None, as_json: bool) -> None:
    """Draw recordings, side by side: position, forces with the bound, energy, loop delay."""
    from forcebound.analysis.plots import figure, save
    from forcebound.launch.results import RunResult

    results = [RunResult.from_recording(Path(run)) for run in runs]
    if output is None:
        output = Path(runs[0]).with_suffix(".png")
    save(figure([(r.label, r.columns, r.document) for r in results]), output)
    if as_json:
        _print_json({"picture": str(output), "runs": [r.summary for r in results]})
        return
    print_table(results)
    click.echo(f"picture: {output}")


@main.command()
@click.argument("run", required=False, metavar="[RUN]", type=click.Path(path_type=Path))
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="TRACE.csv",
    help="Write the delays as a trace, to be replayed on a link.",
)
@_duration_option
@_json_option
@_reports_errors
def delay(run: Path | None, output: Path | None, duration: float | None, as_json: bool) -> None:
    """Show the loop delay of RUN: a recording or a run directory; else the graph that runs."""
    from forcebound.launch.delay import measure, summary

    trace = measure(run, duration)
    if output is not None:
        trace.write(output)
    document = {**summary(trace), "trace": None if output is None else str(output)}
    if as_json:
        _print_json(document)
        return
    for name, value in document["loop_delay_ms"].items():
        click.echo(f"loop delay {name:<4}{'-' if value is None else f'{value:.2f} ms':>10}")
    click.echo(f"lost {document['lost_share']:>14.1%} of {document['ticks']} ticks")
    if output is not None:
        click.echo(f"trace: {output}")


@main.command()
@click.argument("name")
@_duration_option
@click.option("--rate", default=1000.0, show_default=True, help="Ticks a second, in Hz.")
@_json_option
@_reports_errors
def bench(name: str, duration: float | None, rate: float, as_json: bool) -> None:
    """Measure NAME (servo, loop, delay or sweep) beside its limit in the same run."""
    from forcebound.benchmark import BENCHMARKS, tables

    if name not in BENCHMARKS:
        known = "; ".join(f"{key}: {one.summary}" for key, one in BENCHMARKS.items())
        raise ConfigError(f"no benchmark {name!r}; known are {known}")
    if not rate > 0:
        raise ConfigError(f"--rate must be > 0 Hz, got {rate}")
    result = BENCHMARKS[name].run(duration, rate, lambda line: click.echo(line, err=True))
    if as_json:
        _print_json(result)
        return
    from rich.console import Console
    from rich.table import Table

    for one in tables(result):
        table = Table(*one.columns, title=one.title, title_justify="left", box=None)
        for row in one.rows:
            table.add_row(*row)
        Console().print(table)


@main.group(invoke_without_command=True)
@click.option(
    "--runs",
    type=click.IntRange(min=0),
    default=1000,
    show_default=True,
    help="Random runs of each law.",
)
@click.option(
    "--search",
    "searched",
    type=click.IntRange(min=0),
    default=1000,
    show_default=True,
    help="Runs of each law by a search that learns to hurt.",
)
@click.option("--law", "laws", multiple=True, help="Only this law; may be repeated.")
@click.option("--seed", type=click.IntRange(min=0), default=1, show_default=True)
@click.option(
    "--workers", type=click.IntRange(min=0), help="Processes; one a core by default; 0: this one."
)
@click.option(
    "--out",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="REPORT.md",
    help="Write the result as a page.",
)
@_json_option
@click.pass_context
@_reports_errors
def audit(
    context: click.Context,
    runs: int,
    searched: int,
    laws: tuple[str, ...],
    seed: int,
    workers: int | None,
    out: Path | None,
    as_json: bool,
) -> None:
    """Attack the laws; exit with 1 if a certified one gives energy away."""
    if context.invoked_subcommand is not None:
        return
    from forcebound.audit.command import run
    from forcebound.audit.report import show_energy, verdict

    document = run(laws, runs, searched, seed, workers, out)
    if as_json:
        _print_json(document)
    else:
        for row in document["laws"]:
            lowest = show_energy(row["loss_and_work_min_j"])
            click.echo(f"{row['law']:<27}{lowest:>14}  {verdict(row):<30}case {row['case']}")
        click.echo(f"{document['runs']} runs; forcebound audit replay LAW CASE shows one again")
    sys.exit(0 if all(row["holds"] for row in document["laws"]) else 1)


@audit.command()
@click.argument("law")
@click.argument("case")
@_duration_option
@click.option(
    "--out",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="RUN.png",
    help="Draw the run, .png or .svg.",
)
@_json_option
@_reports_errors
def replay(law: str, case: str, duration: float | None, out: Path | None, as_json: bool) -> None:
    """Show a run of an audit again: LAW under CASE, a seed or a code."""
    from forcebound.audit.command import run_again

    document = run_again(law, case, duration or 2.0, out)
    if as_json:
        _print_json(document)
        return
    for name, value in [*document.pop("case").items(), *document.items()]:
        click.echo(f"{name:<22}{value:.6g}" if isinstance(value, float) else f"{name:<22}{value}")


@main.command()
@click.argument("names", nargs=-1, metavar="[NAME]...")
@click.option(
    "--out",
    type=click.Path(path_type=Path, file_okay=False),
    default=Path("results/reproduce"),
    show_default=True,
    help="Folder for pictures, numbers and the report.",
)
@_json_option
@_reports_errors
def reproduce(names: tuple[str, ...], out: Path, as_json: bool) -> None:
    """Run the paper's experiments again: table1, fig4 to fig21, eq41_42; all without a NAME."""
    from forcebound.experiments.reproduce import reproduce, tables

    done = reproduce(names, out, lambda line: click.echo(line, err=True))
    if as_json:
        _print_json(done.document)
        return
    from rich.console import Console

    for table in tables(done):
        Console().print(table)
    click.echo(f"report: {out / 'report.html'}")


@main.command()
@click.argument("file")
@click.argument("arguments", nargs=-1, metavar=_ARGUMENTS)
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Parquet file to write; named after the sweep file by default.",
)
@click.option("--workers", type=click.IntRange(min=1), help="Processes; one a core by default.")
@click.option("--cluster", metavar="ADDRESS", help="Scheduler of a dask cluster to run it on.")
@click.option("--restart", is_flag=True, help="Begin anew instead of going on.")
@click.option("--plot", "as_plot", is_flag=True, help="Draw the sweep's map beside the result.")
@_json_option
@click.pass_context
@_reports_errors
def sweep(
    context: click.Context,
    file: str,
    arguments: tuple[str, ...],
    output: Path | None,
    workers: int | None,
    cluster: str | None,
    restart: bool,
    as_plot: bool,
    as_json: bool,
) -> None:
    """Run a sweep file, such as z_width or stability_map; go on with one that was interrupted.

    The name audit stands for `forcebound audit`, whose cases are attacks and no grid.
    """
    if file == "audit":
        if arguments or cluster or restart or as_plot:
            raise ConfigError("sweep audit takes --output, --workers and --json; see audit --help")
        context.invoke(audit, workers=workers, out=output, as_json=as_json)
        return
    from forcebound.sweep.command import run

    document = run(file, arguments, output, workers, cluster, restart, as_plot)
    if as_json:
        _print_json(document)
    else:
        for name, value in document.items():
            if value is not None:
                click.echo(f"{name.replace('_', ' ')}: {value}")
    if document["failed"] == document["cases"]:
        raise RunError(f"every case failed; the first: {document['first_error']}")


@main.command("map")
@click.argument("result", type=click.Path(path_type=Path, dir_okay=False))
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Picture to write, .png or .svg; beside the result by default.",
)
@_reports_errors
def draw_map(result: Path, output: Path | None) -> None:
    """Draw the map of a sweep's RESULT.parquet, with the limits of theory."""
    from forcebound.sweep.maps import draw

    output = output or result.with_suffix(".png")
    draw(result, output)
    click.echo(f"map: {output}")


@main.group("keys")
def keys_group() -> None:
    """Make and show the keys that secure the link to another machine."""


@keys_group.command("new")
@click.argument("name")
@_json_option
@_reports_errors
def new_keys(name: str, as_json: bool) -> None:
    """Make the key pair NAME; its secret stays on this machine."""
    from forcebound.network.keys import key_folder, new_key

    made, folder = new_key(name), key_folder()
    if as_json:
        _print_json({"name": made.name, "public": made.public, "folder": str(folder)})
        return
    click.echo(f"public key: {made.public}")
    click.echo(f"give {folder / name}.key to the other machine's key folder; the secret stays here")


@keys_group.command("list")
@_json_option
@_reports_errors
def list_all_keys(as_json: bool) -> None:
    """List the keys on this machine."""
    from forcebound.network.keys import key_folder, list_keys

    entries = list_keys()
    if as_json:
        _print_json([asdict(entry) for entry in entries])
        return
    for entry in entries:
        kind = "pair" if entry.has_secret else "public"
        click.echo(f"{entry.name:<20}{kind:<8}{entry.problem or entry.public}")
    if not entries:
        click.echo(f"no keys in {key_folder()}; make one with: forcebound keys new NAME", err=True)


@keys_group.command("show")
@click.argument("name")
@_json_option
@_reports_errors
def show_key(name: str, as_json: bool) -> None:
    """Print the public key NAME, to be given to the other machine."""
    from forcebound.network.keys import public_key

    public = public_key(name)
    _print_json({"name": name, "public": public}) if as_json else click.echo(public)


@main.group()
def check() -> None:
    """Check a part that you wrote against what the graph expects of it."""


@check.command("environment")
@click.argument("kind", metavar="FILE[:CLASS]")
@click.argument("arguments", nargs=-1, metavar=_ARGUMENTS)
@click.option(
    "--axes",
    type=click.IntRange(1, 6),
    multiple=True,
    help="Number of axes to ask with; repeat for several; 1 to 6 by default.",
)
@click.option(
    "--rest",
    multiple=True,
    metavar="POSITION=FORCE",
    help="Force expected at rest there, on the first axis, such as 0mm=0N; repeat for several.",
)
@_json_option
@_reports_errors
def check_environment(
    kind: str,
    arguments: tuple[str, ...],
    axes: tuple[int, ...],
    rest: tuple[str, ...],
    as_json: bool,
) -> None:
    """Check an environment: a file of yours, or a kind that comes with forcebound.

    Asks it some thousand questions, at random and at its limits; tells each promise that it breaks.
    Exit status 1: it breaks one. How fast it answers is told, never judged.
    """
    from forcebound.launch.check import check_environment

    checked = check_environment(kind, arguments, axes, rest)
    if as_json:
        _print_json(checked.document)
    else:
        click.echo("\n".join(checked.lines()))
    if not checked.passed:
        raise RunError(f"{kind} breaks its contract")


def _show_arguments(file: str, as_json: bool) -> None:
    from forcebound.launch.loader import arguments_of

    arguments = arguments_of(file)
    if as_json:
        _print_json([asdict(argument) for argument in arguments])
        return
    for argument in arguments:
        default = "(required)" if argument.default is None else argument.default
        choices = f" [{', '.join(map(str, argument.choices))}]" if argument.choices else ""
        click.echo(f"{f'{argument.name}:={default}':<26}  {argument.help}{choices}")


def _report(result: Any, record: Path | None, as_json: bool) -> None:
    if result.interrupted:
        click.echo("forcebound: interrupted; this is the run until then", err=True)
    if as_json:
        _print_json(result.summary)
        return
    print_table([result])
    if result.summary["phases"]:
        _print_phases(result.summary["phases"])
    if record is not None:
        click.echo(f"recording: {record}")


def print_table(results: list[Any]) -> None:
    """Print the key figures of some runs, one column each."""
    from rich.console import Console
    from rich.table import Table

    from forcebound.analysis.metrics import summary_rows

    table = Table(box=None, pad_edge=False)
    table.add_column("")
    columns = [dict(summary_rows(result.summary)) for result in results]
    for result in results:
        table.add_column(result.label, justify="right")
    for label in columns[0]:
        table.add_row(label, *(column.get(label, "-") for column in columns))
    Console().print(table)


def _print_phases(phases: list[Any]) -> None:
    from rich.console import Console
    from rich.table import Table

    from forcebound.analysis.metrics import phase_rows

    head, *rows = phase_rows(phases)
    table = Table(head[0], box=None, pad_edge=False)
    for name in head[1:]:
        table.add_column(name, justify="right", no_wrap=True)
    for row in rows:
        table.add_row(*row)
    Console().print("", table)


def _print_document(config: Any) -> None:
    from forcebound.launch.config import to_document

    _print_json(to_document(config))


def _print_json(document: Any) -> None:
    click.echo(json.dumps(document, indent=2, allow_nan=False))
