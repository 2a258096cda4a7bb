"""Tables printed in a terminal."""

import sys
from collections.abc import Iterable, Sequence

from forcebound.files import printable

LONGEST_CELL = 500  # characters


def print_rows(
    head: Sequence[str],
    rows: Iterable[Sequence[str]],
    title: str | None = None,
    flush_left: int = 1,
) -> None:
    """Print a table whose first columns are flush left, all of them or so many."""
    from tabulate import tabulate

    table = [[printable(cell, LONGEST_CELL) for cell in row] for row in (head, *rows)]
    sides = ["left"] * flush_left + ["right"] * (len(head) - flush_left)
    shown = tabulate(
        table[1:], table[0], "plain", disable_numparse=True, colalign=sides[: len(head)]
    )
    sys.stdout.write(f"{title}\n{shown}\n" if title else f"{shown}\n")
