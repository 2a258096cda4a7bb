"""Values of a file checked by pydantic: each error becomes a problem at its place.

A form is the tree of the mappings in a file: the keys of each, and what is made of their values.
Quantities are read by :func:`forcebound.units.parse_quantity`, everything else strictly (no text
for a number).
"""

import dataclasses
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, NotRequired, TypeAlias, get_args

from forcebound.errors import ConfigError
from forcebound.graph.fields import Field
from forcebound.graph.problems import Place, Problems, unknown
from forcebound.graph.tree import Value
from forcebound.quantities import AS_WRITTEN

Values: TypeAlias = dict[str, Any]  # of a mapping of a file, by their keys


@dataclass(frozen=True, eq=False)
class Form:
    """One mapping of a file.

    Attributes:
        name: For messages: ``links.device_state``.
        fields: Its keys with single values.
        make: Makes an object of the values; raises ConfigError, with the field if one is wrong.
        inner: Its keys that are mappings with a form of their own.
        is_list: Whether it is a list of such mappings.
    """

    name: str
    fields: Mapping[str, Field]
    make: "Callable[[Values, Value], Any] | None" = None
    inner: "Mapping[str, Form]" = field(default_factory=dict)
    is_list: bool = False

    def read(self, value: Value, problems: Problems) -> Values:
        """Return the values by key; with a problem noted, only what could be made.

        What ``make`` made is under the place of its mapping: ``links.device_state``, or ``""``.
        """
        from pydantic import ValidationError

        made: Values = {}
        try:
            # As JSON, since strict pydantic then accepts a list for a tuple.
            text = json.dumps(self._given(value), ensure_ascii=False).encode("utf-8", "replace")
            values = self.adapter.validate_json(text, context=(value, made))
        except ValidationError as error:
            _note(error.errors(include_url=False, include_input=False), self, value, problems)
            return made
        return {**values, **made} if self.make is None else made

    @cached_property
    def adapter(self) -> Any:
        """Pydantic's reader of such a mapping."""
        from pydantic import TypeAdapter

        return TypeAdapter(self._type(()))

    def _type(self, place: tuple[str, ...]) -> Any:
        import typing_extensions  # pydantic needs its TypedDict before Python 3.12
        from pydantic import AfterValidator, ConfigDict, ValidationInfo
        from pydantic import Field as Entries

        hints = {
            f.name: f.hint if f.required else NotRequired[f.hint] for f in self.fields.values()
        }
        hints |= {n: NotRequired[form._type((*place, n))] for n, form in self.inner.items()}
        typed_dict: Any = typing_extensions.TypedDict  # mypy would need to see the keys
        shape: Any = typed_dict(self.name, hints)
        shape.__pydantic_config__ = ConfigDict(strict=True, extra="forbid")
        if self.is_list:
            return Annotated[list[shape], Entries(min_length=1)]
        make = self.make
        if make is None:
            return shape

        def made(values: Values, info: ValidationInfo) -> Any:
            section, found = info.context  # type: ignore[misc]
            for step in place:
                section = section.entries.get(step, Value({}, section.place, section.key))
            result = make({n: _absolute(v, section.entries[n]) for n, v in values.items()}, section)
            if not section.is_broken:
                found[".".join(place)] = result
            return result

        return Annotated[shape, AfterValidator(made)]

    def _given(self, value: Value) -> Any:
        """The plain values that are sound."""
        if self.is_list and isinstance(value.content, tuple):
            one = dataclasses.replace(self, is_list=False)
            return [one._given(entry) for entry in value.content]
        if not isinstance(value.content, Mapping):
            return {} if value.content is None and not self.is_list else value.plain
        return {
            name: self.inner[name]._given(entry)
            if name in self.inner
            else _taken(entry, self.fields.get(name))
            for name, entry in value.entries.items()
            if name in self.inner or not entry.is_broken
        }


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


@dataclass
class _At:
    """Where an error belongs."""

    form: Form | None  # of the innermost mapping that has one
    value: Value
    names: tuple[str, ...] = ()  # of the keys within that form
    is_inside: bool = False  # whether it is within a value of the form

    def step(self, step: int | str) -> None:
        """Go one step of pydantic's location; names of union members are passed over."""
        content = self.value.content
        if isinstance(step, int) and isinstance(content, tuple) and step < len(content):
            self.value = content[step]
        elif isinstance(step, str) and step in self.value.entries:
            self.value = self.value.entries[step]
            inner = None if self.form is None or self.names else self.form.inner.get(step)
            if inner is None:
                self.names += (step,)
            else:
                self.form = inner

    @property
    def key(self) -> Place:
        return self.value.key or self.value.place

    @property
    def owner(self) -> str:
        """The mapping in words."""
        assert self.form is not None
        return ".".join(self.names) or self.form.name


def _note(details: Sequence[Any], form: Form, root: Value, problems: Problems) -> None:
    """Note what pydantic refused: one problem for each place, whatever a union has tried."""
    found: dict[Place, tuple[_At, list[str], list[str]]] = {}
    for detail in details:
        at = _At(form, root)
        *before, last = detail["loc"] or ("",)
        for step in before:
            at.step(step)
        if detail["type"] == "missing":
            if last not in at.value.entries:  # else its problem has been noted
                place = at.value.place if at.names else at.key
                problems.add(f"{at.owner} needs {last!r}", place)
        elif detail["type"] in ("extra_forbidden", "unexpected_keyword_argument"):
            _note_key(at, str(last), problems)
        else:
            at.step(last)
            field_name = None
            if detail["type"] == "value_error":
                error = detail["ctx"]["error"]
                field_name = error.field if isinstance(error, ConfigError) else None
                label = ".".join(at.names)
            for name in (field_name or "").split("."):
                at.step(name)
            _, refused, expected = found.setdefault(at.value.place, (at, [], []))
            if detail["type"] != "value_error":
                expected.append(_expected(detail))
            else:
                words = str(detail["ctx"]["error"])
                refused.append(f"{label}: {words}" if label else words)
    for at, refused, expected in found.values():
        _note_value(at, refused, expected, problems)


def _note_key(at: _At, name: str, problems: Problems) -> None:
    assert at.form is not None
    known = () if at.names else (*at.form.fields, *at.form.inner)
    message = (
        unknown(f"key in {at.owner}:", name, known) if known else f"{at.owner} has no key {name!r}"
    )
    entry = at.value.entries.get(name, at.value)
    problems.add(message, entry.key or entry.place)


def _note_value(at: _At, refused: list[str], expected: list[str], problems: Problems) -> None:
    if refused and at.names:
        words = [one for one in expected if one.startswith("'")]  # permitted beside a quantity
        problems.add("; or ".join(refused + words), at.value.place, at.value.related)
    elif refused:
        problems.add(f"{at.owner}: {'; or '.join(refused)}", at.key)
    else:
        message = f"{at.owner}: expected {' or '.join(expected)}, got {at.value}"
        problems.add(message, at.value.place, at.value.related)


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
    "json_invalid": "readable text",
    "string_type": "text",
    "too_short": "at least one",
    "tuple_type": "a list",
}
