"""Keys of a section: the fields of a frozen dataclass that a launch file can set."""

import dataclasses
from functools import cache
from typing import Any, NamedTuple, get_type_hints

from forcebound.haptics.parts.plain import key_of


class Field(NamedTuple):
    """One key of a section, and its permitted values."""

    name: str
    hint: Any
    required: bool = False
    default: Any = None


@cache
def fields_of(kind: type, names: tuple[str, ...] | None = None) -> dict[str, Field]:
    """Return the fields of a dataclass that a launch file can set, or those in ``names``."""
    hints = get_type_hints(kind, include_extras=True)
    found: dict[str, Field] = {}
    for field in dataclasses.fields(kind):
        if field.init and (names is None or field.name in names):
            factory = field.default_factory
            default = field.default if factory is dataclasses.MISSING else factory()
            required = default is dataclasses.MISSING
            given = None if required else default
            key = key_of(field.name)
            found[key] = Field(key, hints[field.name], required, given)
    return found
