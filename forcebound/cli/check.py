"""Commands that check a user's own parts."""

import time
from functools import partial
from typing import Any

import click

from forcebound.cli import complete
from forcebound.cli.common import (
    ARGUMENTS,
    Group,
    json_option,
    print_document,
    reports_errors,
    show,
)
from forcebound.errors import RunError

PARTS = {
    "law": "Check a bounding law; `forcebound audit` tests whether it is passive.",
    "device": "Check a device; opens it and writes zero force to hardware.",
    "operator": "Check an operator, the hand on a simulated device.",
    "controller": "Check a controller.",
    "environment": "Check an environment with some thousand queries, at random and at the limits.",
}
STATUS = """

Takes a Python file or an installed kind. Exit status 1: a promise is broken; 2: no such part, or
its code does not return."""
TIME = " Reports the time per answer without judging it; a slow environment gets fewer queries."
EXAMPLE = "\n\n\b\nforcebound check {0} my_{0}.py"

axes_option = click.option(
    "--axes",
    type=click.IntRange(1, 6),
    multiple=True,
    help="Number of axes; repeatable. Default: 1 to 6.",
)
rest_option = click.option(
    "--rest",
    multiple=True,
    metavar="POSITION=FORCE",
    help="Expected force at rest on the first axis, e.g. 0mm=0N; repeatable.",
)


class Progress:
    """Progress of a check, on standard error, every two seconds."""

    EVERY = 2.0  # s

    def __init__(self) -> None:
        self._shown_at, self._every = time.monotonic(), self.EVERY  # it may travel to a child

    def show(self, doing: str, done: int, total: int) -> None:
        """Print the progress if it is due: answers so far and in all, or the step that begins."""
        if time.monotonic() - self._shown_at < self._every:
            return
        self._shown_at = time.monotonic()
        show(f"{done} of {total} answers" if total else doing, err=True)


@click.group(cls=Group)
def check() -> None:
    """Check a part against its contract."""


def _add_command(section: str, summary: str) -> None:
    @click.argument("kind", metavar="FILE[:NAME]", shell_complete=complete.parts)
    @click.argument("arguments", nargs=-1, metavar=ARGUMENTS)
    @json_option
    @reports_errors
    def command(kind: str, arguments: tuple[str, ...], as_json: bool, **options: Any) -> None:
        from forcebound.launch.check import check_part, lines

        document = check_part(section, kind, arguments, **options, progress=Progress().show)
        print_document(document, as_json, partial(lines, section))
        if not document["passed"]:
            raise RunError(f"{kind} breaks its contract")

    text = summary + STATUS
    if section == "environment":
        command, text = axes_option(rest_option(command)), text + TIME
    check.command(section, help=text + EXAMPLE.format(section), short_help=summary)(command)


for _section, _summary in PARTS.items():
    _add_command(_section, _summary)
