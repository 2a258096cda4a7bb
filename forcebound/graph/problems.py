"""Problems of a launch file: all at once, each with its place.

A problem reads like a compiler's message, so that editors can jump to it::

    stiff_wall.yaml:31:14: unknown environment kind 'wal'; did you mean 'wall'?
       31 |     kind: wal
          |           ^
"""

import difflib
import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from forcebound.errors import ConfigError

_WIDEST_EXCERPT = 100  # characters of a source line that are shown


@dataclass(frozen=True, slots=True)
class Place:
    """Origin of a value: a place in a file, or for example ``argument law:=none``."""

    name: str  # empty if the message has it
    line: int = 0  # counts from 1; 0 if the place has no lines
    column: int = 0  # counts from 1, in characters
    text: str = ""  # the line itself

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
            message = message.removeprefix(f"{re.split(r'[.]|: ', str(self.place))[-1]}: ")
        if self.place.name:
            message = f"{self.place}: {message}"
        lines = [message, *self.place.excerpt()]
        if self.related is not None:
            lines += [f"  {self.related.words} {self.related.place}", *self.related.place.excerpt()]
        return "\n".join(lines)


class Problems:
    """Collects problems, so that one run shows them all."""

    def __init__(self) -> None:
        self._found: dict[Problem, None] = {}  # a set that keeps the order

    def add(self, message: str, place: Place, related: Related | None = None) -> None:
        """Note one problem; the same one twice counts once."""
        self._found[Problem(message, place, related)] = None

    def extend(self, others: "Problems") -> None:
        """Note problems that were found elsewhere."""
        self._found |= others._found

    def error(self) -> ConfigError:
        """Return the error that holds them all: by file in the order met, then by line."""
        names = {problem.place.name: None for problem in self._found}
        order = {name: number for number, name in enumerate(names)}
        ordered = sorted(
            self._found, key=lambda p: (order[p.place.name], p.place.line, p.place.column)
        )
        return ConfigError("\n".join(str(problem) for problem in ordered))

    def raise_if_any(self) -> None:
        """Raise all of them as one ConfigError."""
        if self._found:
            raise self.error()


def nearest_file(name: str, names: Iterable[str]) -> str:
    """Return the question for the file that is nearest by its stem; empty if none is near."""
    stems = {Path(one).stem: one for one in names}
    near = difflib.get_close_matches(Path(name).stem, stems, n=1)
    return f"did you mean {stems[near[0]]!r}? " if near else ""


def shortened(text: str) -> str:
    """Return a text for a message, cut if it is long."""
    return text if len(text) <= 60 else text[:57] + "..."


#: Parts of ours that are installed apart.
APART = {
    ("environment kind", "lerobot"): "it comes with `pip install ./integrations`, from a clone of"
    " forcebound (docs/lerobot.md)"
}


def unknown(what: str, name: str, known: Iterable[str]) -> str:
    """Return the message for an unknown name: the most similar known one, or all of them."""
    names = sorted(known)
    near = sorted((one for one in names if len(name) > 1 and one.startswith(name)), key=len)
    near = near or [known for known in names if name in known.split("_")]  # speed: approach_speed
    near = near or difflib.get_close_matches(name, names, n=1)
    message = f"unknown {what} {shortened(name)!r}"
    if how := APART.get((what, name)):
        return f"{message}: {how}"
    if near:
        return f"{message}; did you mean {near[0]!r}?"
    return f"{message}; known: {', '.join(names) or 'none'}"
