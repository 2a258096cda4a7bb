"""The JSON schema of launch files, for editors.

The schema is less strict than the loader: a key that an included file may give is not required
here, and units are text. What it refuses, the loader refuses too.
"""

import dataclasses
import inspect
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from forcebound.graph.fields import Field, fields_of
from forcebound.graph.graph import FORMAT, KINDS, SECTION_SETTINGS, GraphConfig
from forcebound.graph.model import LINK, PHASE, PHASES, SETTINGS
from forcebound.graph.names import RUN_KEYS
from forcebound.haptics.laws import LAWS
from forcebound.messages.topology import HAND_SECTIONS, HANDS, IMPAIRABLE
from forcebound.quantities import Range, Unit
from forcebound.recordings.schema import Schema

SUBSTITUTION = {"type": "string", "pattern": r"\$[({]", "description": "$(arg x) or ${env:X}"}
_FILE_KIND = {"type": "string", "pattern": r"\.py(:[A-Za-z_][A-Za-z0-9_]*)?$"}  # a user's file
_WITH_NUMBERS = {"type": "string", "pattern": r"^\w+\(.*\)$"}  # a law, as energy_tank(refill=20)
_TYPES: Mapping[Any, Schema] = {
    bool: {"type": "boolean"},
    float: {"type": "number"},
    int: {"type": "integer"},
    str: {"type": "string"},
    Path: {"type": "string", "format": "path"},
    type(None): {"type": "null"},
}
_SCALAR = {"type": ["string", "number", "boolean", "null"]}


def json_schema() -> Schema:
    """Return the JSON schema (draft 2020-12) of a launch file; a quantity is a number or text."""
    argument = {
        "default": _SCALAR,
        "help": {"type": "string"},
        "choices": {"type": "array", "items": _SCALAR},
    }
    links = {topic: _mapping(properties(LINK)) for topic in IMPAIRABLE}
    fixed = {name: _mapping(properties(fields_of(kind))) for name, kind in SETTINGS.items()}
    phases = {"type": "array", "items": _mapping(properties(PHASE.fields))}
    hand = {name: _kinds(name) for name in KINDS if name in HAND_SECTIONS}
    hand |= {"links": _mapping(links), "remote": fixed.pop("remote")}
    hand["axes"] = {"type": "array", "description": "of a resolved document, with names"}
    of_a_hand = {"include": {"type": "string", "description": "launch file of one hand"}, **hand}
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "forcebound launch file",
        **_mapping(
            {
                "forcebound": {"const": FORMAT, "description": "version of the format"},
                "include": {"type": "string", "description": "launch file that this one overrides"},
                "identified": {"type": "object", "description": "where its numbers come from"},
                "units": {"type": "object", "description": "of a resolved document, for people"},
                "arguments": {
                    "type": ["object", "null"],
                    "additionalProperties": {"anyOf": [_SCALAR, _mapping(argument)]},
                },
                **properties(fields_of(GraphConfig, RUN_KEYS)),
                "environment": _kinds("environment"),
                **hand,
                HANDS: {"type": "object", "additionalProperties": _mapping(of_a_hand)},
                **fixed,
                PHASES: phases,
            }
        ),
        "required": ["forcebound"],
    }


def _mapping(properties: Schema) -> Schema:
    return {
        "type": ["object", "null"],
        "properties": dict(properties),
        "additionalProperties": False,
    }


def _kinds(section: str) -> Schema:
    """One alternative for each kind; the kind itself may come from an included file."""
    beside = properties(SECTION_SETTINGS.get(section, {}))
    if section == "device":
        beside["include"] = {"type": ["string", "null"]}
    alternatives = []
    for name, kind in sorted(KINDS[section].usable().items()):
        chosen = {"kind": {"anyOf": [{"const": name}, SUBSTITUTION]}}
        alternatives.append(_mapping({**chosen, **properties(fields_of(kind)), **beside}))
    # In a user's file any parameters: only that file knows them.
    known = {"kind": _FILE_KIND, **beside}
    alternatives.append({"type": "object", "properties": known, "required": ["kind"]})
    return {"anyOf": alternatives}


def properties(fields: Mapping[str, Field]) -> Schema:
    """Return the schema of each of some fields, by name."""
    found = {}
    for name, field in fields.items():
        value = _schema(field.hint)
        if field.name == "law":
            value = {"anyOf": [{"enum": sorted(LAWS)}, _FILE_KIND, _WITH_NUMBERS]}
        described: Schema = {"anyOf": [value, SUBSTITUTION]}
        if not field.required and isinstance(field.default, str | int | float):
            described["default"] = field.default
        found[name] = described
    return found


def _schema(hint: Any) -> Schema:
    """Return the schema of a type."""
    origin, arguments = get_origin(hint), get_args(hint)
    if origin is Annotated:
        return _noted(arguments[0], arguments[1:])
    if origin in (Union, UnionType):
        return {"anyOf": [_schema(one) for one in arguments]}
    if origin is Literal:
        return {"enum": list(arguments)}
    if origin in (tuple, list, Sequence):
        if origin is tuple and arguments[-1] is not ...:
            items = [_schema(one) for one in arguments]
            many = {"minItems": len(items), "maxItems": len(items)}
            return {"type": "array", "prefixItems": items, **many}
        return {"type": "array", "items": _schema(arguments[0])}
    if origin in (dict, Mapping):
        return {"type": "object", "additionalProperties": _schema(arguments[1])}
    if dataclasses.is_dataclass(hint):
        fields = fields_of(hint if isinstance(hint, type) else type(hint))
        described = {"properties": {n: _inner(one) for n, one in fields.items()}}
        required = [n for n, one in fields.items() if one.required]
        words = {"description": inspect.getdoc(hint)} | ({"required": required} if required else {})
        return {"type": "object", "additionalProperties": False, **described, **words}
    return dict(_TYPES.get(hint, {}))


def _inner(field: Field) -> Schema:
    value = _schema(field.hint)
    if not field.required and isinstance(field.default, str | int | float | None):
        value["default"] = field.default
    return value


def _noted(hint: Any, notes: Sequence[Any]) -> Schema:
    """The schema of a type with notes: text with a unit could have no other limits than words."""
    symbols = [note.symbol for note in notes if isinstance(note, Unit)]
    found = _schema(hint) if not symbols else {"anyOf": [_TYPES[float], _TYPES[str]]}
    words = [note.describe() for note in notes if isinstance(note, Unit)]
    words += [note.describe("".join(symbols)) for note in notes if isinstance(note, Range)]
    return found | ({"description": "; ".join(words)} if words else {})
