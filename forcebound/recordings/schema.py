"""JSON schemas of recorded packets, with units, for Foxglove and PlotJuggler.

They are msgspec's with one type per field, since Foxglove rejects a list of types, and without
arrays within arrays (the points of a path), which it rejects, too.
"""

from collections.abc import Mapping, Sequence
from typing import Annotated, Any, TypeAlias, get_args, get_origin

import msgspec
from msgspec.json import schema_components

from forcebound.axes import Axis, units_on
from forcebound.errors import ConfigError
from forcebound.messages.packets import Meaning, Packet, field_types
from forcebound.messages.topology import HAND, nested
from forcebound.recordings.launched import launched

#: A JSON schema, or the schemas of several fields by their names.
Schema: TypeAlias = dict[str, Any]

#: Fields that are left out of a message when they are empty, or that older recordings lack.
ABSENT: dict[str, object] = {"hand": HAND, "proxies": {}}

_KEPT = ("type", "items", "minItems", "maxItems", "properties", "additionalProperties", "required")

#: What the parts of a run publish: meanings of numbers by topic and name.
DeclaredSignals: TypeAlias = Mapping[str, Mapping[str, Meaning]]


def declared_signals(metadata: Mapping[str, str]) -> DeclaredSignals:
    """Return the signals that the metadata of a recording declares; ConfigError if damaged."""
    try:
        text = metadata.get("signals", "{}")
        return msgspec.json.decode(text, type=dict[str, dict[str, Meaning]])
    except (msgspec.MsgspecError, ValueError) as error:
        raise ConfigError(f"the recording's list of signals is damaged ({error})") from error


def declared_axes(metadata: Mapping[str, str]) -> dict[str, tuple[Axis, ...]]:
    """Return the axes that the launch file in the metadata of a recording names, by hand."""
    try:
        document = msgspec.json.decode(metadata.get("launch", "{}"), type=dict[str, Any])
        return {name: hand.axes for name, hand in launched(nested(document)).hands.items()}
    except (msgspec.MsgspecError, ValueError):
        return {}  # whoever reads the launch file says so


def schema(
    packet: type[Packet],
    signals: Mapping[str, Meaning] | None = None,
    axes: Sequence[Axis] = (),
) -> Schema:
    """Return the jsonschema of a packet: types, units and meaning of its fields and signals.

    ``axes`` are those of its hand, if they have names: they say the units.
    """
    _, rules = schema_components([packet])
    types, described = field_types(packet), rules[packet.__name__]
    fields: Schema = {
        name: _plain(field, rules) | _described(field["description"], units_on(axes, field["unit"]))
        for name, field in ((name, described["properties"][name]) for name in types)
    }
    for name, (text, unit) in (signals or {}).items():
        fields["signals"]["properties"][name] = {"type": "number", **_described(text, unit)}
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": f"forcebound.{packet.__name__}",
        "description": described["description"].partition("\n")[0],
        "type": "object",
        "properties": fields,
        "required": [n for n, hint in types.items() if not is_optional(hint) and n not in ABSENT],
    }


def is_optional(hint: Any) -> bool:
    """Return whether a field may have no value."""
    plain = hint.__origin__ if get_origin(hint) is Annotated else hint
    return not {type(None), msgspec.UnsetType}.isdisjoint(get_args(plain))


def _described(text: str, unit: str) -> dict[str, str]:
    """Return text and unit; a program that shows only descriptions shows both."""
    return {"description": f"{text}, {unit}", "unit": unit} if unit else {"description": text}


def _plain(rule: Schema, rules: Schema) -> Schema:
    """Return a rule of msgspec's with one type, and what it refers to in its place."""
    rule = rules[rule["$ref"].rpartition("/")[2]] if "$ref" in rule else rule
    rule = rule["anyOf"][0] if "anyOf" in rule else rule  # the other: null
    found: Schema = {"type": "string"} | {
        key: rule[key] for key in _KEPT if key in rule
    }  # of an enum
    if "prefixItems" in rule:
        found["items"] = rule["prefixItems"][0]
    if "items" in found:
        found["items"] = _plain(found["items"], rules)
    if found["type"] == "object":  # Foxglove reads ``properties`` of every object
        inner = found.get("properties", {}).items()
        found["properties"] = {n: _plain(one, rules) for n, one in inner if n != "points"}
    if "additionalProperties" in found:
        found["additionalProperties"] = _plain(found["additionalProperties"], rules)
    return found
