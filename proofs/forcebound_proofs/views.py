"""Views of the rows of attacks and studies: the least of them, verdicts, pages."""

import platform
from collections.abc import Iterable, Sequence
from importlib.metadata import version
from pathlib import Path

from forcebound.errors import ConfigError
from forcebound.files import check_writable, reason
from forcebound.haptics.laws import ENERGY_TOLERANCE
from forcebound.lab.engine import Row


def least(rows: Sequence[Row], key: str) -> Row:
    """Return the row with the lowest value of ``key``; of equal ones the first."""
    return min(rows, key=lambda row: float(row[key]))


def share(rows: Sequence[Row], key: str) -> float:
    """Return the share of the rows in which ``key`` is true."""
    return sum(bool(row[key]) for row in rows) / len(rows)


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
