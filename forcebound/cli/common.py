"""Parts that several commands share: options, errors as exit status, tables."""

import json
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, nullcontext, suppress
from functools import partial, wraps
from pathlib import Path
from typing import Any, ParamSpec

import click

from forcebound.cli.complete import Offer, graphs, topics
from forcebound.errors import ConfigError, ForceboundError
from forcebound.files import RECORDING_SUFFIX, printable

P = ParamSpec("P")

UNKNOWN = "–"  # in place of a figure
LONGEST_CELL = 500  # characters
WIDEST = 200  # characters; a table leaves a narrower terminal before it breaks a number in two
ARGUMENTS = "[NAME:=VALUE]..."
SLOW = 1.0  # s, after which a command shows its progress
INTERRUPTED = 130  # exit status after Ctrl-C, as shells have it


class Group(click.Group):
    """A group of commands; a wrong name gets the nearest one, or all that there are."""

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Find the command that the arguments begin with."""
        name = args[0]
        if not (name in self.commands or name.startswith("-") or ctx.resilient_parsing):
            from forcebound.config.problems import unknown

            ctx.fail(unknown("command", name, self.commands))
        return super().resolve_command(ctx, args)


def reports_errors(command: Callable[P, None]) -> Callable[P, None]:
    """Turn errors of forcebound into a message and an exit status; bugs keep their traceback."""

    @wraps(command)
    def wrapper(*args: P.args, **kwargs: P.kwargs) -> None:
        try:
            command(*args, **kwargs)
        except ForceboundError as error:
            show(f"forcebound: {error}", err=True)
            sys.exit(2 if isinstance(error, ConfigError) else 1)

    return wrapper


def _duration(_: click.Context, parameter: click.Parameter, text: str | None) -> float | None:
    if text is None:
        return None
    from forcebound.units import parse_quantity

    try:
        seconds = parse_quantity(text, "s")
    except ConfigError as error:
        raise click.BadParameter(str(error)) from None
    if not seconds > 0:
        raise click.BadParameter(f"must be > 0 s, got {text}")
    return seconds


json_option = click.option("--json", "as_json", is_flag=True, help="Print one JSON document.")
json_lines_option = click.option(
    "--json", "as_json", is_flag=True, help="One JSON document each, on a line."
)


def duration_option_for(
    help_text: str, name: str = "--duration"
) -> Callable[[Callable[P, None]], Callable[P, None]]:
    """Return an option for a time with another help text, or name, than that of a run."""
    return click.option(name, callback=_duration, metavar="TIME", help=help_text)


duration_option = duration_option_for("Duration of the run, e.g. 5s or 500ms.")


file_option = partial(click.option, type=click.Path(path_type=Path, dir_okay=False))


def _recording(context: click.Context, _: click.Parameter, path: Path | None) -> Path | None:
    if path is None:
        return None
    if path.suffix not in ("", RECORDING_SUFFIX):
        raise click.BadParameter(
            f"the name of a recording must end in {RECORDING_SUFFIX}, or have no ending, got {path}"
        )
    if path.exists() and path.stat().st_size > 0 and not context.meta[_OVERWRITE]:
        raise click.BadParameter(f"{path} exists: choose another name, or add --overwrite")
    return path


_OVERWRITE = "forcebound.overwrite"  # key in the meta data of a click context

overwrite_option = click.option(
    "--overwrite",
    is_flag=True,
    is_eager=True,  # evaluated before the recording's name, in any order on the command line
    expose_value=False,
    callback=lambda context, _, wanted: context.meta.update({_OVERWRITE: wanted}),
    help="Replace an existing recording.",
)

#: An option that gives the checked path of a recording to write; needs `overwrite_option`, too.
recording_option = partial(file_option, callback=_recording, metavar="RUN.mcap")


def record_option(command: Callable[P, None]) -> Callable[P, None]:
    """Add ``--record`` and ``--overwrite``; the command gets the checked path of the first only."""
    option = recording_option("--record", help="Record the run in this file.")
    return option(overwrite_option(command))


topics_argument = click.argument("topics", nargs=-1, metavar="[TOPIC]...", shell_complete=topics)

run_option = click.option(
    "--run",
    "run_dir",
    type=click.Path(path_type=Path),
    metavar="GRAPH",
    shell_complete=graphs,
    help="Launch file or run directory of the graph (needed if several run).",
)


def run_argument(name: str, offered: Offer) -> Callable[[Callable[P, None]], Callable[P, None]]:
    """Return an argument for a run, which may be left out; ``offered`` completes it."""
    kind = click.Path(path_type=Path)
    return click.argument(
        name, required=False, metavar=f"[{name.upper()}]", type=kind, shell_complete=offered
    )


@contextmanager
def slow_bar(name: str, as_json: bool) -> Iterator[Callable[[int, int], None]]:
    """Yield a function that shows progress, if it takes long and somebody looks.

    It takes what is done, and the total.
    """
    if as_json or not sys.stderr.isatty():
        yield lambda done, total: None
        return
    from forcebound.workers import progress_bar

    began = time.monotonic()
    with progress_bar(name) as show_bar:

        def tell(done: int, total: int) -> None:
            if time.monotonic() - began > SLOW:
                show_bar(done, total)

        yield tell


def show(text: str, err: bool = False) -> None:
    """Print a text that may hold names from outside: none of them reaches the terminal as it is.

    What cannot be told on standard error (a full disk) is not worth a result.
    """
    with suppress(OSError) if err else nullcontext():
        click.echo(printable(text), err=err)


def print_table(results: list[Any], labels: Sequence[str] = ()) -> None:
    """Print the key figures of some runs, one column each, headed by labels or their laws."""
    print_rows(*table_of(results, labels))


def table_of(
    results: list[Any], labels: Sequence[str] = ()
) -> tuple[Sequence[str], list[Sequence[str]]]:
    """Return head and rows of the table of some runs; see :func:`print_table`."""
    from forcebound.analysis.tables import summary_rows

    shown = []  # a run that changed its law has a column for each of them, too
    for label, result in zip(labels or [one.label for one in results], results, strict=True):
        shown.append((label, result.summary))
        for one in result.summary.get("laws", ()):
            shown.append((f"{one['law']}, from {one['start_s']:.3g} s", one))
    columns = [dict(summary_rows(summary)) for _, summary in shown]
    labels_of_rows = dict.fromkeys(label for column in columns for label in column)
    rows = [(label, *(column.get(label, "–") for column in columns)) for label in labels_of_rows]
    return ("", *(label for label, _ in shown)), list(rows)


def print_rows(
    head: Sequence[str], rows: Iterable[Sequence[str]], title: str | None = None
) -> None:
    """Print a table whose first column is flush left."""
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    def cell(text: str) -> Text:  # no markup: a name may hold brackets
        return Text(printable(text, LONGEST_CELL))

    table = Table(title=title, title_justify="left", box=None, pad_edge=False)
    table.add_column(cell(head[0]))
    for name in head[1:]:
        table.add_column(cell(name), justify="right", overflow="fold")
    for row in rows:
        table.add_row(*map(cell, row))
    console = Console()
    needed = console.measure(table, options=console.options.update(max_width=WIDEST)).maximum
    Console(width=max(console.width, needed)).print(table)


def print_json(document: Any) -> None:
    """Print one JSON document."""
    click.echo(json_text(document))


def print_json_line(document: Any) -> None:
    """Print a JSON document on one line; a number that is not finite becomes null."""
    from msgspec.json import encode

    click.echo(encode(document))


def print_document(
    document: dict[str, Any], as_json: bool, lines: Callable[[dict[str, Any]], Iterable[str]]
) -> None:
    """Print a document as JSON, or in lines for people."""
    if as_json:
        print_json(document)
    else:
        show("\n".join(lines(document)))


def json_text(document: Any) -> str:
    """Return a document as :func:`print_json` prints it."""
    return json.dumps(document, indent=2, allow_nan=False)
