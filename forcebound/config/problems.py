"""Problems of a launch file: all at once, each with its place.

A problem reads like a compiler's message, so that editors can jump to it::

    stiff_wall.yaml:31:14: unknown environment kind 'wal'; did you mean 'wall'?
       31 |     kind: wal
          |           ^
"""

import difflib
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from forcebound.errors import ConfigError

MAX_PROBLEMS = 100  # enough to read; thousands would take minutes to word

_WIDEST_EXCERPT = 100  # characters of a source line that are shown
_LONGEST_MESSAGE = 2000  # characters
_MOST_NAMES = 200  # that a message lists, or looks through for the nearest


@dataclass(frozen=True, slots=True)
class Place:
    """Where a value was written.

    Attributes:
        name: File, or what else it came from: ``argument law:=none``, ``document: device.law``.
        line: Counts from 1; 0 if the place has no lines.
        column: Counts from 1, in characters.
        text: The line itself.
    """

    name: str
    line: int = 0
    column: int = 0
    text: str = ""

    def __str__(self) -> str:
        return f"{self.name}:{self.line}:{self.column}" if self.line else self.name

    def excerpt(self) -> list[str]:
        """Return the source line and a caret below; nothing for a place without lines."""
        if not self.line:
            return []
        first = max(0, self.column - 1 - _WIDEST_EXCERPT // 2)
        shown = self.text[first : first + _WIDEST_EXCERPT]
        shown = "".join(char if char.isprintable() else " " for char in shown)
        caret = " " * (self.column - 1 - first) + "^"
        return [f"{self.line:5} | {shown.rstrip()}", f"      | {caret}"]


@dataclass(frozen=True, slots=True)
class Related:
    """A second place that a message points to, and what it has to do with it."""

    words: str  # such as "used at"
    place: Place


@dataclass(frozen=True, slots=True)
class Problem:
    """One thing that is wrong."""

    message: str
    place: Place
    related: Related | None = None

    def __str__(self) -> str:
        message = self.message
        if not self.place.line:  # then the place's name ends with that of the value
            message = message.removeprefix(f"{str(self.place).rpartition('.')[2]}: ")
        lines = [f"{self.place}: {message}", *self.place.excerpt()]
        if self.related is not None:
            lines += [f"  {self.related.words} {self.related.place}", *self.related.place.excerpt()]
        return "\n".join(lines)


class Problems:
    """Collects problems, so that one run shows them all."""

    def __init__(self) -> None:
        self._found: list[Problem] = []

    def add(self, message: str, place: Place, related: Related | None = None) -> None:
        """Note one problem; the same one twice counts once.

        Raises:
            ConfigError: If these are more than ``MAX_PROBLEMS``; it holds those that were noted.
        """
        # Half a surrogate pair, quoted from a path, could not be printed.
        message = message.encode("utf-8", "backslashreplace").decode()
        if len(message) > _LONGEST_MESSAGE:
            message = message[: _LONGEST_MESSAGE - 3] + "..."
        problem = Problem(message, place, related)
        if problem in self._found:
            return
        if len(self._found) >= MAX_PROBLEMS:
            raise ConfigError(f"{self.error()}\nand more than these {MAX_PROBLEMS} problems")
        self._found.append(problem)

    def extend(self, others: "Problems") -> None:
        """Note problems that were found apart."""
        for problem in others._found:
            self.add(problem.message, problem.place, problem.related)

    def error(self) -> ConfigError:
        """Return the error that holds them all: by file in the order met, then by line."""
        names = list(dict.fromkeys(problem.place.name for problem in self._found))
        ordered = sorted(
            self._found, key=lambda p: (names.index(p.place.name), p.place.line, p.place.column)
        )
        return ConfigError("\n".join(str(problem) for problem in ordered))

    def raise_if_any(self) -> None:
        """Raise all of them as one error.

        Raises:
            ConfigError: If there is a problem.
        """
        if self._found:
            raise self.error()


def nearest_file(name: str, names: Iterable[str]) -> str:
    """Return the question for the file that is nearest by its stem; empty if none is near."""
    stems = {Path(one).stem: one for one in names}
    near = difflib.get_close_matches(Path(name).stem, stems, n=1)
    return f"did you mean {stems[near[0]]!r}? " if near else ""


def unknown(what: str, name: str, known: Iterable[str]) -> str:
    """Return the message for a name that is not known: the nearest one, or all that are."""
    names = sorted(known)
    near = [known for known in names if len(name) > 1 and known.startswith(name)]
    near = near or [known for known in names if name in known.split("_")]  # speed: approach_speed
    near = near or difflib.get_close_matches(name, names[:_MOST_NAMES], n=1)
    shown = name if len(name) <= 60 else name[:57] + "..."
    if near:
        return f"unknown {what} {shown!r}; did you mean {near[0]!r}?"
    if len(names) > _MOST_NAMES:
        names = [*names[:_MOST_NAMES], "..."]
    return f"unknown {what} {shown!r}; known: {', '.join(names) if names else 'none'}"
