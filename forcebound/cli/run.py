"""Commands that run a graph and show the result."""

import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import replace
from functools import partial
from pathlib import Path

import click

from forcebound.cli import complete
from forcebound.cli import options as opt
from forcebound.cli.common import print_document, print_json, show
from forcebound.cli.lazy import when_used
from forcebound.cli.outcome import show_run
from forcebound.ending import end
from forcebound.extras import check_installed
from forcebound.files import check_writable

with when_used():
    from forcebound.graph import document as files
    from forcebound.graph import graph, loader, resolved
    from forcebound.messages import topology
    from forcebound.run import fork_server, live, trial

PAGE_END_TIMEOUT_S = 15.0  # for the last message to pages, and the end of a recording


def _named_file(context: click.Context, parameter: click.Parameter, file: str | None) -> str:
    """Return FILE; without one, list the shipped launch files in groups."""
    if file is not None or context.resilient_parsing:  # of completion
        return file or ""
    known = files.descriptions()
    width = max(len(name) for group in known.values() for name in group)
    listed = "\n\n".join(
        "\n".join((f"{group}:", *(f"  {name:{width}}  {one}" for name, one in named.items())))
        for group, named in known.items()
    )
    message = f"Name one of your own, or one that comes with forcebound:\n\n{listed}"
    raise click.MissingParameter(message, context, parameter)


_file = opt.argument(complete.launch_files, metavar="FILE", required=False, callback=_named_file)
_check = opt.flag("Only check the launch file.")
_show_args = opt.flag("List the arguments of the file.")


def launch(
    file: str = _file,
    arguments: tuple[str, ...] = opt.file_settings,
    duration: float | None = opt.run_duration,
    record: Path | None = opt.record,
    check: bool = _check,
    show_args: bool = _show_args,
    shows_all: bool = opt.shows_all,
    as_json: bool = opt.as_json,
    hands: tuple[str, ...] = opt.repeated(
        "Only this hand runs here; others on other machines.", "--hand"
    ),
    has_view: bool = opt.flag("Open its live page in a browser.", "--view"),
) -> None:
    r"""Run the graph of a launch file in real time, until its end or Ctrl-C.

    \b
    forcebound launch stiff_wall law:=none delay:="2 ms"
    forcebound launch pointer_wall --view
    forcebound launch my_wall.yaml --duration 60s --record run.mcap
    forcebound launch two_machines.yaml --hand left
    """
    if has_view:
        check_installed("the page", "tornado")
    also = partial(live.check_here, record=record)
    with nullcontext() if check or show_args else fork_server.fork_server() as server:
        config = _configuration(file, arguments, check, show_args, as_json, hands=hands, also=also)
        if config is not None:
            words = " ".join((file, *arguments, *(f"--hand {hand}" for hand in hands)))
            with _page() if has_view else nullcontext():
                folder = files.folder_of(Path(file))
                show_run(config, duration, record, as_json, shows_all, words, folder, server)


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


def simulate(
    file: str = _file,
    arguments: tuple[str, ...] = opt.file_settings,
    duration: float | None = opt.run_duration,
    record: Path | None = opt.record,
    check: bool = _check,
    show_args: bool = _show_args,
    shows_all: bool = opt.shows_all,
    as_json: bool = opt.as_json,
    seed: int | None = opt.option("Replace the seed of the launch file.", type=opt.NUMBER),
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
        show_run(config, duration, record, as_json, shows_all)


def _configuration(
    file: str,
    arguments: tuple[str, ...],
    check: bool,
    show_args: bool,
    as_json: bool,
    seed: int | None = None,
    hands: tuple[str, ...] = (),
    also: "Callable[[graph.GraphConfig], None]" = lambda config: None,
) -> "graph.GraphConfig | None":
    """Return the configuration of a launch file; None if it was only checked or shown."""
    if show_args:
        _show_arguments(file, as_json)
        return None
    config = loader.load_tried(file, arguments, trial.try_start if check else None)
    if seed is not None:
        config = replace(config, seed=seed)
    if hands:
        config = replace(config, here=hands)
    if not check:
        return config
    also(config)
    document = topology.flat(resolved.to_document(config))
    print_document(document, as_json, lambda _: [f"{file}: correct"])
    return None


def _show_arguments(file: str, as_json: bool) -> None:
    arguments = loader.arguments_of(file)
    if as_json:
        print_json(arguments)
        return
    for argument in arguments:
        default = "(required)" if argument.default is None else _as_written(argument.default)
        choices = f" [{', '.join(map(_as_written, argument.choices))}]" if argument.choices else ""
        show(f"{f'{argument.name}:={default}':<26}  {argument.help}{choices}")


def _as_written(value: object) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)
