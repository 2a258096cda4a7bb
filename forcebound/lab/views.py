"""Views of the rows of a campaign: groups, Markdown tables."""

from collections.abc import Iterable, Iterator, Sequence
from typing import Any

from forcebound.lab.engine import Row


def groups(rows: Iterable[Row], *keys: str) -> dict[tuple[Any, ...], list[Row]]:
    """Return the rows by their values of ``keys``, in the order in which these first occur.

    ::

        for (law,), own in groups(rows, "law").items():
            print(law, len(own))
    """
    grouped: dict[tuple[Any, ...], list[Row]] = {}
    for row in rows:
        grouped.setdefault(tuple([row.get(key) for key in keys]), []).append(row)
    return grouped


def table(heads: Sequence[str], rows: Iterable[Sequence[object]]) -> Iterator[str]:
    """Yield a table in Markdown."""
    yield f"| {' | '.join(heads)} |"
    yield "|---" * len(heads) + "|"
    for row in rows:
        yield f"| {' | '.join(map(str, row))} |"
