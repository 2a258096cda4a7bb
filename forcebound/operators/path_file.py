"""A hand's path in a file: a CSV table of numbers under one header line."""

import reprlib
from collections.abc import Iterator
from pathlib import Path

from forcebound.errors import ConfigError
from forcebound.files import read_rows

LARGEST = 1e10  # s or m; far beyond any path, and its square is still a number


def read_numbers(
    file: Path, what: str, expected: str, fewest: int, most: int
) -> Iterator[tuple[str, list[float]]]:
    """Yield the numbers of each line under the header, with its place, ``file.csv:3``.

    Args:
        file: To read.
        what: Name of the file for messages, such as "the trajectory".
        expected: What a line should be, for messages.
        fewest: Columns, at least.
        most: Columns, at most.

    Raises:
        ConfigError: If the file cannot be read, has no line of numbers, or one that is no such
            line; names the line.
    """
    rows = read_rows(file, what)
    _, head = next(rows, ("", []))
    is_empty = True
    for place, row in rows:
        got = reprlib.repr(",".join(row))
        try:
            values = [float(cell) for cell in row]
        except ValueError:
            raise ConfigError(f"{place}: expected {expected}, got {got}") from None
        if not fewest <= len(values) <= most or len(values) != len(head):
            raise ConfigError(f"{place}: expected {expected}, got {len(values)} columns")
        if not all(abs(value) <= LARGEST for value in values):
            raise ConfigError(f"{place}: expected numbers within {LARGEST:g}, got {got}")
        yield place, values
        is_empty = False
    if is_empty:
        raise ConfigError(f"{file}: expected {expected}, got no line of numbers")
