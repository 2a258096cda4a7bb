"""Trees of values with their places, read from the text of a launch file.

ruamel.yaml parses the text (YAML 1.2) and knows line and column of each key and value. Plain
scalars follow the core schema of YAML 1.2 (:func:`scalar`): ``yes`` is text, ``1e3`` is a number.
"""

import re
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final, TypeAlias

from forcebound.errors import ConfigError
from forcebound.graph.problems import Place, Problems, Related, shortened
from forcebound.units import split_quantity

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
        """True for a single value, other than nothing."""
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
        """True if a problem inside has been noted already."""
        if isinstance(self.content, tuple):
            return any(value.is_broken for value in self.content)
        return self.content is BROKEN or any(value.is_broken for value in self.entries.values())

    @property
    def folder(self) -> Path:
        """The folder from which a relative path starts: that of the file, or the current one."""
        return Path(self.place.name).parent if self.place.line else Path()

    def with_entries(self, entries: "Mapping[str, Value]") -> "Value":
        """Return this mapping with other entries."""
        return replace(self, content=entries)

    def at(self, keys: Sequence[str]) -> "Value | None":
        """Return the value under a path of keys; None if there is none."""
        found: Value | None = self
        for key in keys:
            found = None if found is None else found.entries.get(key)
        return found

    def with_entry(self, keys: Sequence[str], value: "Value") -> "Value":
        """Return this mapping with a value under a path of keys."""
        if not keys:
            return value
        inner = self.entries.get(keys[0])
        if inner is None or inner.is_scalar:
            inner = Value({}, value.place, value.key)
        return self.with_entries({**self.entries, keys[0]: inner.with_entry(keys[1:], value)})

    def without(self, *names: str) -> "Value":
        """Return this mapping without some of its entries."""
        return self.with_entries({n: v for n, v in self.entries.items() if n not in names})

    def __str__(self) -> str:
        if self.content is None:
            return "nothing"
        if isinstance(self.content, Mapping):
            return "a mapping"
        if isinstance(self.content, tuple):
            return "a list"
        return repr(shortened(self.text))


def units_of(value: Value, name: str = "") -> Iterator[tuple[str, str]]:
    """Yield the units in which quantities are written, by the name of the parameter."""
    if isinstance(value.content, Mapping):
        for key, entry in value.content.items():
            yield from units_of(entry, f"{name}.{key}" if name else key)
    elif isinstance(value.content, tuple):
        for entry in value.content:
            if entry.is_scalar:
                yield from units_of(entry, name)
            elif "set" in entry.entries:  # of a phase
                yield from units_of(entry.entries["set"])
    elif isinstance(value.content, str):
        with suppress(ConfigError):
            unit = split_quantity(value.content)[1]
            if unit:
                yield name, unit


def from_plain(content: Any, name: str, join: str = ": ") -> Value:
    """Return the tree of plain JSON values; places say the path within, ``name`` first."""
    place = Place(name)
    if isinstance(content, Mapping):
        entries = {
            str(key): replace(from_plain(value, f"{name}{join}{key}", "."), key=place)
            for key, value in content.items()
        }
        return Value(entries, place)
    if isinstance(content, list | tuple):
        inside = (from_plain(one, f"{name}[{i}]", ".") for i, one in enumerate(content))
        return Value(tuple(inside), place)
    return Value(content, place, text=str(content))


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

    reader = _Reader(text, name, problems)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of the parser; its errors are what counts
            node = YAML(typ="safe", pure=True).compose(text)
        root = None if node is None else reader.value(node)
    except _StopError:
        return None
    except RecursionError:
        problems.add("nested too deeply", Place(name))
        return None
    except Exception as error:  # the parser has no list of what it raises on damaged text
        reader.note_syntax(error)
        return None
    if root is None or (root.content is None and not root.text):
        problems.add("the launch file is empty", Place(name))
    elif not isinstance(root.content, Mapping):
        problems.add(f"a launch file is a mapping, got {root}", root.place)
    else:
        return root
    return None


class _Reader:
    """Turns the parser's nodes of one file into values."""

    def __init__(self, text: str, name: str, problems: Problems) -> None:
        self._text = text
        self._lines = _LINE_END.split(text)
        self._name = name
        self._problems = problems

    def note_syntax(self, error: Exception) -> None:
        """Note what the parser raised: it has a mark, or a position in the text."""
        details = vars(error)
        mark, position = details.get("problem_mark"), details.get("position")
        words = details.get("problem") or details.get("reason") or str(error)
        message = f"this is not YAML: {words.partition(chr(10))[0] or 'damaged'}"
        if "'\\t'" in words:
            message = "a tab; YAML needs spaces here"
        elif "undefined alias" in words or "another document" in words:
            message += "; a launch file is one document, and $(arg NAME) repeats a value"
        place = Place(self._name)
        if mark is not None:
            place = self._at(mark.line, mark.column)
        elif position is not None:
            *before, last = _LINE_END.split(self._text[:position])
            place = self._at(len(before), len(last))
        if "${" in place.text:  # YAML reads the brace as the beginning of a mapping
            message += "; within braces, write it in quotes: '${env:NAME}'"
        self._problems.add(message, place)

    def _at(self, line: int, column: int) -> Place:
        text = self._lines[line] if line < len(self._lines) else ""
        return Place(self._name, line + 1, column + 1, text)

    def value(self, node: Any) -> Value:
        """Return the value of a node; the kinds of its ``value`` are str, pairs or nodes."""
        place = self._at(node.start_mark.line, node.start_mark.column)
        fault = None
        if node.anchor is not None:  # an alias could repeat itself without end
            fault = f"anchors and aliases are not supported; $(arg {node.anchor}) repeats a value,"
            fault += " and what hands share goes below hands: default:"
        elif not str(node.tag).startswith("tag:yaml.org,2002:"):
            fault = f"tags such as {node.tag} have no meaning here"
        if fault is not None:
            self._problems.add(fault, place)
            raise _StopError
        if isinstance(node.value, str):
            return Value(node.value if node.style else scalar(node.value), place, text=node.value)
        if node.id == "mapping":
            return Value(self._entries(node), place)
        return Value(tuple(self.value(one) for one in node.value), place)

    def _entries(self, node: Any) -> dict[str, Value]:
        entries: dict[str, Value] = {}
        for key_node, value_node in node.value:
            key = self.value(key_node)
            value = replace(self.value(value_node), key=key.place)
            if value.content is None and not value.text:  # the parser places it a line below
                value = replace(value, place=key.place)
            if not key.is_scalar:
                self._problems.add(f"a key must be a name, got {key}", key.place)
            elif key.text in entries:
                first = Related("first at", entries[key.text].key or key.place)
                self._problems.add(f"{key} is given twice", key.place, first)
            else:
                entries[key.text] = value
        return entries
