"""Parts that several commands share: options, errors as exit status, tables."""

import json
import os
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from functools import partial, reduce
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias, TypeVar

import click

from forcebound.cli.complete import graphs, hands, topics
from forcebound.errors import ConfigError, RunError
from forcebound.files import printable, recording_file
from forcebound.messages.topology import HAND
from forcebound.results.printing import print_rows

if TYPE_CHECKING:
    from forcebound.graph.graph import GraphConfig
    from forcebound.run.results import RunResult
    from forcebound.run.screen import Screen

Command: TypeAlias = Callable[..., None]
T = TypeVar("T")

UNKNOWN = "–"  # in place of a figure
SLOW = 1.0  # s, after which a command shows its progress


class Group(click.Group):
    """A group of commands; a wrong name gets the nearest one, or all that there are."""

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Find the command that the arguments begin with."""
        name = args[0]
        if not (name in self.commands or name.startswith("-") or ctx.resilient_parsing):
            from forcebound.graph.problems import unknown

            ctx.fail(unknown("command", name, self.commands))
        return super().resolve_command(ctx, args)


def seconds(text: str) -> float:
    """Return a time with its unit in s; the type of an option."""
    from forcebound.quantities import Range
    from forcebound.units import parse_quantity

    try:
        return Range(above=0).check(parse_quantity(text, "s"), "s")
    except ConfigError as error:
        raise click.BadParameter(str(error)) from None


PATH = click.Path(path_type=Path)
FILE = click.Path(path_type=Path, dir_okay=False)
FOLDER = click.Path(path_type=Path, file_okay=False)
COUNT = click.IntRange(min=1)

json_option = click.option("--json", "as_json", is_flag=True, help="Print one JSON document.")
json_lines_option = click.option(
    "--json", "as_json", is_flag=True, help="Print one JSON document per line."
)
all_option = click.option(
    "--all", "shows_all", is_flag=True, help="Print the table of all figures, too."
)
duration_option = partial(click.option, "--duration", type=seconds, metavar="TIME")
run_duration_option = duration_option(help="Duration of the run, e.g. 5s or 500ms.")
output_option = partial(click.option, "-o", "--output", type=FILE)


def all_of(*options: Callable[[Command], Command]) -> Callable[[Command], Command]:
    """Return arguments and options as one, in the order of the help."""
    return lambda command: reduce(lambda made, option: option(made), reversed(options), command)


def recording_option(*names: str, **settings: Any) -> Callable[[Command], Command]:
    """Return an option for a recording to write, and ``--overwrite``, without which none goes."""
    replaces = "forcebound.overwrite"  # key in the meta data of a click context

    def check(context: click.Context, _: click.Parameter, path: Path | None) -> Path | None:
        if path is None:
            return None
        try:
            recording_file(path)
        except ConfigError as error:
            raise click.BadParameter(str(error)) from None
        if path.exists() and path.stat().st_size > 0 and not context.meta[replaces]:
            raise click.BadParameter(f"{path} exists: choose another name, or add --overwrite")
        return path

    overwrite = click.option(
        "--overwrite",
        is_flag=True,
        is_eager=True,  # evaluated before the recording's name, in any order on the command line
        expose_value=False,
        callback=lambda context, _, wanted: context.meta.update({replaces: wanted}),
        help="Replace an existing recording.",
    )
    option = click.option(*names, type=FILE, callback=check, metavar="RUN.mcap", **settings)
    return all_of(option, overwrite)


hand_option = click.option(
    "--hand", metavar="NAME", shell_complete=hands, help="Only this hand, if there are several."
)
record_option = recording_option("--record", help="Record the run in this file.")
arguments_argument = partial(click.argument, "arguments", nargs=-1, metavar="[NAME:=VALUE]...")
topics_argument = click.argument("topics", nargs=-1, metavar="[TOPIC]...", shell_complete=topics)


def _running(require_graph: bool) -> Callable[..., Path]:
    def find_run(context: click.Context, _: click.Parameter, run: Path | None) -> Path:
        from forcebound.observe.runs import find, while_running

        run_dir = find(run, require_graph=require_graph)
        context.with_resource(while_running(run_dir))
        return run_dir

    return find_run


#: GRAPH as given; the directory of a run; that of a run which is more than an environment.
given_run_option = partial(
    click.option,
    "--run",
    "run",
    type=PATH,
    metavar="GRAPH",
    shell_complete=graphs,
    help="Launch file or run directory of the graph (needed if several run).",
)
run_option = given_run_option(callback=_running(require_graph=False))
graph_option = given_run_option(callback=_running(require_graph=True))


def slow_bar(name: str, as_json: bool) -> AbstractContextManager[Callable[[int, int], None]]:
    """Give a function that shows progress, if it takes long and somebody looks.

    It takes what is done, and the total.
    """
    from forcebound.lab.workers import progress_bar

    return progress_bar(name, after=SLOW, shown=sys.stderr.isatty() and not as_json)


def show(text: str, err: bool = False) -> None:
    """Print a text that may hold names from outside: none of them reaches the terminal as it is.

    A failure to write to standard error (a full disk) does not change the exit status.
    """
    with suppress(OSError) if err else nullcontext():
        click.echo(printable(text), err=err)


@contextmanager
def status_line(as_json: bool) -> "Iterator[Screen]":
    """A screen that says what a launcher is doing, if somebody looks; empty at the end."""
    from forcebound.run.screen import Screen

    screen = Screen(has_status=sys.stderr.isatty() and not as_json)
    try:
        yield screen
    finally:
        screen.status("")


def show_live_run(
    config: "GraphConfig",
    duration: float | None,
    record: Path | None,
    as_json: bool,
    shows_all: bool,
    file: str,
    folder: Path = Path(),
) -> None:
    """Run a graph in real time, and show the result; see :func:`report`."""
    from forcebound.run.live import run_live

    with status_line(as_json) as screen:
        results = run_live(config, duration, record, None, file, screen, folder)
        screen.status("computing the figures")
        for result in results.values():
            _ = result.summary
    report(results, record, as_json, shows_all)


def show_virtual_run(
    config: "GraphConfig",
    duration: float | None,
    record: Path | None,
    as_json: bool,
    shows_all: bool,
) -> None:
    """Run a graph in virtual time, and show the result; see :func:`report`."""
    from forcebound.run.virtual import run_virtual_hands

    with slow_bar("ms of virtual time", as_json) as tell:
        results = run_virtual_hands(config, duration, record, may_end_early=True, progress=tell)
    speed = next(iter(results.values())).times_real_time
    show(f"virtual time: {speed:.0f} times real time", err=True)
    report(results, record, as_json, shows_all)


def report(
    results: "Mapping[str, RunResult]", record: Path | None, as_json: bool, shows_all: bool
) -> None:
    """Show the results of a run, by hand; RunError, once they are shown, if the run failed."""
    if any(result.interrupted for result in results.values()):
        show("forcebound: interrupted; result up to here", err=True)
    summaries = {hand: result.summary for hand, result in results.items()}
    together = _coupling(results)
    if as_json:
        print_json(summaries.get(HAND, {"hands": summaries, "coupling": together}))
    else:
        from forcebound.results.coupling import coupling_lines

        labels = [hand for hand in results if hand != HAND]
        lines = list(coupling_lines(together)) if together else []
        show_results(list(results.values()), labels, lines, shows_all=shows_all)
        if record is not None:
            show(f"recording: {record}")
    for hand, result in results.items():
        if result.failed:
            raise RunError(f"{hand}: {result.failed}" if hand != HAND else result.failed)


def _coupling(results: "Mapping[str, RunResult]") -> dict[str, Any]:
    if len(results) < 2:
        return {}
    from forcebound.results.coupling import coupling

    return coupling(
        {hand: result.columns for hand, result in results.items()},
        {hand: result.document for hand, result in results.items()},
    )


def show_results(
    results: "list[RunResult]",
    labels: Sequence[str] = (),
    together: Sequence[str] = (),
    *,
    shows_all: bool,
) -> None:
    """Print the verdict on each run, under its label, and all figures if they are asked for.

    The lines that are of all hands ``together`` follow the verdicts.
    """
    from forcebound.results.tables import phase_rows, summary_table

    for number, result in enumerate(results):
        if labels:
            show(f"{labels[number]}:")
        for line in result.summary["verdict"]:
            show(f"  {line}" if labels else line)
    for line in together:
        show(line)
    if shows_all:
        click.echo()
        shown = zip(labels or [one.label for one in results], results, strict=True)
        print_rows(*summary_table([(label, one.summary) for label, one in shown]))
        for cause in (cause for one in results for cause in one.summary["little_force"]):
            show(f"little force: {cause['advice']}")
    else:
        show("All figures: --all, or --json.")
    for phases in (one.summary["phases"] for one in results if one.summary["phases"]):
        head, *rows = phase_rows(phases)
        click.echo()
        print_rows(head, rows)


def print_json(document: Any) -> None:
    """Print one JSON document, of plain types, paths, structs and dataclasses."""
    from msgspec import to_builtins

    plain = partial(to_builtins, enc_hook=os.fspath)
    click.echo(json.dumps(document, indent=2, allow_nan=False, default=plain))


def print_json_line(document: Any) -> None:
    """Print a JSON document on one line; a number that is not finite becomes null."""
    from msgspec.json import encode

    click.echo(encode(document, enc_hook=os.fspath))


def print_document(document: T, as_json: bool, lines: Callable[[T], Iterable[str]]) -> None:
    """Print a document as JSON, or in lines for people."""
    if as_json:
        print_json(document)
    else:
        show("\n".join(lines(document)))
