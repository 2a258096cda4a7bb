"""Values of a file checked by pydantic: each error becomes a problem at its place.

Quantities are read by :func:`forcebound.units.parse_quantity`, everything else strictly (no text
for a number).
"""

import dataclasses
import json
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, NotRequired, TypeAlias, get_args

from forcebound.errors import ConfigError
from forcebound.graph.fields import Field
from forcebound.graph.problems import Place, Problems, unknown
from forcebound.graph.tree import Value
from forcebound.quantities import AS_WRITTEN

Values: TypeAlias = dict[str, Any]  # of a mapping of a file, by their keys


@dataclass(frozen=True, eq=False)
class Form:
    """One mapping of a file: its name for messages, ``links.device_state``, and its keys."""

    name: str
    fields: Mapping[str, Field]

    def read(self, value: Value, problems: Problems, others: Collection[str] = ()) -> Values | None:
        """Return the values by key; None with a problem noted, now or before.

        ``others`` are keys that are read elsewhere.
        """
        from pydantic import ValidationError

        if not isinstance(value.content, Mapping | None):
            if not value.is_broken:
                message = f"{self.name}: expected a mapping, got {value}"
                problems.add(message, value.place, value.related)
            return None
        entries = {n: entry for n, entry in value.entries.items() if n not in others}
        sound = {n: entry for n, entry in entries.items() if not entry.is_broken}
        given = {n: _taken(entry, self.fields.get(n)) for n, entry in sound.items()}
        try:
            # As JSON, since strict pydantic then accepts a list for a tuple.
            text = json.dumps(given, ensure_ascii=False).encode("utf-8", "replace")
            values: Values = self.adapter.validate_json(text)
        except ValidationError as error:
            details = error.errors(include_url=False, include_input=False)
            _note(details, self.name, (*self.fields, *others), value, problems)
            return None
        if len(sound) < len(entries):
            return None
        return {n: _absolute(one, entries[n]) for n, one in values.items()}

    @cached_property
    def adapter(self) -> Any:
        """Pydantic's reader of such a mapping."""
        import typing_extensions  # pydantic needs its TypedDict before Python 3.12
        from pydantic import ConfigDict, TypeAdapter

        fields = self.fields.values()
        hints = {f.name: f.hint if f.required else NotRequired[f.hint] for f in fields}
        typed_dict: Any = typing_extensions.TypedDict  # mypy would need to see the keys
        shape: Any = typed_dict(self.name, hints)
        shape.__pydantic_config__ = ConfigDict(strict=True, extra="forbid")
        return TypeAdapter(shape)


def note_error(
    error: ConfigError, name: str, value: Value, problems: Problems, is_named: bool = False
) -> None:
    """Note an error about a mapping at the field that it names, or at its key.

    The message has the mapping's name if it stands at the key, or with ``is_named``.
    """
    at, names = _inside(value, (error.field or "").split("."))
    words = str(error) if names and not is_named else f"{name}: {error}"
    problems.add(words, at.place if names else value.key or value.place, at.related)


def _taken(value: Value, known: Field | None) -> Any:
    """The content of a value; a name may look like a number, and is then taken as it is written."""
    is_number = isinstance(value.content, int | float)
    is_name = known is not None and AS_WRITTEN in get_args(known.hint)
    return value.text if is_number and is_name else value.plain


def _absolute(value: Any, written: Value) -> Any:
    """A path of a launch file starts from the folder of the file that has it."""
    if isinstance(value, Path) and written.place.line:
        return (written.folder / value).absolute()
    if isinstance(value, tuple) and isinstance(written.content, tuple):
        return tuple(map(_absolute, value, written.content))
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        inner = {n: _absolute(getattr(value, n), one) for n, one in written.entries.items()}
        changed = {n: one for n, one in inner.items() if one is not getattr(value, n)}
        return dataclasses.replace(value, **changed) if changed else value
    return value


def _inside(value: Value, steps: Sequence[int | str]) -> tuple[Value, tuple[str, ...]]:
    """What pydantic's location leads to, and its keys; names of union members are passed over."""
    names: tuple[str, ...] = ()
    for step in steps:
        content = value.content
        if isinstance(step, int) and isinstance(content, tuple) and step < len(content):
            value = content[step]
        elif isinstance(step, str) and step in value.entries:
            value = value.entries[step]
            names += (step,)
    return value, names


def _note(
    details: Sequence[Any], name: str, known: Collection[str], root: Value, problems: Problems
) -> None:
    """Note what pydantic refused: one problem for each place, whatever a union has tried."""
    refusals: dict[Place, tuple[Value, str, list[str], list[str]]] = {}
    for detail in details:
        kind, (*before, last) = detail["type"], detail["loc"]
        at, names = _inside(root, before)
        owner = ".".join(names) or name
        if kind == "missing":
            if last not in at.entries:  # else its problem has been noted
                problems.add(f"{owner} needs {last!r}", at.place if names else at.key or at.place)
            continue
        value, below = _inside(at, [last])
        if kind in ("extra_forbidden", "unexpected_keyword_argument"):
            message = f"{owner} has no key {last!r}"
            if not names and known:
                message = unknown(f"key in {owner}:", str(last), known)
            problems.add(message, value.key or value.place)
            continue
        label, words = ".".join((*names, *below)), ""
        if kind == "value_error":
            error = detail["ctx"]["error"]
            words = f"{label}: {error}"
            if isinstance(error, ConfigError):
                value, _ = _inside(value, (error.field or "").split("."))
        _, _, refused, expected = refusals.setdefault(value.place, (value, label, [], []))
        if words:
            refused.append(words)
        else:
            expected.append(_expected(detail))
    for value, label, refused, expected in refusals.values():
        message = f"{label}: expected {' or '.join(expected)}, got {value}"
        if refused:  # and words that are permitted beside a quantity
            message = "; or ".join([*refused, *(one for one in expected if one.startswith("'"))])
        problems.add(message, value.place, value.related)


def _expected(detail: Any) -> str:
    if detail["type"] == "literal_error":
        return str(detail["ctx"]["expected"])
    return _EXPECTED.get(detail["type"], f"something else ({detail['msg']})")


_EXPECTED = {
    "bool_type": "true or false",
    "dataclass_type": "a mapping",
    "dict_type": "a mapping",
    "float_type": "a number",
    "int_from_float": "a whole number",
    "int_type": "a whole number",
    "list_type": "a list",
    "path_type": "a path",
    "string_type": "text",
    "too_short": "at least one",
    "tuple_type": "a list",
}
