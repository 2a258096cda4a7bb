"""Command line. Heavy imports happen inside the commands that need them.

Exit status: 0 done, 1 the run failed, 2 the input was wrong, 130 Ctrl-C. With ``--json`` a command
prints one JSON document on standard output and nothing else there.
"""

import logging
from typing import Any

import click

from forcebound.cli import check, emulate, graph, keys, run, study
from forcebound.cli.common import INTERRUPTED, print_table
from forcebound.files import printable

__all__ = ["main", "print_table"]

COMMANDS = (
    run.launch_graph,
    run.simulate,
    run.node,
    run.plot,
    run.schema,
    graph.stop,
    graph.start,
    graph.param,
    graph.delay,
    graph.doctor,
    study.bench,
    study.audit,
    study.reproduce,
    study.sweep,
    study.draw_map,
    keys.keys_group,
    check.check,
    emulate.emulate,
)


class _Group(click.Group):
    """A group of commands that Ctrl-C ends quietly, wherever it comes."""

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


for _command in COMMANDS:
    main.add_command(_command)
