"""Keys of a section: the fields of a frozen dataclass that a launch file can set."""

import dataclasses
from collections.abc import Collection
from dataclasses import dataclass
from functools import cache
from typing import Any, get_type_hints

from forcebound.errors import ConfigError
from forcebound.parts.user_module import describe_user_error


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


def check_fields(kind: type, taken: Collection[str]) -> None:
    """Check that a launch file can give every field of a dataclass that a user wrote.

    Raises:
        ConfigError: If a field has a name that is ``taken`` in its section, or a type that no value
            of a launch file has.
    """
    from pydantic import TypeAdapter

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
            TypeAdapter(field.hint)
        except Exception as error:  # of pydantic, or of a type's own code
            detail = str(error).partition("\n")[0]
            raise ConfigError(
                f"{kind.__name__}: a launch file cannot give {field.name!r} of the type"
                f" {field.hint}: {detail}"
            ) from None
