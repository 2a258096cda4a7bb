"""Parts as plain JSON types."""

import dataclasses
import keyword
from collections.abc import Mapping
from pathlib import Path
from typing import Any


def plain(member: Any) -> dict[str, Any]:
    """Return the fields of a dataclass that a launch file can set, as plain JSON types."""
    fields = [field.name for field in dataclasses.fields(member) if field.init]
    return {key_of(name): plain_value(getattr(member, name)) for name in fields}


def key_of(name: str) -> str:
    """Return the key in a launch file of a field by its name: ``class`` of ``class_``."""
    return name.removesuffix("_")


def field_of(key: str) -> str:
    """Return the name of the field of a key: Python's own words have a ``_`` there."""
    return f"{key}_" if keyword.iskeyword(key) else key


def plain_value(value: Any) -> Any:
    """Return the value of such a field as plain JSON types."""
    if isinstance(value, tuple):
        return [plain_value(entry) for entry in value]
    if isinstance(value, Mapping):
        return {name: plain_value(entry) for name, entry in value.items()}
    if dataclasses.is_dataclass(value):
        return plain(value)
    return str(value) if isinstance(value, Path) else value
