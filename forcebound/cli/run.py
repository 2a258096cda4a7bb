"""Commands that run a graph and show the result."""

import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click

from forcebound.cli import complete
from forcebound.cli.common import (
    all_of,
    all_option,
    arguments_argument,
    json_option,
    print_json,
    record_option,
    run_duration_option,
    show,
    show_live_run,
    show_virtual_run,
)
from forcebound.cli.view import check_tornado
from forcebound.ending import end
from forcebound.errors import ConfigError
from forcebound.files import check_writable
from forcebound.messages.topology import flat
from forcebound.roles import ENVIRONMENT

if TYPE_CHECKING:
    from forcebound.graph.graph import GraphConfig

PAGE_END_TIMEOUT_S = 15.0  # for the last message to pages, and the end of a recording


def _named_file(context: click.Context, parameter: click.Parameter, file: str | None) -> str:
    """Return FILE; without one, list the shipped launch files."""
    if file is not None:
        return file
    from forcebound.graph.document import descriptions

    known = descriptions()
    width = max(map(len, known))
    listed = "\n".join(f"  {name:{width}}  {words}" for name, words in known.items())
    message = f"Name one of your own, or one that comes with forcebound:\n\n{listed}"
    raise click.MissingParameter(message, context, parameter)


_graph_options = all_of(
    click.argument(
        "file",
        metavar="FILE",
        required=False,
        callback=_named_file,
        shell_complete=complete.launch_files,
    ),
    arguments_argument(shell_complete=complete.settings),
    run_duration_option,
    record_option,
    click.option("--check", is_flag=True, help="Only check the launch file."),
    click.option("--show-args", is_flag=True, help="List the arguments of the file."),
    all_option,
    json_option,
)


@click.command("launch", short_help="Run a launch file in real time, as processes.")
@_graph_options
@click.option(
    "--hand", "hands", multiple=True, help="Only this hand runs here; others on other machines."
)
@click.option("--view", "has_view", is_flag=True, help="Open its live page in a browser.")
def launch_graph(
    file: str,
    arguments: tuple[str, ...],
    duration: float | None,
    record: Path | None,
    check: bool,
    show_args: bool,
    shows_all: bool,
    as_json: bool,
    hands: tuple[str, ...],
    has_view: bool,
) -> None:
    r"""Run the graph of a launch file in real time, until its end or Ctrl-C.

    \b
    forcebound launch stiff_wall law:=none delay:="2 ms"
    forcebound launch pointer_wall --view
    forcebound launch my_wall.yaml --duration 60s --record run.mcap
    forcebound launch two_machines.yaml --hand left
    """
    from forcebound.graph.document import folder_of
    from forcebound.run.live import check_here

    if has_view:
        check_tornado()
    here = partial(check_here, record=record)
    config = _configuration(file, arguments, check, show_args, as_json, also=here, hands=hands)
    if config is not None:
        words = " ".join((file, *arguments, *(f"--hand {hand}" for hand in hands)))
        with _page() if has_view else nullcontext():
            folder = folder_of(Path(file))
            show_live_run(config, duration, record, as_json, shows_all, words, folder)


@contextmanager
def _page() -> Iterator[None]:
    """A page of the graph that this process launches, from a process of its own."""
    command = [sys.executable, "-m", "forcebound", "view", "--launcher", str(os.getpid())]
    show("the live page starts; its address follows", err=True)
    # Ctrl-C is for the launcher; the page ends with the graph.
    page = subprocess.Popen(command, stdout=sys.stderr, start_new_session=True)
    try:
        yield
    finally:
        end(page, PAGE_END_TIMEOUT_S)


@click.command(short_help="Run a launch file in virtual time.")
@_graph_options
@click.option("--seed", type=click.IntRange(min=0), help="Replace the seed of the launch file.")
def simulate(
    file: str,
    arguments: tuple[str, ...],
    duration: float | None,
    record: Path | None,
    seed: int | None,
    check: bool,
    show_args: bool,
    shows_all: bool,
    as_json: bool,
) -> None:
    r"""Run a launch file in virtual time: deterministic, faster than real time.

    \b
    forcebound simulate stiff_wall law:=none
    forcebound simulate stiff_wall --show-args
    forcebound simulate my_wall.yaml --record run.mcap --json
    """
    if record is not None:
        check_writable(record, "the recording")
    config = _configuration(file, arguments, check, show_args, as_json, seed)
    if config is not None:
        show_virtual_run(config, duration, record, as_json, shows_all)


@click.command(short_help="Serve a graph on another machine.")
@click.argument("name", metavar="environment")
@click.argument("file", shell_complete=complete.launch_files)
@arguments_argument(shell_complete=complete.settings)
@click.option("--run-dir", type=click.Path(path_type=Path), hidden=True, help="Of a launcher.")
def node(name: str, file: str, arguments: tuple[str, ...], run_dir: Path | None) -> None:
    r"""Run the environment of FILE for hands on other machines, as set in their sections remote:.

    \b
    forcebound node environment remote_wall
    """
    from forcebound.run.worker import run_node, serve_environment

    if run_dir is not None:  # a launcher starts its processes so
        sys.exit(run_node(name, run_dir))
    if name != ENVIRONMENT:
        raise ConfigError(f"only an environment runs by itself, got {name!r}: `forcebound launch`")
    serve_environment(Path(file), arguments)


def _configuration(
    file: str,
    arguments: tuple[str, ...],
    check: bool,
    show_args: bool,
    as_json: bool,
    seed: int | None = None,
    also: "Callable[[GraphConfig], None]" = lambda config: None,
    hands: tuple[str, ...] = (),
) -> "GraphConfig | None":
    """Return the configuration of a launch file; None if it was only checked or shown."""
    from forcebound.graph.loader import load_tried
    from forcebound.graph.resolved import to_document

    if show_args:
        _show_arguments(file, as_json)
        return None
    config = load_tried(file, arguments, _try_start if check else None)
    if seed is not None:
        config = replace(config, seed=seed)
    if hands:
        config = replace(config, here=hands)
    if not check:
        return config
    also(config)
    print_json(flat(to_document(config))) if as_json else show(f"{file}: correct")
    return None


def _try_start(config: "GraphConfig") -> None:
    from forcebound.run.trial import try_start

    try_start(config)


def _show_arguments(file: str, as_json: bool) -> None:
    from forcebound.graph.loader import arguments_of

    arguments = arguments_of(file)
    if as_json:
        print_json(arguments)
        return
    for argument in arguments:
        default = "(required)" if argument.default is None else _as_written(argument.default)
        choices = f" [{', '.join(map(_as_written, argument.choices))}]" if argument.choices else ""
        show(f"{f'{argument.name}:={default}':<26}  {argument.help}{choices}")


def _as_written(value: object) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)
