"""Command line. Heavy imports happen inside the commands that need them.

Exit status: 0 done, 1 the run failed, 2 the input was wrong, 130 Ctrl-C. With ``--json`` a command
prints one JSON document on standard output and nothing else there.
"""

import errno
import logging
import os
import sys
from typing import Any

import click

from forcebound.cli import (
    bridge,
    check,
    device,
    emulate,
    graph,
    identify,
    keys,
    look,
    record,
    recordings,
    run,
    start,
    study,
    topics,
    view,
)
from forcebound.cli.common import INTERRUPTED, LONGEST_CELL, Group, print_table, show
from forcebound.files import printable

__all__ = ["main", "print_table"]

COMMANDS = (
    run.launch_graph,
    run.simulate,
    run.node,
    run.plot,
    record.record,
    recordings.export,
    recordings.recover,
    recordings.replay,
    run.schema,
    start.new,
    start.completion,
    graph.stop,
    graph.start,
    graph.param,
    graph.outage,
    view.view,
    look.list_graphs,
    look.top,
    look.doctor,
    topics.echo,
    topics.hz,
    topics.bw,
    topics.draw_graph,
    topics.delay,
    topics.log,
    bridge.bridge,
    study.bench,
    study.audit,
    study.reproduce,
    study.sweep,
    study.draw_map,
    keys.keys_group,
    check.check,
    identify.identify,
    device.device_group,
    emulate.emulate,
)


#: What may befall any write, and is nobody's mistake.
NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO)


class _Group(Group):
    """A group of commands that Ctrl-C ends quietly, wherever it comes, and so does a full disk."""

    def main(self, *args: Any, **kwargs: Any) -> Any:
        try:
            return super().main(*args, **kwargs)
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
    for part in getattr(command, "commands", {}).values():
        _keep_lines(part)


for _command in COMMANDS:
    main.add_command(_command)
_keep_lines(main)
