"""Commands that check a user's own parts."""

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
    """Progress of a check, on standard error, every two seconds."""

    EVERY = 2.0  # s

    def __init__(self) -> None:
        self._shown_at = time.monotonic()

    def show(self, doing: str, done: int, total: int) -> None:
        """Print the progress if it is due: answers so far and in all, or the step that begins."""
        if time.monotonic() - self._shown_at < self.EVERY:
            return
        self._shown_at = time.monotonic()
        click.echo(f"{done} of {total} answers" if total else doing, err=True)


@click.group()
def check() -> None:
    """Check a part against its contract."""


@check.command("environment")
@click.argument("kind", metavar="FILE[:CLASS]")
@click.argument("arguments", nargs=-1, metavar=ARGUMENTS)
@click.option(
    "--axes",
    type=click.IntRange(1, 6),
    multiple=True,
    help="Number of axes; repeatable. Default: 1 to 6.",
)
@click.option(
    "--rest",
    multiple=True,
    metavar="POSITION=FORCE",
    help="Expected force at rest on the first axis, e.g. 0mm=0N; repeatable.",
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
    """Check an environment: a Python file, or an installed kind.

    Sends some thousand queries, at random and at the limits, and reports each broken promise.
    Reports the time per answer without judging it; a slow environment gets fewer queries. Exit
    status 1: a promise is broken; 2: no such environment, or its code does not return.
    """
    from forcebound.launch.check import check_environment, lines

    document = check_environment(kind, arguments, axes, rest, Progress().show)
    if as_json:
        print_json(document)
    else:
        click.echo("\n".join(lines(document)))
    if not document["passed"]:
        raise RunError(f"{kind} breaks its contract")


def _add_command(section: str, summary: str) -> None:
    @check.command(section, help=summary, short_help=summary.partition("\n")[0])
    @click.argument("kind", metavar="FILE[:NAME]")
    @click.argument("arguments", nargs=-1, metavar=ARGUMENTS)
    @json_option
    @reports_errors
    def command(kind: str, arguments: tuple[str, ...], as_json: bool) -> None:
        from forcebound.launch.check import PROMISES_OF, check_part, promise_lines

        document = check_part(section, kind, arguments)
        if as_json:
            print_json(document)
        else:
            click.echo("\n".join(promise_lines(document, PROMISES_OF[section])))
        if not document["passed"]:
            raise RunError(f"{kind} breaks its contract")


_STATUS = """

Takes a Python file or an installed kind. Exit status 1: a promise is broken; 2: no such part, or
its code does not return."""

_add_command(
    "law", "Check a bounding law; `forcebound audit` tests whether it is passive." + _STATUS
)
_add_command("device", "Check a device; opens it and writes zero force to hardware." + _STATUS)
_add_command("operator", "Check an operator, the hand on a simulated device." + _STATUS)
_add_command("controller", "Check a controller." + _STATUS)
