"""Command line. The module of a command is imported when the command is called.

Exit status: 0 done, 1 the run failed, 2 the input was wrong, 130 Ctrl-C. With ``--json`` a command
prints one JSON document on standard output and nothing else there.
"""

import errno
import logging
import os
import sys
from collections import UserDict
from importlib import import_module
from typing import Any

import click
from click.shell_completion import CompletionItem, add_completion_class

from forcebound.cli.common import Group, command, show
from forcebound.cli.complete import Bash, Zsh
from forcebound.errors import ConfigError, ForceboundError
from forcebound.files import printable
from forcebound.results.printing import LONGEST_CELL
from forcebound.stop import INTERRUPTED

__all__ = ["main"]

#: Distributions whose commands come as entry points; the former is this one.
LAB, PROOFS = "forcebound", "forcebound-proofs"
ENTRY_POINTS = "forcebound.commands"

#: Commands in the order of the help, under what they are for: the module of each, with its function
#: if that has another name, or the distribution that has it; and a line for the help.
COMMANDS = {
    "Run a graph": {
        "demo": ("demo", "Press a simulated hand into a wall, live, in 20 s."),
        "launch": ("run", "Run a launch file in real time, as processes."),
        "simulate": ("run", "Run a launch file in virtual time."),
        "node": ("node", "Serve a graph on another machine."),
        "new": ("start", "Make a folder to begin with."),
    },
    "Look at a running graph": {
        "view": ("view", "Open a live page of the running graph."),
        "list": ("look:list_graphs", "List the graphs that run here, with their nodes."),
        "graph": ("topics", "Show the graph with its measured rates."),
        "echo": ("topics", "Print the packets of a topic."),
        "hz": ("topics", "Measure how often topics are sent, and their bytes."),
        "delay": ("topics", "Show the loop delay of a recording or graph."),
        "log": ("topics", "Print events of a graph as they come."),
        "doctor": ("look", "Diagnose the running graph, or this machine if none runs."),
        "bridge": ("topics", "Show a running graph in another program."),
    },
    "Change a running graph": {
        "param": ("change", "Show and change parameters of a running graph."),
        "stop": ("change", "Stop a node: zero force."),
        "start": ("change", "Start a node that was stopped."),
        "outage": ("change", "Cut a link from now for a time."),
        "episode": ("change", "Start, keep or discard episodes of a recording."),
    },
    "Recordings": {
        "record": ("recordings", "Record a running graph from now on."),
        "plot": ("recordings", "Draw recordings side by side."),
        "export": ("recordings", "Write recordings as tables, or as a data set."),
        "replay": (LAB, "Verify a recording, or run it once more with other parts."),
        "recover": ("recordings", "Make a complete recording of a cut one."),
    },
    "Devices, and parts of your own": {
        "device": ("parts", "List serial ports; go on with a lost device."),
        "emulate": ("parts", "Play a device on a pseudo-terminal, or as a service."),
        "feel": (LAB, "Forecast the stiffness that a hand will feel on a device."),
        "identify": (LAB, "Measure the numbers that a device's certificate rests on."),
        "check": ("parts", "Check a part against its contract."),
    },
    "Studies": {
        "sweep": (LAB, "Run a graph over a grid of its parameters."),
        "map": (LAB, "Draw the map of a sweep's result."),
        "audit": (PROOFS, "Attack the laws in simulation."),
        "league": (PROOFS, "Compare the methods of the field on equal terms."),
        "reproduce": (PROOFS, "Repeat the paper's experiments."),
        "study": (LAB, "Run a study with people, or simulated observers."),
    },
    "This machine": {
        "completion": ("start", "Let the Tab key complete commands and arguments."),
        "keys": ("start", "Create and show the keys for a link to another machine."),
        "schema": ("start", "Print the JSON schema of launch files."),
    },
}
#: The same by the names of commands.
PLACES = {name: place for commands in COMMANDS.values() for name, place in commands.items()}

#: Errors of any write that are no bugs.
NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO)


class _Commands(UserDict[str, Any]):
    """Commands by name, each imported when it is asked for."""

    def __getitem__(self, name: str) -> Any:
        place, _ = PLACES[name]
        if place in (LAB, PROOFS):
            return _of_entry_point(name, place)
        module, _, function = place.partition(":")
        made = getattr(import_module(f"forcebound.cli.{module}"), function or name)
        return made if isinstance(made, click.Command) else command(name)(made)


def _of_entry_point(name: str, distribution: str) -> click.Command:
    """Return a command that lies above the command line, or in another distribution."""
    from importlib.metadata import entry_points

    for found in entry_points(group=ENTRY_POINTS, name=name):
        made = found.load()
        return made if isinstance(made, click.Command) else command(name)(made)
    raise ConfigError(f"the command {name} needs {distribution}: pip install {distribution}")


class _Group(Group):
    """The group of all commands: what ends one gives a message and the exit status."""

    def format_commands(self, _: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the commands under what they are for."""
        width = max(map(len, self.commands))
        for purpose, commands in COMMANDS.items():
            rows = [(f"{name:{width}}", words) for name, (_, words) in commands.items()]
            with formatter.section(purpose):
                formatter.write_dl(rows)

    def shell_complete(self, ctx: click.Context, incomplete: str) -> list[CompletionItem]:
        """Offer the commands, none of which is imported for that."""
        known = [CompletionItem(name, help=words) for name, (_, words) in PLACES.items()]
        offered = [one for one in known if one.value.startswith(incomplete)]
        return offered + click.Command.shell_complete(self, ctx, incomplete)

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


@click.group(
    cls=_Group,
    commands=_Commands(PLACES),
    context_settings={"help_option_names": ["-h", "--help"]},
)
@click.version_option(package_name="forcebound", prog_name="forcebound")
def main() -> None:
    """Force feedback over a network that provably stays passive."""
    handler = logging.StreamHandler()
    handler.setFormatter(_Printable("%(levelname)s %(name)s: %(message)s"))
    logging.basicConfig(handlers=[handler], level=logging.INFO)


add_completion_class(Bash)
add_completion_class(Zsh)
