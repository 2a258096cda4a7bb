"""Parameters of commands, each named, typed and described in the signature, as its default.

::

    @command()
    def outage(time: str = argument(), run: Path = run, twice: bool = flag("Two times.")) -> None:
"""

from collections.abc import Callable
from functools import partial, reduce
from inspect import Parameter, signature
from pathlib import Path
from typing import Any, TypeAlias, TypeVar

import click

from forcebound.cli import complete
from forcebound.errors import ConfigError
from forcebound.files import recording_file
from forcebound.quantities import Range
from forcebound.units import parse_quantity

PATH = click.Path(path_type=Path)
FILE = click.Path(path_type=Path, dir_okay=False)
FOLDER = click.Path(path_type=Path, file_okay=False)
COUNT = click.IntRange(min=1)
NUMBER = click.IntRange(min=0)
PORT = click.IntRange(0, 65535)

Made = TypeVar("Made", bound=click.Command)
Function: TypeAlias = Callable[..., None]


def command_of(
    cls: type[Made], name: str | None = None, group: click.Group | None = None, **settings: Any
) -> Callable[[Function], Made]:
    """Make a command of this class from a function, and add it to a group if one is given.

    Its parameters are in the help in the order of the signature.
    """

    def make(function: Function) -> Made:
        for parameter in reversed([*signature(function).parameters.values()]):
            if parameter.default is not Parameter.empty:
                function = parameter.default(parameter.name)(function)
        # Examples keep their lines by click's mark, which a raw docstring spells in two letters.
        words = (function.__doc__ or "").replace("\\b\n", "\b\n")
        made = click.command(name, cls, help=words, **settings)(function)
        if group is not None:
            group.add_command(made)
        return made

    return make


command = partial(command_of, click.Command)


def option(words: str, *names: str, **settings: Any) -> Any:
    """Return an option with this help; without names, ``--`` and the name of its parameter.

    It takes the name of the parameter, and gives a function's decorator.
    """

    def add(name: str) -> Callable[[Function], Function]:
        given = names or (f"--{name.replace('_', '-')}",)
        return click.option(*given, name, help=words, **settings)

    return add


def argument(**settings: Any) -> Any:
    """Return an argument, as :func:`option`."""
    return lambda name: click.argument(name, **settings)


def several(**parameters: Any) -> Callable[[Function], Function]:
    """Return a decorator of parameters by their names: those of ``**`` in a signature."""
    rows = reversed(parameters.items())
    return lambda function: reduce(lambda made, row: row[1](row[0])(made), rows, function)


def seconds(text: str) -> float:
    """Return a time with its unit in s; the type of an option."""
    try:
        return Range(above=0).check(parse_quantity(text, "s"), "s")
    except ConfigError as error:
        raise click.BadParameter(str(error)) from None


flag = partial(option, is_flag=True)
repeated = partial(option, multiple=True)
number = partial(option, type=NUMBER, show_default=True)
duration = partial(option, type=seconds, metavar="TIME")
arguments = partial(argument, nargs=-1)


def output(words: str, **settings: Any) -> Any:
    """Return an option for a file to write, or for what ``type`` says."""
    return option(words, "-o", "--output", **{"type": FILE, **settings})


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

    file = option(words, *names, type=FILE, callback=check, metavar="RUN.mcap", **settings)
    # Eager: read before the name of the recording, in any order on the command line.
    overwrite = flag("Replace an existing recording.", is_eager=True)
    return lambda name: several(**{name: file, "overwrite": overwrite})


def _running(require_graph: bool) -> Callable[..., Path]:
    def find_run(context: click.Context, _: click.Parameter, run: Path | None) -> Path:
        from forcebound.observe.runs import find, while_running  # not for each command

        run_dir = find(run, require_graph=require_graph)
        context.with_resource(while_running(run_dir))
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
run = _run(callback=_running(require_graph=False))
graph = _run(callback=_running(require_graph=True))
as_json = flag("Print one JSON document.", "--json")
as_json_lines = flag("Print one JSON document per line.", "--json")
shows_all = flag("Print the table of all figures, too.", "--all")
run_duration = duration("Duration of the run, e.g. 5s or 500ms.")
ending = duration("Time after which it ends. Default: with the graph.")
record = recording("Record the run in this file.")
hand = option(
    "Only this hand, if there are several.", metavar="NAME", shell_complete=complete.hands
)
settings = arguments(metavar="[NAME:=VALUE]...")
file_settings = arguments(metavar="[NAME:=VALUE]...", shell_complete=complete.settings)
topics = arguments(metavar="[TOPIC]...", shell_complete=complete.topics)
workers = option("Number of processes; 0: only this one. Default: one per core.", type=NUMBER)
opens = option("Whether to open a browser.", "--open/--no-open", default=True)
