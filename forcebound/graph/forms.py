"""Values of a file read as the types of their fields: each fault becomes a problem at its place.

Quantities are read by :func:`forcebound.units.parse_quantity`, everything else strictly: no text
for a number, no number for a text. ``docs/decisions/18-one-reader.md`` says why this is ours.
"""

import dataclasses
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, Final, Literal, TypeAlias, Union, get_args, get_origin

from forcebound.axes import Axis, AxisKind, at_lever, common_kind
from forcebound.errors import ConfigError
from forcebound.graph.fields import Field, fields_of
from forcebound.graph.problems import Place, Problems, Related, unknown
from forcebound.graph.tree import Value
from forcebound.quantities import AS_WRITTEN, Note, Unit

Values: TypeAlias = dict[str, Any]  # of a mapping of a file, by their keys

#: A value that is wrong: what it is not allowed to be, and what was expected in its place.
_Refusal: TypeAlias = tuple[Value, list[str], list[str]]
_REFUSED: Final = object()  # in place of a value that is wrong
_MIXED: Final = Unit("")  # of one number for axes of different kinds: in the SI unit of each
_SEQUENCES: Mapping[Any, type] = {tuple: tuple, list: list, Sequence: tuple}
_MAPPINGS = (dict, Mapping)
_SCALARS: Mapping[Any, str] = {
    bool: "true or false",
    float: "a number",
    int: "a whole number",
    str: "text",
    Path: "a path",
    type(None): "nothing",
}


class _AnyAxis(Unit):
    """The unit of a quantity on an axis of a kind that is not known."""

    def read(self, value: Any, symbol: str) -> float:
        try:
            return super().read(value, symbol)
        except ConfigError:
            return Unit(Axis("", "angle").unit(self.symbol)).read(value, symbol)


@dataclass(frozen=True, eq=False)
class Form:
    """One mapping of a file: its name for messages, ``links.device_state``, and its keys."""

    name: str
    fields: Mapping[str, Field]

    def read(
        self,
        value: Value,
        problems: Problems,
        others: Collection[str] = (),
        axes: Sequence[Axis] | None = (),
    ) -> Values | None:
        """Return the values by key; None with a problem noted, now or before.

        ``others`` are keys that are read elsewhere; ``axes`` those in whose units quantities are
        read: the entries of a list one by one. Without, they are those of the types; None: not
        known, since the device is wrong, so that both will do.
        """
        if not isinstance(value.content, Mapping | None):
            if not value.is_broken:
                message = f"{self.name}: expected a mapping, got {value}"
                problems.add(message, value.place, value.related)
            return None
        reader = _Reader(axes=axes)
        values = reader.fields(self.fields, value, self.name, "", others)
        reader.note(problems)
        is_sound = not reader.refusals and _REFUSED not in values.values()
        return values if is_sound else None


def read_as(hint: Any, value: Value, name: str) -> Any:
    """Return a value as a type; ConfigError with every fault and its place."""
    reader, problems = _Reader(), Problems()
    found = reader.read(hint, value, name)
    reader.note(problems)
    problems.raise_if_any()
    return found


def check_hint(hint: Any) -> None:
    """Raise TypeError for a type that a launch file cannot give."""
    origin, arguments = get_origin(hint), get_args(hint)
    if origin is Annotated:
        check_hint(arguments[0])
    elif origin in (Union, UnionType, *_SEQUENCES):
        for one in arguments:
            if one is not ...:
                check_hint(one)
    elif origin in _MAPPINGS and arguments[0] is str:
        check_hint(arguments[1])
    elif dataclasses.is_dataclass(hint) and isinstance(hint, type):
        for one in fields_of(hint).values():
            check_hint(one.hint)
    elif origin is not Literal and hint not in (Any, *_SCALARS):
        raise TypeError("expected a number, text, a path, or a list, mapping or dataclass of these")


def note_error(
    error: ConfigError, name: str, value: Value, problems: Problems, is_named: bool = False
) -> None:
    """Note an error about a mapping at the field that it names, or at its key.

    The message has the mapping's name if it stands at the key, or with ``is_named``.
    """
    at = _inside(value, error)
    words = str(error) if at is not value and not is_named else f"{name}: {error}"
    problems.add(words, at.place if at is not value else value.key or value.place, at.related)


def _inside(value: Value, error: ConfigError) -> Value:
    """Value to which the field of an error leads, as far as it is written."""
    for step in (error.field or "").split("."):
        value = value.entries.get(step, value)
    return value


@dataclass
class _Reader:
    """Reads values as types, and keeps what it refuses: by place, whatever a union has tried."""

    refusals: dict[tuple[Place, str], _Refusal] = field(default_factory=dict)
    axes: Sequence[Axis] | None = ()
    entry: int | None = None  # of a list, that is read

    def note(self, problems: Problems) -> None:
        """Note all that was refused: one problem for each place and name there."""
        for (place, label), (value, refused, expected) in self.refusals.items():
            message = f"{label}: expected {' or '.join(expected)}, got {value}"
            if refused:  # and words that are permitted beside a quantity
                literals = [one for one in expected if one.startswith("'")]
                message = "; or ".join(dict.fromkeys([*refused, *literals]))
            related: Related | None = value.related
            problems.add(message, place, related)

    def fields(
        self,
        fields: Mapping[str, Field],
        value: Value,
        owner: str,
        label: str,
        others: Collection[str] = (),
    ) -> Values:
        """Return the values of a mapping by key: of each that is written, and not in ``others``."""
        values: Values = {}
        for name, entry in value.entries.items():
            known, full = fields.get(name), f"{label}.{name}" if label else name
            if entry.is_broken:
                values[name] = _REFUSED
            elif known is not None:
                values[name] = self.read(known.hint, entry, full)
            elif name not in others:
                message = f"{owner} has no key {name!r}"
                if not label and (fields or others):
                    message = unknown(f"key in {owner}:", name, (*fields, *others))
                self._refuse(entry, full, message, entry.key)
        for name, known in fields.items():
            if known.required and name not in value.entries:
                at = value.place if label else value.key or value.place
                self._refuse(value, f"{owner}.{name}", f"{owner} needs {name!r}", at)
            elif self.axes and name not in value.entries:
                default = known.default
                if (turned := _turned(known.hint, default, common_kind(self.axes))) != default:
                    values[name] = turned
        return values

    def read(self, hint: Any, value: Value, label: str) -> Any:
        """Return a value as a type; something else, and a refusal, if it is none."""
        origin, arguments = get_origin(hint), get_args(hint)
        if value.is_broken:
            return _REFUSED
        if origin is Annotated:
            return self._noted(arguments[0], arguments[1:], value, label)
        if origin in (Union, UnionType):
            return self._one_of(arguments, value, label)
        if origin is Literal:
            return self._literal(arguments, value, label)
        if origin in _SEQUENCES:
            return self._sequence(origin, arguments, value, label)
        if origin in _MAPPINGS:
            return self._mapping(arguments[1], value, label)
        if isinstance(hint, type) and dataclasses.is_dataclass(hint):
            return self._record(hint, value, label)
        return value.plain if hint is Any else self._scalar(hint, value, label)

    def _noted(self, hint: Any, notes: Sequence[Any], value: Value, label: str) -> Any:
        """A value whose type has notes, such as a unit, a range or a check."""
        notes = [self._on_axis(note) if isinstance(note, Unit) else note for note in notes]
        symbols = [note.symbol for note in notes if isinstance(note, Unit)]
        if symbols:
            hint = Any
            if any(note is _MIXED for note in notes) and isinstance(value.content, str):
                words = "a list, or one number without a unit, for axes of different kinds"
                return self._expect(value, label, words)
        if AS_WRITTEN in notes and isinstance(value.content, int | float):
            value = dataclasses.replace(value, content=value.text)
        found = self.read(hint, value, label)
        try:
            for note in notes:
                if isinstance(note, Note) and found is not _REFUSED:
                    found = note.read(found, "".join(symbols))
        except ValueError as error:
            return self._refuse(value, label, f"{label}: {error}")
        return found

    def _on_axis(self, unit: Unit) -> Unit:
        """A unit of a type as it is on the axis of the entry that is read."""
        if self.axes is None:
            return _AnyAxis(unit.symbol)
        symbols = [axis.unit(unit.symbol) for axis in self.axes] or [unit.symbol]
        if len(set(symbols)) == 1:
            return Unit(symbols[0])
        if self.entry is None or self.entry >= len(symbols):
            return _MIXED
        return Unit(symbols[self.entry])

    def _one_of(self, hints: Sequence[Any], value: Value, label: str) -> Any:
        """A value of one of several types: of those that have its shape, the first that fits."""
        if value.content is None and type(None) in hints:
            return None
        hints = [hint for hint in hints if hint is not type(None)]
        hints = [hint for hint in hints if _shape(hint) in (Any, _shape_of(value))] or hints
        before, tried = self.refusals, []
        for hint in _of_kind(hints, value):
            self.refusals = {}
            found = self.read(hint, value, label)
            if not self.refusals:
                self.refusals = before
                return found
            tried.append(self.refusals)
        self.refusals = before
        for key, (at, refused, expected) in (one for each in tried for one in each.items()):
            kept = before.setdefault(key, (at, [], []))
            kept[1].extend(refused)
            kept[2].extend(expected)
        return _REFUSED

    def _literal(self, words: Sequence[Any], value: Value, label: str) -> Any:
        for word in words:
            if value.content == word and type(value.content) is type(word):
                return word
        *before, last = map(repr, words)
        return self._expect(value, label, f"{', '.join(before)} or {last}" if before else last)

    def _sequence(self, kind: Any, hints: Sequence[Any], value: Value, label: str) -> Any:
        content = value.content
        if not isinstance(content, tuple):
            is_text = isinstance(content, str) and hints[0] is str
            words = f"a list, such as [{content}]" if is_text else "a list"
            return self._expect(value, label, words)
        if kind is tuple and hints[-1] is not ...:
            if len(content) != len(hints):
                words = f"{label}: expected a list of {len(hints)}, got one of {len(content)}"
                return self._refuse(value, label, words)
        else:
            hints = [hints[0]] * len(content)
        outside, read = self.entry, []
        for self.entry, (hint, one) in enumerate(zip(hints, content, strict=True)):
            read.append(self.read(hint, one, label))
        self.entry = outside
        return _SEQUENCES[kind](read)

    def _mapping(self, hint: Any, value: Value, label: str) -> Any:
        if not isinstance(value.content, Mapping):
            return self._expect(value, label, "a mapping")
        return {n: self.read(hint, one, f"{label}.{n}") for n, one in value.entries.items()}

    def _record(self, kind: type, value: Value, label: str) -> Any:
        if not isinstance(value.content, Mapping):
            return self._expect(value, label, "a mapping")
        count = len(self.refusals)
        values = self.fields(fields_of(kind), value, label, label)
        if len(self.refusals) > count or _REFUSED in values.values():
            return _REFUSED
        try:
            return kind(**values)
        except ValueError as error:
            at = _inside(value, error) if isinstance(error, ConfigError) else value
            return self._refuse(at, label, f"{label}: {error}")

    def _scalar(self, kind: Any, value: Value, label: str) -> Any:
        content: Any = value.content
        if kind is float and type(content) is int:
            is_float = content.bit_length() < 1024
            return float(content) if is_float else self._expect(value, label, _SCALARS[float])
        if kind is Path and isinstance(content, str):
            path = Path(content)  # from the folder of the file that has it
            return (value.folder / path).absolute() if value.place.line else path
        if type(content) is not kind or (kind is str and not _is_unicode(content)):
            return self._expect(value, label, _SCALARS[kind])
        return content

    def _expect(self, value: Value, label: str, words: str) -> object:
        self.refusals.setdefault((value.place, label), (value, [], []))[2].append(words)
        return _REFUSED

    def _refuse(self, value: Value, label: str, words: str, place: Place | None = None) -> object:
        self.refusals.setdefault((place or value.place, label), (value, [], []))[1].append(words)
        return _REFUSED


def _turned(hint: Any, default: Any, kind: AxisKind | None) -> Any:
    """A default as it is on axes of a kind: at a lever, see :mod:`forcebound.axes`.

    Of axes that differ, as it is on an angle.
    """
    symbol = next(_symbols(hint), None)
    if symbol is None or isinstance(default, bool):
        return default
    if isinstance(default, tuple):
        return tuple(_turned(hint, one, kind) for one in default)
    is_number = isinstance(default, int | float)
    return at_lever(default, symbol, kind or "angle") if is_number else default


def _symbols(hint: Any) -> Iterator[str]:
    """The units in a type."""
    for note in getattr(hint, "__metadata__", ()):
        if isinstance(note, Unit):
            yield note.symbol
    if not (isinstance(hint, type) and dataclasses.is_dataclass(hint)):
        for one in get_args(hint):
            yield from _symbols(one)


def _is_unicode(text: str) -> bool:
    return text.isascii() or not any("\ud800" <= char <= "\udfff" for char in text)


def _shape(hint: Any) -> Any:
    """The shape of a type's values: a list, a mapping, Any, or a single value: None."""
    origin = get_origin(hint)
    if origin is Annotated:
        return _shape(get_args(hint)[0])
    if hint is Any:
        return Any
    if origin in _SEQUENCES:
        return tuple
    return Mapping if origin in _MAPPINGS or dataclasses.is_dataclass(hint) else None


def _shape_of(value: Value) -> Any:
    content = value.content
    return (
        tuple if isinstance(content, tuple) else Mapping if isinstance(content, Mapping) else None
    )


def _of_kind(hints: Sequence[Any], value: Value) -> Sequence[Any]:
    """The dataclasses that have the ``kind`` of a mapping; all, or none of them has a kind."""
    written = value.entries.get("kind")
    records = [one for one in hints if isinstance(one, type) and dataclasses.is_dataclass(one)]
    named = {one: fields_of(one).get("kind") for one in records}
    if written is None or None in named.values():
        return hints
    meant = [one for one, kind in named.items() if kind and written.content in get_args(kind.hint)]
    return meant or hints
