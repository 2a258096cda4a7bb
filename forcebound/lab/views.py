"""Views of the rows of a campaign: groups, Markdown tables, verdicts, pages."""

import platform
from collections.abc import Iterable, Iterator, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

from forcebound.errors import ConfigError
from forcebound.files import check_writable, reason
from forcebound.haptics.laws import ENERGY_TOLERANCE
from forcebound.lab.engine import Row


def groups(rows: Iterable[Row], *keys: str) -> dict[tuple[Any, ...], list[Row]]:
    """Return the rows by their values of ``keys``, in the order in which these first occur.

    ::

        for (law,), own in groups(rows, "law").items():
            print(law, least(own, "true_energy_min_j")["over.delay"])
    """
    grouped: dict[tuple[Any, ...], list[Row]] = {}
    for row in rows:
        grouped.setdefault(tuple([row.get(key) for key in keys]), []).append(row)
    return grouped


def least(rows: Sequence[Row], key: str) -> Row:
    """Return the row with the lowest value of ``key``; of equal ones the first."""
    return min(rows, key=lambda row: float(row[key]))


def share(rows: Sequence[Row], key: str) -> float:
    """Return the share of the rows in which ``key`` is true."""
    return sum(bool(row[key]) for row in rows) / len(rows)


def table(heads: Sequence[str], rows: Iterable[Sequence[object]]) -> Iterator[str]:
    """Yield a table in Markdown."""
    yield f"| {' | '.join(heads)} |"
    yield "|---" * len(heads) + "|"
    for row in rows:
        yield f"| {' | '.join(map(str, row))} |"


def verdict(lowest: float, is_certified: bool = True) -> str:
    """Return the verdict on a law whose lowest energy, in J, is this."""
    leaks = lowest < -ENERGY_TOLERANCE
    if is_certified:
        return "BROKEN" if leaks else "passive"
    return "leaks" if leaks else "no leak found, none excluded"


def origin(command: str) -> str:
    """Return the lines of a page that say which command made it, and where."""
    machine = f"{platform.system()} {platform.machine()}"
    return f"    {command}\n\nmade this page (forcebound {version('forcebound')}, {machine})."


def check_page(page: Path | None) -> None:
    """Check, before the work begins, that a page can be written.

    Raises:
        ConfigError: If it cannot.
    """
    if page is None:
        return
    if page.suffix != ".md":
        raise ConfigError(f"the page must end in .md, got {page.name!r}")
    check_writable(page, "the page")


def write_page(page: Path | None, lines: Iterable[str]) -> None:
    """Write a page, if one is asked for.

    Raises:
        ConfigError: If it cannot be written.
    """
    if page is None:
        return
    try:
        page.write_text("\n".join(lines) + "\n", encoding="utf-8")
    except OSError as error:
        raise ConfigError(f"cannot write the page {page}: {reason(error)}") from error
