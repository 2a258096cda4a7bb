"""JSON schemas of recorded packets, with units, for Foxglove and PlotJuggler.

They use one type per field, since Foxglove rejects a list of types, and say nothing of arrays
within arrays (the points of a path), which it rejects, too.
"""

from collections.abc import Mapping
from typing import Annotated, Any, Literal, TypeAlias, get_args, get_origin, get_type_hints

import msgspec

from forcebound.errors import ConfigError
from forcebound.messages.packets import (
    MAX_AXES,
    Meaning,
    Packet,
    Point,
    Quaternion,
    Vector,
    field_types,
    meanings,
)
from forcebound.messages.topology import HAND

#: Fields that are left out of a message when they are empty, or that older recordings lack.
ABSENT: dict[str, Any] = {"hand": HAND, "proxies": {}}

#: What the parts of a run publish: meanings of numbers by topic and name.
Signals: TypeAlias = Mapping[str, Mapping[str, Meaning]]


def declared_signals(metadata: Mapping[str, str]) -> Signals:
    """Return the signals that the metadata of a recording declares; ConfigError if damaged."""
    try:
        text = metadata.get("signals", "{}")
        return msgspec.json.decode(text, type=dict[str, dict[str, Meaning]])
    except (msgspec.MsgspecError, ValueError) as error:
        raise ConfigError(f"the recording's list of signals is damaged ({error})") from error


def schema(packet: type[Packet], signals: Mapping[str, Meaning] | None = None) -> dict[str, Any]:
    """Return the jsonschema of a packet: types, units and meaning of its fields and signals."""
    types, meaning = field_types(packet), meanings(packet)
    fields = {name: _field_schema(hint) | _described(meaning[name]) for name, hint in types.items()}
    for name, about in (signals or {}).items():
        fields["signals"]["properties"][name] = {"type": "number", **_described(about)}
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": f"forcebound.{packet.__name__}",
        "description": (packet.__doc__ or "").strip().splitlines()[0],
        "type": "object",
        "properties": fields,
        "required": [n for n, hint in types.items() if not is_optional(hint) and n not in ABSENT],
    }


def _described(meaning: Meaning) -> dict[str, str]:
    """Return text and unit; a program that shows only descriptions shows both."""
    text, unit = meaning
    return {"description": f"{text}, {unit}", "unit": unit} if unit else {"description": text}


def is_optional(hint: Any) -> bool:
    """Return whether a field may have no value."""
    return not {type(None), msgspec.UnsetType}.isdisjoint(get_args(_unlimited(hint)))


def plain_type(hint: Any) -> Any:
    """Return the type of a field that has a value."""
    return get_args(_unlimited(hint))[0] if is_optional(hint) else hint


def _unlimited(hint: Any) -> Any:
    return hint.__origin__ if get_origin(hint) is Annotated else hint


def _field_schema(hint: Any) -> dict[str, Any]:
    plain = plain_type(hint)
    if plain is int:
        return {"type": "integer"}
    if plain is float:
        return {"type": "number"}
    if plain is bool:
        return {"type": "boolean"}
    if plain is str:
        return {"type": "string"}
    if plain == Vector:
        return _numbers(1, MAX_AXES)
    if plain in (Point, Quaternion):
        return _numbers(len(get_args(plain)), len(get_args(plain)))
    if get_origin(plain) is Literal:
        return {"type": "string"}
    if get_origin(plain) is tuple:
        return {"type": "array", "items": _object_schema(get_args(plain)[0])}
    # Foxglove reads ``properties`` of every object, also of an empty one.
    _, entry = get_args(plain)
    return {"type": "object", "properties": {}, "additionalProperties": _field_schema(entry)}


def _numbers(fewest: int, most: int) -> dict[str, Any]:
    return {"type": "array", "items": {"type": "number"}, "minItems": fewest, "maxItems": most}


def _object_schema(kind: type[msgspec.Struct]) -> dict[str, Any]:
    hints = get_type_hints(kind)
    described = {name: _field_schema(hints[name]) for name in hints if name != "points"}
    required = [field.name for field in msgspec.structs.fields(kind) if field.required]
    return {"type": "object", "properties": described, "required": required}
