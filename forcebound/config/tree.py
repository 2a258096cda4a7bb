"""Trees of values with their places, read from the text of a launch file.

ruamel.yaml splits the text into YAML 1.2 events, each with line and column; the events become a
tree of :class:`Value`. Whatever is wrong is noted and reading goes on, unless the text is no YAML
at all.

Plain scalars follow the core schema of YAML 1.2 (:func:`scalar`): ``yes`` is text, ``1e3`` is a
number.
"""

import re
import warnings
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any, Final, TypeAlias

from forcebound.config.problems import Place, Problems, Related
from forcebound.errors import ConfigError

MAX_DEPTH = 40  # levels of nesting
_LINE_END = re.compile(r"\r\n|[\n\r\x85\u2028\u2029]")  # as the parser counts lines


class _Broken:
    """The content of a value whose problem has been noted already."""


BROKEN: Final = _Broken()

Scalar: TypeAlias = bool | int | float | str | None


@dataclass(frozen=True, slots=True)
class Value:
    """A value of a launch file, with its place."""

    content: "Scalar | Mapping[str, Value] | tuple[Value, ...] | _Broken"
    place: Place
    key: Place | None = None  # of the key that it stands under
    text: str = ""  # as written, if it is a scalar
    related: Related | None = None  # the other end, if it came through an argument

    @property
    def entries(self) -> "Mapping[str, Value]":
        """The values under their keys; empty if this is no mapping."""
        return self.content if isinstance(self.content, Mapping) else {}

    @property
    def is_scalar(self) -> bool:
        """Whether this is a single value, other than nothing."""
        return not isinstance(self.content, Mapping | tuple) and self.content is not None

    @property
    def plain(self) -> Any:
        """The content as plain Python values."""
        if isinstance(self.content, Mapping):
            return {name: value.plain for name, value in self.content.items()}
        if isinstance(self.content, tuple):
            return [value.plain for value in self.content]
        return self.content

    @property
    def is_broken(self) -> bool:
        """Whether a problem inside has been noted already."""
        if isinstance(self.content, tuple):
            return any(value.is_broken for value in self.content)
        return self.content is BROKEN or any(value.is_broken for value in self.entries.values())

    def __str__(self) -> str:
        if self.content is None:
            return "nothing"
        if isinstance(self.content, Mapping):
            return "a mapping"
        if isinstance(self.content, tuple):
            return "a list"
        shown = self.text if len(self.text) <= 60 else self.text[:57] + "..."
        return repr(shown)


def from_plain(content: Any, name: str) -> Value:
    """Return the tree of plain Python values; places say the path within, ``name`` first."""
    place = Place(name)
    if isinstance(content, Mapping):
        join = "." if ":" in name else ": "
        entries = {
            str(key): replace(from_plain(value, f"{name}{join}{key}"), key=place)
            for key, value in content.items()
        }
        return Value(entries, place)
    if isinstance(content, list | tuple):
        return Value(
            tuple(from_plain(value, f"{name}[{i}]") for i, value in enumerate(content)), place
        )
    is_plain = content is None or isinstance(content, bool | float | str | int)
    if not is_plain or (isinstance(content, int) and content.bit_length() > _LONGEST_INT):
        content = f"a {type(content).__name__}"
    return Value(content, place, text=str(content))


_LONGEST_INT = 128  # bits; Python refuses to print far longer ones
_INT = re.compile(r"[-+]?[0-9]{1,30}|0o[0-7]{1,30}|0x[0-9a-fA-F]{1,30}")
_FLOAT = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?")
_WORDS: dict[str, Scalar] = {
    **dict.fromkeys(("", "~", "null", "Null", "NULL")),
    **dict.fromkeys(("true", "True", "TRUE"), True),
    **dict.fromkeys(("false", "False", "FALSE"), False),
    **dict.fromkeys((".nan", ".NaN", ".NAN"), float("nan")),
    **dict.fromkeys((".inf", ".Inf", ".INF", "+.inf", "+.Inf", "+.INF"), 1e999),
    **dict.fromkeys(("-.inf", "-.Inf", "-.INF"), -1e999),
}


def scalar(text: str) -> Scalar:
    """Return what an unquoted word means (YAML 1.2, core schema, section 10.3.2)."""
    if text in _WORDS:
        return _WORDS[text]
    if _INT.fullmatch(text):
        return int(text, 0) if text[:2] in ("0o", "0x") else int(text)
    return float(text) if _FLOAT.fullmatch(text) else text


class _StopError(Exception):
    """Nothing can be made of the rest of the text; the problem has been noted."""


def parse(text: str, name: str, problems: Problems) -> Value | None:
    """Return the tree of a YAML text; None, with a problem noted, if it is no mapping."""
    from ruamel.yaml import YAML

    tree = _Tree(text, name, problems)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of the parser; its errors are what counts
            return tree.document(YAML(typ="safe", pure=True).parse(text))
    except _StopError:
        return None
    except ConfigError:
        raise  # too many problems
    except Exception as error:  # the parser has no list of what it raises on damaged text
        tree.syntax_error(error)
        return None


class _Tree:
    """Builds the tree of one file from the parser's events."""

    def __init__(self, text: str, name: str, problems: Problems) -> None:
        self._text = text
        self._lines = _LINE_END.split(text)
        self._name = name
        self._problems = problems

    def document(self, events: Iterable[Any]) -> Value | None:
        stream = iter(events)
        root: Value | None = None
        for event in stream:
            kind = type(event).__name__
            if kind == "DocumentStartEvent":
                if root is not None:
                    self._stop("a second document begins; a launch file is one", event)
                root = self._value(next(stream), stream, 0)
        if root is None or (root.content is None and not root.text):
            self._problems.add("the launch file is empty", Place(self._name))
            return None
        if not isinstance(root.content, Mapping):
            self._problems.add(f"a launch file is a mapping, got {root}", root.place)
            return None
        return root

    def syntax_error(self, error: Exception) -> None:
        # What the parser raises has a mark; what its reader raises, a position in the text.
        facts = vars(error)
        mark, position = facts.get("problem_mark"), facts.get("position")
        words = facts.get("problem") or facts.get("reason") or str(error)
        message = f"this is not YAML: {words.partition(chr(10))[0] or 'damaged'}"
        if "'\\t'" in words:
            message = "a tab; YAML wants spaces here"
        elif facts.get("context"):
            message += f" ({facts['context']})"
        place = Place(self._name)
        if mark is not None:
            place = self._at(mark.line, mark.column)
        elif isinstance(position, int):
            *before, last = _LINE_END.split(self._text[:position])
            place = self._at(len(before), len(last))
        if "${" in place.text:  # YAML takes the brace for its own
            message += "; within braces, write it in quotes: '${env:NAME}'"
        self._problems.add(message, place)

    def _at(self, line: int, column: int) -> Place:
        text = self._lines[line] if line < len(self._lines) else ""
        return Place(self._name, line + 1, column + 1, text)

    def _place(self, event: Any) -> Place:
        return self._at(event.start_mark.line, event.start_mark.column)

    def _stop(self, message: str, event: Any) -> None:
        self._problems.add(message, self._place(event))
        raise _StopError

    def _value(self, event: Any, stream: Iterator[Any], depth: int) -> Value:
        place = self._place(event)
        if depth > MAX_DEPTH:
            self._stop(f"nested deeper than {MAX_DEPTH} levels", event)
        kind = type(event).__name__
        if event.anchor is not None:  # of an anchor or an alias
            message = f"anchors and aliases ({event.anchor}) are not read; an argument does that"
            self._stop(f"{message}: $(arg {event.anchor})", event)
        if any("\ud800" <= char <= "\udfff" for char in getattr(event, "value", "")):
            self._problems.add("half a surrogate pair is not a character", place)
            return Value(BROKEN, place)
        if getattr(event, "ctag", None) is not None:
            self._problems.add(f"tags such as {event.tag} have no meaning here", place)
        if kind == "MappingStartEvent":
            return self._mapping(place, stream, depth)
        if kind == "SequenceStartEvent":
            return self._sequence(place, stream, depth)
        content = event.value if event.style else scalar(event.value)
        return Value(content, place, text=event.value)

    def _mapping(self, place: Place, stream: Iterator[Any], depth: int) -> Value:
        entries: dict[str, Value] = {}
        for event in stream:
            if type(event).__name__ == "MappingEndEvent":
                break
            key = self._value(event, stream, depth + 1)
            value = replace(self._value(next(stream), stream, depth + 1), key=key.place)
            if value.content is None and not value.text:  # the parser places nothing a line below
                value = replace(value, place=key.place)
            if isinstance(key.content, Mapping | tuple) or key.content is None:
                self._problems.add(f"a key must be a name, got {key}", key.place)
            elif key.text in entries:
                first = Related("first at", entries[key.text].key or place)
                self._problems.add(f"{key} is given twice", key.place, first)
            else:
                entries[key.text] = value
        return Value(entries, place)

    def _sequence(self, place: Place, stream: Iterator[Any], depth: int) -> Value:
        values: list[Value] = []
        for event in stream:
            if type(event).__name__ == "SequenceEndEvent":
                break
            values.append(self._value(event, stream, depth + 1))
        return Value(tuple(values), place)
