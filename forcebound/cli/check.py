"""Commands that check what a user wrote."""

import time

import click

from forcebound.cli.common import (
    ARGUMENTS,
    json_option,
    print_json,
    reports_errors,
)
from forcebound.errors import RunError


class Progress:
    """Says every two seconds on standard error how far a check has come."""

    EVERY = 2.0  # s

    def __init__(self) -> None:
        self._said = time.monotonic()

    def show(self, doing: str, done: int, total: int) -> None:
        """Say it, if it is time: the answers until now and all of them, or else what begins."""
        if time.monotonic() - self._said < self.EVERY:
            return
        self._said = time.monotonic()
        click.echo(f"{done} of {total} answers" if total else doing, err=True)


@click.group()
def check() -> None:
    """Check a part that you wrote against what the graph expects of it."""


@check.command("environment")
@click.argument("kind", metavar="FILE[:CLASS]")
@click.argument("arguments", nargs=-1, metavar=ARGUMENTS)
@click.option(
    "--axes",
    type=click.IntRange(1, 6),
    multiple=True,
    help="Number of axes to ask with; repeat for several; 1 to 6 by default.",
)
@click.option(
    "--rest",
    multiple=True,
    metavar="POSITION=FORCE",
    help="Force expected at rest there, on the first axis, such as 0mm=0N; repeat for several.",
)
@json_option
@reports_errors
def check_environment(
    kind: str,
    arguments: tuple[str, ...],
    axes: tuple[int, ...],
    rest: tuple[str, ...],
    as_json: bool,
) -> None:
    """Check an environment: a file of yours, or a kind that comes with forcebound.

    Asks it some thousand questions, at random and at its limits; tells each promise that it breaks.
    Exit status 1: it breaks one; 2: there is no such environment, or it does not come back. How
    fast it answers is told, never judged; a slow one is asked fewer questions.
    """
    from forcebound.launch.check import check_environment, lines

    document = check_environment(kind, arguments, axes, rest, Progress().show)
    if as_json:
        print_json(document)
    else:
        click.echo("\n".join(lines(document)))
    if not document["passed"]:
        raise RunError(f"{kind} breaks its contract")
