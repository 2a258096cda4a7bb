"""What every command needs: groups of commands, and output for people and programs."""

import json
import os
import signal
from collections.abc import Callable, Coroutine, Iterable, Iterator
from contextlib import contextmanager, nullcontext, suppress
from functools import partial
from inspect import Parameter, signature
from typing import Any, TypeAlias, TypeVar

import click

from forcebound.cli.lazy import when_used
from forcebound.files import printable
from forcebound.stop import ending_signals

with when_used():
    import asyncio

    import msgspec

    from forcebound.graph import problems

T = TypeVar("T")
Function: TypeAlias = Callable[..., None]

UNKNOWN = "–"  # in place of a figure


class Group(click.Group):
    """A group of commands; a wrong name gets the nearest one, or all that there are."""

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Find the command that the arguments begin with."""
        name = args[0]
        if not (name in self.commands or name.startswith("-") or ctx.resilient_parsing):
            ctx.fail(problems.unknown("command", name, self.commands))
        return super().resolve_command(ctx, args)


def command(
    name: str | None = None,
    group: Any = None,
    cls: type[click.Command] = click.Command,
    **settings: Any,
) -> Callable[[Function], click.Command]:
    """Make a command from a function, and add it to a :class:`Group` if one is given.

    The defaults of the function make its parameters (:mod:`forcebound.cli.options`).
    """

    def make(function: Function) -> click.Command:
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


def show(text: str, err: bool = False) -> None:
    """Print a text that may hold names from outside: none of them reaches the terminal as it is.

    A failure to write to standard error (a full disk) does not change the exit status.
    """
    with suppress(OSError) if err else nullcontext():
        click.echo(printable(text), err=err)


#: Shows a line on standard error.
say = partial(show, err=True)


def print_json(document: Any) -> None:
    """Print one JSON document, of plain types, paths, structs and dataclasses."""
    plain = partial(msgspec.to_builtins, enc_hook=os.fspath)
    click.echo(json.dumps(document, indent=2, allow_nan=False, default=plain))


def print_json_line(document: Any) -> None:
    """Print a JSON document on one line; a number that is not finite becomes null."""
    click.echo(msgspec.json.encode(document, enc_hook=os.fspath))


def print_document(document: T, as_json: bool, lines: Callable[[T], Iterable[str]]) -> None:
    """Print a document as JSON, or in lines for people."""
    if as_json:
        print_json(document)
    else:
        show("\n".join(lines(document)))


@contextmanager
def continued(words: str = "the same command") -> Iterator[None]:
    """If the user interrupts a campaign that keeps its parts, say how it goes on."""
    try:
        yield
    except KeyboardInterrupt:
        if words:
            show(f"forcebound: {words} continues with what is left", err=True)
        raise


def run_to_signal(work: Coroutine[Any, Any, None]) -> None:
    """Run a coroutine; a signal that ends a command cancels it, and what it does then goes on.

    Raises:
        KeyboardInterrupt: When it has ended after such a signal.
    """
    before = {number: signal.getsignal(number) for number in ending_signals()}

    async def lead() -> None:
        task, loop = asyncio.current_task(), asyncio.get_running_loop()
        assert task is not None
        for number in before:  # else it would be raised anywhere, and cancel all tasks at once
            loop.add_signal_handler(number, task.cancel)
        await work

    try:
        asyncio.run(lead())
    except asyncio.CancelledError:
        raise KeyboardInterrupt from None
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
