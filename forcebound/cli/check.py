"""Commands that check what a user wrote."""

import click

from forcebound.cli.common import (
    ARGUMENTS,
    json_option,
    print_json,
    reports_errors,
)
from forcebound.errors import RunError


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
    Exit status 1: it breaks one. How fast it answers is told, never judged.
    """
    from forcebound.launch.check import check_environment

    checked = check_environment(kind, arguments, axes, rest)
    if as_json:
        print_json(checked.document)
    else:
        click.echo("\n".join(checked.lines()))
    if not checked.passed:
        raise RunError(f"{kind} breaks its contract")
