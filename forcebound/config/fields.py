"""How a section of a launch file becomes a frozen dataclass, every problem at its place.

1. Keys that no dataclass of the section has are problems, with the nearest known one.
2. Each value is read by pydantic as its field's type says: quantities by
   :func:`forcebound.quantities.parse_quantity`, everything else strictly (no text for a number).
3. The dataclass is made. What its ``__post_init__`` refuses is reported at the field that the
   message names first; then the dataclass is tried without that field, for the next complaint.
"""

import dataclasses
import json
import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, get_type_hints

from forcebound.config.problems import Problems, unknown
from forcebound.config.tree import BROKEN, Value
from forcebound.errors import ConfigError
from forcebound.user_module import describe_user_error, kind_of


@dataclass(frozen=True)
class Field:
    """What a launch file may say under one key."""

    name: str
    hint: Any
    required: bool
    default: Any


@cache
def fields_of(kind: type, names: Collection[str] | None = None) -> dict[str, Field]:
    """Return the fields of a dataclass that a launch file can set, or those in ``names``."""
    hints = get_type_hints(kind, include_extras=True)
    missing = dataclasses.MISSING
    found: dict[str, Field] = {}
    for field in dataclasses.fields(kind):
        if not field.init or (names is not None and field.name not in names):
            continue
        factory = field.default_factory
        default = field.default if factory is missing else factory()
        required = default is missing
        found[field.name] = Field(
            field.name, hints[field.name], required, None if required else default
        )
    return found


@cache
def adapter(hint: Any) -> Any:
    """Return pydantic's reader for a type."""
    from pydantic import ConfigDict, TypeAdapter

    return TypeAdapter(hint, config=ConfigDict(strict=True))


def check_fields(kind: type, taken: Collection[str]) -> None:
    """Check that a launch file can give every field of a dataclass that a user wrote.

    Args:
        kind: The dataclass.
        taken: Names that already mean something in its section.

    Raises:
        ConfigError: If a field has such a name, or a type that no value of a launch file has.
    """
    try:
        fields = fields_of(kind)
    except Exception as error:
        raise ConfigError(f"the fields of {kind.__name__}: {describe_user_error(error)}") from None
    for field in fields.values():
        if field.name in taken:
            message = (
                f"{kind.__name__}: a parameter cannot be called {field.name!r}, which is taken"
            )
            raise ConfigError(message)
        try:
            adapter(field.hint)
        except Exception as error:  # of pydantic, or of a type's own code
            detail = str(error).partition("\n")[0]
            raise ConfigError(
                f"{kind.__name__}: a launch file cannot give {field.name!r} of the type"
                f" {field.hint}: {detail}"
            ) from None


class Section:
    """One mapping of a launch file, such as ``device:``."""

    def __init__(self, value: Value | None, name: str, parent: Value, problems: Problems) -> None:
        """Open the section ``name``, given as ``value``; problems with its absence go to parent."""
        self.name = name
        self.problems = problems
        self.value = value if value is not None else Value({}, parent.place, parent.key)
        if self.value.content is None:
            self.value = dataclasses.replace(self.value, content={})
        elif not isinstance(self.value.content, Mapping) and not self.value.is_broken:
            self.add(f"{name} must be a mapping, got {self.value}", self.value)

    @property
    def is_readable(self) -> bool:
        """Whether this is a mapping; if not, a problem has been noted."""
        return isinstance(self.value.content, Mapping)

    def add(self, message: str, value: Value) -> None:
        """Note a problem with a value of this section."""
        self.problems.add(message, value.place, value.related)

    def add_here(self, message: str) -> None:
        """Note a problem with the section as a whole."""
        self.problems.add(message, self.value.key or self.value.place)

    def check_keys(self, known: Collection[str]) -> None:
        """Note every key that is not known."""
        for name, value in self.value.entries.items():
            if name not in known:
                message = unknown(f"key in {self.name}:", name, known)
                self.problems.add(message, value.key or value.place)

    def choose(self, what: str, key: str, table: Collection[str]) -> str | None:
        """Return the name under ``key`` if ``table`` has it; None with a problem noted."""
        value = self.value.entries.get(key)
        if value is None:
            self.add_here(f"{self.name} needs {key!r}, one of {', '.join(sorted(table))}")
        elif value.is_broken:
            pass
        elif not isinstance(value.content, str):
            self.add(f"{key} must be one of {', '.join(sorted(table))}, got {value}", value)
        elif value.content not in table:
            self.add(unknown(what, value.content, table), value)
        else:
            return value.content
        return None

    def read(self, fields: Mapping[str, Field]) -> dict[str, Any]:
        """Return what is given for these fields; broken where a problem was noted."""
        values: dict[str, Any] = {}
        for name, field in fields.items():
            value = self.value.entries.get(name)
            if value is not None:
                values[name] = self._convert(name, field.hint, value)
            elif field.required:
                self.add_here(f"{self.name} needs {name!r}")
                values[name] = BROKEN
        return values

    def make(self, kind: type, **made_before: Any) -> Any:
        """Return the dataclass with its values from this section; None with problems noted.

        Args:
            kind: The dataclass.
            made_before: Fields that do not stand in this section as such.
        """
        names = tuple(name for name in fields_of(kind) if name not in made_before)
        values = {**self.read(fields_of(kind, names)), **made_before}
        sound = {name: value for name, value in values.items() if value is not BROKEN}
        while True:
            missing = [f for f in fields_of(kind).values() if f.required and f.name not in sound]
            if missing:
                return None
            try:
                made = kind(**sound)
            except Exception as error:
                if not isinstance(error, ValueError | ArithmeticError):
                    if kind_of(kind) is None:
                        raise
                    self.add_here(f"{self.name}: {describe_user_error(error)}")
                    return None
                blamed = self._blame(str(error), kind, sound)
                if blamed is None:
                    return None
                del sound[blamed]
            else:
                return made if len(sound) == len(values) else None

    def _blame(self, message: str, kind: type, sound: Mapping[str, Any]) -> str | None:
        """Note what the dataclass refused; return the field to blame if it is clear which."""
        named = [name for name in fields_of(kind) if re.search(rf"\b{name}\b", message)]
        named.sort(key=lambda name: re.search(rf"\b{name}\b", message).start())  # type: ignore[union-attr]  # found above
        given = [name for name in named if name in sound and name in self.value.entries]
        if given:
            self.add(message, self.value.entries[given[0]])
        else:
            self.add_here(f"{self.name}: {message}")
        return given[0] if len(named) == 1 and given else None

    def _convert(self, name: str, hint: Any, value: Value) -> Any:
        from pydantic import ValidationError

        if value.is_broken:
            return BROKEN
        try:
            # Through JSON, since strict pydantic then still takes a list for a tuple.
            result = adapter(hint).validate_json(json.dumps(value.plain))
        except ValidationError as error:
            self._complain(name, value, error.errors(include_url=False, include_input=False))
            return BROKEN
        if isinstance(result, Path) and value.place.line:
            return (Path(value.place.name).parent / result).absolute()
        return result

    def _complain(self, name: str, value: Value, details: list[Any]) -> None:
        """Note what pydantic refused: one problem for each place, whatever a union has tried."""
        refused: dict[int, tuple[Value, list[str]]] = {}
        expected: dict[int, tuple[Value, list[str]]] = {}
        for detail in details:
            at = _inside(value, detail["loc"])
            if detail["type"] == "value_error":
                refused.setdefault(id(at), (at, []))[1].append(str(detail["ctx"]["error"]))
            elif detail["type"] in _KEYS:
                wrong = f"{_KEYS[detail['type']]} {detail['loc'][-1]!r}"
                refused.setdefault(id(at), (at, []))[1].append(wrong)
            else:
                expected.setdefault(id(at), (at, []))[1].append(_expected(detail))
        for at, words in refused.values():
            self.add(f"{name}: {'; or '.join(words)}", at)
        for key, (at, words) in expected.items():
            if key not in refused:
                self.add(f"{name}: expected {' or '.join(words)}, got {at}", at)


def _inside(value: Value, location: tuple[int | str, ...]) -> Value:
    """The value that pydantic means; names of union members in ``location`` are passed over."""
    for step in location:
        if isinstance(step, int) and isinstance(value.content, tuple):
            value = value.content[step] if step < len(value.content) else value
        elif isinstance(step, str) and step in value.entries:
            value = value.entries[step]
    return value


_KEYS = {"missing": "needs", "unexpected_keyword_argument": "has no key"}

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
    "tuple_type": "a list",
}


def _expected(detail: Any) -> str:
    if detail["type"] == "literal_error":
        return str(detail["ctx"]["expected"])
    return _EXPECTED.get(detail["type"], f"something else ({detail['msg']})")
