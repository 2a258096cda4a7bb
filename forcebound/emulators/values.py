"""Parts of an emulator as plain JSON, as they come from the driver that starts it."""

from collections.abc import Callable, Mapping
from typing import Any, TypeVar

import msgspec

from forcebound.config.fields import fields_of
from forcebound.errors import ConfigError
from forcebound.operators import OPERATORS, Operator

Model = TypeVar("Model")


def restored(kind: Callable[..., Model], values: Mapping[str, Any]) -> Model:
    """Return a model with those of the values that it knows, and its defaults.

    Args:
        kind: A dataclass.
        values: Plain JSON, in SI units.

    Raises:
        ConfigError: If a value is not one of its field.
    """
    assert isinstance(kind, type)
    known = {name: field for name, field in fields_of(kind).items() if name in values}
    try:
        given = {
            name: msgspec.convert(values[name], field.hint, dec_hook=_made)
            for name, field in known.items()
        }
    except msgspec.ValidationError as error:
        raise ConfigError(f"the emulator's {kind.__name__}: {error}") from error
    model: Model = kind(**given)
    return model


def restored_operator(values: Mapping[str, Any] | None) -> Operator | None:
    """Return the operator of a document with its kind and parameters; None without one."""
    return None if values is None else restored(OPERATORS[values["kind"]], values)


def _made(kind: type, value: Any) -> Any:  # a path is the only type here that JSON does not have
    return kind(value)
