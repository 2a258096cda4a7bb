"""Sections of a launch file: pydantic reads their values, each problem is noted at its place.

Quantities are read by :func:`forcebound.units.parse_quantity`, everything else strictly (no
text for a number). What pydantic refuses has a location within the section, which becomes a line
and a column. Then the frozen dataclass is made; what its ``__post_init__`` refuses stands at the
field that the error names.
"""

import dataclasses
import json
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, lru_cache
from pathlib import Path
from typing import Any, NotRequired, get_args, get_type_hints

from forcebound.config.problems import Place, Problems, unknown
from forcebound.config.tree import Value
from forcebound.errors import ConfigError
from forcebound.parts.user_module import describe_user_error, kind_of
from forcebound.quantities import AS_WRITTEN


@dataclass(frozen=True, eq=False)
class Field:
    """One key of a section, and its permitted values."""

    name: str
    hint: Any
    required: bool
    default: Any


@cache
def fields_of(kind: type, names: tuple[str, ...] | None = None) -> dict[str, Field]:
    """Return the fields of a dataclass that a launch file can set, or those in ``names``."""
    hints = get_type_hints(kind, include_extras=True)
    found: dict[str, Field] = {}
    for field in dataclasses.fields(kind):
        if not field.init or (names is not None and field.name not in names):
            continue
        factory = field.default_factory
        default = field.default if factory is dataclasses.MISSING else factory()
        required = default is dataclasses.MISSING
        found[field.name] = Field(
            field.name, hints[field.name], required, None if required else default
        )
    return found


@lru_cache(maxsize=1024)
def adapter(*fields: Field) -> Any:
    """Return pydantic's reader of a mapping with these fields."""
    import typing_extensions  # pydantic wants its TypedDict before Python 3.12
    from pydantic import ConfigDict, TypeAdapter

    for field in fields:
        _refuse_unknown_keys(field.hint)
    hints = {f.name: f.hint if f.required else NotRequired[f.hint] for f in fields}
    typed_dict: Any = typing_extensions.TypedDict  # mypy would want to see the keys
    shape = typed_dict("shape", hints)
    shape.__pydantic_config__ = ConfigDict(strict=True)
    return TypeAdapter(shape)


def _refuse_unknown_keys(hint: Any) -> None:
    """Make pydantic as strict with the dataclasses within a type as with the section itself."""
    if isinstance(hint, type) and dataclasses.is_dataclass(hint):
        if "__pydantic_config__" in vars(hint):
            return
        kind: Any = hint
        kind.__pydantic_config__ = {"extra": "forbid", "strict": True}
        for field in fields_of(hint).values():
            _refuse_unknown_keys(field.hint)
    for part in get_args(hint):
        _refuse_unknown_keys(part)


def check_fields(kind: type, taken: Collection[str]) -> None:
    """Check that a launch file can give every field of a dataclass that a user wrote.

    Raises:
        ConfigError: If a field has a name that is ``taken`` in its section, or a type that no value
            of a launch file has.
    """
    try:
        fields = fields_of(kind)
    except Exception as error:
        raise ConfigError(f"the fields of {kind.__name__}: {describe_user_error(error)}") from None
    for field in fields.values():
        if field.name in taken:
            raise ConfigError(
                f"{kind.__name__}: a parameter cannot be called {field.name!r}, which is taken"
            )
        try:
            adapter(field)
        except Exception as error:  # of pydantic, or of a type's own code
            detail = str(error).partition("\n")[0]
            raise ConfigError(
                f"{kind.__name__}: a launch file cannot give {field.name!r} of the type"
                f" {field.hint}: {detail}"
            ) from None


class Section:
    """One mapping of a launch file, such as ``device:``."""

    def __init__(
        self,
        value: Value | None,
        name: str,
        parent: Value,
        problems: Problems,
        any_value: bool = False,
    ) -> None:
        """Open the section ``name`` of ``parent``, where problems with its absence are noted.

        Args:
            value: None: it is absent.
            name: For messages.
            parent: What it stands in.
            problems: What is wrong is added to it.
            any_value: Whether it may be something else than a mapping, too.
        """
        self.name = name
        self.problems = problems
        self.value = value if value is not None else Value({}, parent.place, parent.key)
        if any_value:
            return
        if self.value.content is None:
            self.value = dataclasses.replace(self.value, content={})
        elif not isinstance(self.value.content, Mapping) and not self.value.is_broken:
            self.add(f"{name} must be a mapping, got {self.value}", self.value)

    @property
    def is_readable(self) -> bool:
        """Whether this is a mapping; if not, a problem has been noted."""
        return isinstance(self.value.content, Mapping)

    @property
    def is_empty(self) -> bool:
        """Whether this is a mapping without entries, or absent."""
        return self.is_readable and not self.value.entries

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
        elif isinstance(value.content, str):
            if value.content in table:
                return value.content
            self.add(unknown(what, value.content, table), value)
        elif not value.is_broken:
            self.add(f"{key} must be one of {', '.join(sorted(table))}, got {value}", value)
        return None

    def read(self, fields: Mapping[str, Field]) -> dict[str, Any] | None:
        """Return what is given for these fields; None with problems noted."""
        from pydantic import ValidationError

        given = {name: value for name, value in self.value.entries.items() if name in fields}
        sound = {
            name: _taken(value, fields[name].hint)
            for name, value in given.items()
            if not value.is_broken
        }
        try:
            # Through JSON, since strict pydantic then still takes a list for a tuple.
            values = adapter(*fields.values()).validate_json(json.dumps(sound))
        except ValidationError as error:
            self._note(error.errors(include_url=False, include_input=False))
            return None
        if len(sound) < len(given):
            return None
        return {name: _absolute(value, given[name]) for name, value in values.items()}

    def make(self, kind: type, knows_all: bool = False, **made_before: Any) -> Any:
        """Return the dataclass with its values from this section; None with problems noted.

        Args:
            kind: The dataclass.
            knows_all: Whether the section has no keys but its fields.
            made_before: Fields that do not stand in this section; None: a problem has been noted.
        """
        if not self.is_readable:
            return None
        if knows_all:
            self.check_keys(fields_of(kind))
        names = tuple(name for name in fields_of(kind) if name not in made_before)
        values = self.read(fields_of(kind, names))
        if values is None or None in made_before.values():
            return None
        try:
            return kind(**values, **made_before)
        except Exception as error:
            if isinstance(error, ValueError | ArithmeticError):
                at = self.value.entries.get(_field_of(error) or "")
                self.add_here(f"{self.name}: {error}") if at is None else self.add(str(error), at)
            elif kind_of(kind) is not None:
                self.add_here(f"{self.name}: {describe_user_error(error)}")
            else:
                raise
        return None

    def _note(self, details: list[Any]) -> None:
        """Note what pydantic refused: one problem for each place, whatever a union has tried."""
        found: dict[Place, tuple[str, Value, list[str], list[str]]] = {}
        words: dict[Place, list[str]] = {}  # that are permitted beside a quantity
        for detail in details:
            if detail["loc"][0] not in self.value.entries:
                self.add_here(f"{self.name} needs {detail['loc'][0]!r}")
                continue
            refusal = _refusal(detail)
            _, at = _inside(self.value, (*detail["loc"], *refusal[1:]))
            is_key = detail["type"] in _KEYS
            name, _ = _inside(self.value, detail["loc"][:-1] if is_key else detail["loc"])
            _, _, refused, expected = found.setdefault(at.place, (name, at, [], []))
            refused.append(refusal[0]) if refusal else expected.append(_expected(detail))
            if detail["type"] == "literal_error":
                words.setdefault(at.place, []).append(expected[-1])
        for name, at, refused, expected in found.values():
            if refused:
                self.add(f"{name}: {'; or '.join(refused + words.get(at.place, []))}", at)
            else:
                self.add(f"{name}: expected {' or '.join(expected)}, got {at}", at)


def _taken(value: Value, hint: Any) -> Any:
    """The content of a value; a name may look like a number, and is then taken as it is written."""
    is_number = isinstance(value.content, int | float)
    return value.text if is_number and AS_WRITTEN in get_args(hint) else value.plain


def _absolute(value: Any, written: Value) -> Any:
    """A path of a launch file starts from the folder of the file that has it."""
    if isinstance(value, Path) and written.place.line:
        return (Path(written.place.name).parent / value).absolute()
    if isinstance(value, tuple) and isinstance(written.content, tuple):
        return tuple(map(_absolute, value, written.content))
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        inner = {n: _absolute(getattr(value, n), one) for n, one in written.entries.items()}
        changed = {n: one for n, one in inner.items() if one is not getattr(value, n)}
        return dataclasses.replace(value, **changed) if changed else value
    return value


def _inside(value: Value, location: Sequence[int | str]) -> tuple[str, Value]:
    """Name and value that pydantic means; names of union members in ``location`` are left out."""
    names = []
    for step in location:
        if isinstance(step, int) and isinstance(value.content, tuple):
            value = value.content[step] if step < len(value.content) else value
        elif isinstance(step, str) and step in value.entries:
            value = value.entries[step]
            names.append(step)
    return ".".join(names), value


def _field_of(error: Exception) -> str | None:
    return error.field if isinstance(error, ConfigError) else None


def _refusal(detail: Any) -> tuple[str, ...]:
    """What is wrong with a value of the right type, and with which of its fields, if one is."""
    if detail["type"] == "value_error":
        error = detail["ctx"]["error"]
        field = _field_of(error)
        return (str(error),) if field is None else (str(error), field)
    if detail["type"] in _KEYS:
        return (f"{_KEYS[detail['type']]} {detail['loc'][-1]!r}",)
    return ()


def _expected(detail: Any) -> str:
    if detail["type"] == "literal_error":
        return str(detail["ctx"]["expected"])
    return _EXPECTED.get(detail["type"], f"something else ({detail['msg']})")


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
