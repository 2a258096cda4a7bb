"""What every command needs: groups of commands, and output for people and programs."""

import json
import os
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from functools import partial
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any, TypeVar

import click

from forcebound.errors import ConfigError
from forcebound.files import printable

if TYPE_CHECKING:
    from forcebound.run.screen import Screen

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


def slow_bar(name: str, as_json: bool) -> AbstractContextManager[Callable[[int, int], None]]:
    """Give a function that shows progress, if it takes long and somebody looks.

    It takes what is done, and the total.
    """
    from forcebound.run.progress import progress_bar

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


def check_tornado() -> None:
    """Raise ConfigError, with what to install, where the page's server is not installed."""
    if find_spec("tornado") is None:
        raise ConfigError("the page needs tornado: pip install 'forcebound[view]'")


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
