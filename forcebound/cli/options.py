"""Parameters of commands, each named, typed and described in the signature, as its default.

::

    def outage(time: str = argument(), run: Path = run, twice: bool = flag("Two times.")) -> None:
"""

from collections.abc import Callable
from functools import partial, reduce
from pathlib import Path
from typing import Any

import click

from forcebound.cli import complete
from forcebound.cli.common import Function
from forcebound.cli.lazy import when_used
from forcebound.errors import ConfigError
from forcebound.files import recording_file

with when_used():
    from forcebound import quantities, units
    from forcebound.observe import runs

PATH = click.Path(path_type=Path)
FILE = click.Path(path_type=Path, dir_okay=False)
FOLDER = click.Path(path_type=Path, file_okay=False)
COUNT = click.IntRange(min=1)
NUMBER = click.IntRange(min=0)


def option(words: str, *names: str, **settings: Any) -> Any:
    """Return an option with this help; without names, ``--`` and the name of its parameter.

    It takes the name of the parameter, and gives a function's decorator.
    """

    def add(name: str) -> Callable[[Function], Function]:
        given = names or (f"--{name.replace('_', '-')}",)
        return click.option(*given, name, help=words, **settings)

    return add


def argument(offers: complete.Offer | None = None, **settings: Any) -> Any:
    """Return an argument, as :func:`option`, and what a shell offers for it."""
    return lambda name: click.argument(name, shell_complete=offers, **settings)


def arguments(metavar: str, offers: complete.Offer | None = None, **settings: Any) -> Any:
    """Return an argument of any number of values."""
    return argument(offers, nargs=-1, metavar=metavar, **settings)


def several(**parameters: Any) -> Callable[[Function], Function]:
    """Return a decorator of parameters by their names: those of ``**`` in a signature."""
    rows = reversed(parameters.items())
    return lambda function: reduce(lambda made, row: row[1](row[0])(made), rows, function)


def seconds(text: str) -> float:
    """Return a time with its unit in s; the type of an option."""
    try:
        return quantities.Range(above=0).check(units.parse_quantity(text, "s"), "s")
    except ConfigError as error:
        raise click.BadParameter(str(error)) from None


flag = partial(option, is_flag=True)
repeated = partial(option, multiple=True)
number = partial(option, type=NUMBER, show_default=True)
duration = partial(option, type=seconds, metavar="TIME")
file = partial(option, type=FILE)
port = partial(option, type=click.IntRange(0, 65535), default=0)


def output(words: str, default: Path | None = None, **settings: Any) -> Any:
    """Return an option for a file to write, or for what ``type`` says."""
    given = {"type": FILE, "default": default, "show_default": default is not None, **settings}
    return option(words, "-o", "--output", **given)


folder = partial(output, type=FOLDER)


def recording(words: str, *names: str, **settings: Any) -> Any:
    """Return an option for a recording to write, and ``--overwrite``, without which none goes."""

    def check(context: click.Context, _: click.Parameter, path: Path | None) -> Path | None:
        overwrite = context.params.pop("overwrite")
        if path is None:
            return None
        try:
            recording_file(path)
        except ConfigError as error:
            raise click.BadParameter(str(error)) from None
        if path.exists() and path.stat().st_size > 0 and not overwrite:
            raise click.BadParameter(f"{path} exists: choose another name, or add --overwrite")
        return path

    written = file(words, *names, callback=check, metavar="RUN.mcap", **settings)
    # Eager: read before the name of the recording, in any order on the command line.
    overwrite = flag("Replace an existing recording.", is_eager=True)
    return lambda name: several(**{name: written, "overwrite": overwrite})


def running(require_graph: bool, named: str = "--run GRAPH") -> Callable[..., Path]:
    """Return a callback that finds the run of a graph which is meant; it ends with the graph."""

    def find_run(context: click.Context, _: click.Parameter, run: Path | None) -> Path:
        run_dir = runs.find(run, require_graph=require_graph, option=named)
        context.with_resource(runs.while_running(run_dir))
        return run_dir

    return find_run


_run = partial(
    option,
    "Launch file or run directory of the graph (needed if several run).",
    type=PATH,
    metavar="GRAPH",
    shell_complete=complete.graphs,
)
#: GRAPH as given; the directory of a run; that of a run which is more than an environment.
given_run = _run()
run = _run(callback=running(require_graph=False))
graph = _run(callback=running(require_graph=True))
as_json = flag("Print one JSON document.", "--json")
as_json_lines = flag("Print one JSON document per line.", "--json")
shows_all = flag("Print the table of all figures, too.", "--all")
run_duration = duration("Duration of the run, e.g. 5s or 500ms.")
ending = duration("Time after which it ends. Default: with the graph.")
record = recording("Record the run in this file.")
hand = option(
    "Only this hand, if there are several.", metavar="NAME", shell_complete=complete.hands
)
settings = arguments("[NAME:=VALUE]...")
file_settings = arguments("[NAME:=VALUE]...", complete.settings)
workers = option("Number of processes; 0: only this one. Default: one per core.", type=NUMBER)
opens = option("Whether to open a browser.", "--open/--no-open", default=True)
