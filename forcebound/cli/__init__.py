"""Command line. Heavy imports happen inside the commands that need them.

Exit status: 0 done, 1 the run failed, 2 the input was wrong, 130 Ctrl-C. With ``--json`` a command
prints one JSON document on standard output and nothing else there.
"""

import errno
import logging
import os
import sys
from itertools import chain
from typing import Any

import click

from forcebound.cli import (
    change,
    demo,
    look,
    parts,
    recordings,
    run,
    start,
    study,
    topics,
    user_study,
    view,
)
from forcebound.cli.common import Group, show
from forcebound.errors import ConfigError, ForceboundError
from forcebound.files import printable
from forcebound.results.printing import LONGEST_CELL
from forcebound.stop import INTERRUPTED

__all__ = ["main"]

#: Commands in the order of the help, under what they are for.
COMMANDS: dict[str, tuple[click.Command, ...]] = {
    "Run a graph": (demo.demo, run.launch_graph, run.simulate, run.node, start.new),
    "Look at a running graph": (
        view.view,
        look.list_graphs,
        topics.draw_graph,
        topics.echo,
        topics.hz,
        topics.delay,
        topics.log,
        look.doctor,
        topics.bridge,
    ),
    "Change a running graph": (change.param, change.stop, change.start, change.outage),
    "Recordings": (
        recordings.record,
        recordings.plot,
        recordings.export,
        recordings.replay,
        recordings.recover,
    ),
    "Devices, and parts of your own": (parts.device, parts.emulate, parts.identify, parts.check),
    "Studies": (study.sweep, study.draw_map, study.audit, study.reproduce, user_study.study),
    "This machine": (start.completion, start.keys, start.schema),
}

LONGEST_HELP = 64  # characters, beside the name of a command on 80

#: Errors of any write that are no bugs.
NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO)


class _Group(Group):
    """The group of all commands: what ends one gives a message and the exit status."""

    def format_commands(self, _: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the commands under what they are for."""
        width = max(map(len, self.commands))
        for purpose, commands in COMMANDS.items():
            rows = [
                (f"{one.name:{width}}", one.get_short_help_str(LONGEST_HELP)) for one in commands
            ]
            with formatter.section(purpose):
                formatter.write_dl(rows)

    def main(self, *args: Any, **kwargs: Any) -> Any:
        try:
            return super().main(*args, **kwargs)
        except ForceboundError as error:  # bugs keep their traceback
            show(f"forcebound: {error}", err=True)
            sys.exit(2 if isinstance(error, ConfigError) else 1)
        except OSError as error:
            is_full = error.errno in NO_ROOM
            if error.filename is None and not is_full:
                raise
            where = "cannot write" if is_full else printable(str(error.filename), LONGEST_CELL)
            show(f"forcebound: {where}: {error.strerror}", err=True)
            if is_full:  # or what is still to be written would be tried again at the end
                os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            sys.exit(1 if is_full else 2)

    def invoke(self, ctx: click.Context) -> Any:
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt:
            click.echo("forcebound: interrupted", err=True)
            ctx.exit(INTERRUPTED)


class _Printable(logging.Formatter):
    """Formats log lines: names from outside do not reach the terminal as they are."""

    def format(self, record: logging.LogRecord) -> str:
        return printable(super().format(record))


@click.group(cls=_Group, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="forcebound", prog_name="forcebound")
def main() -> None:
    """Force feedback over a network that provably stays passive."""
    handler = logging.StreamHandler()
    handler.setFormatter(_Printable("%(levelname)s %(name)s: %(message)s"))
    logging.basicConfig(handlers=[handler], level=logging.INFO)


def _keep_lines(command: click.Command) -> None:
    """Let the help keep the lines of examples: raw docstrings spell click's mark in two letters."""
    command.help = (command.help or "").replace("\\b\n", "\b\n")
    for part in command.commands.values() if isinstance(command, click.Group) else ():
        _keep_lines(part)


for _command in chain.from_iterable(COMMANDS.values()):
    main.add_command(_command)
_keep_lines(main)
