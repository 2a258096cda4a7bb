"""Keys of a section: the fields of a frozen dataclass that a launch file can set."""

import dataclasses
from dataclasses import dataclass
from functools import cache
from typing import Any, get_type_hints


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
