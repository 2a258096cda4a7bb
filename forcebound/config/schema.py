"""The JSON schema of launch files, for completion and checks in editors.

It is less strict than the loader: a key that an included file may give is not required here, and
units are text. What it refuses, the loader refuses too.
"""

from collections.abc import Mapping
from typing import Any

from forcebound.bounding import LAWS
from forcebound.config.fields import Field, adapter, fields_of
from forcebound.config.graph import (
    COMPUTATION,
    FORMAT,
    KINDS,
    RUN_KEYS,
    EnvironmentConfig,
    GraphConfig,
    RealtimeConfig,
    RemoteConfig,
)
from forcebound.config.phases import PhaseHead
from forcebound.messages.packets import LINKS
from forcebound.network.impairment import Impairment
from forcebound.nodes.device import ServoSettings

SUBSTITUTION = {"type": "string", "pattern": r"\$[({]", "description": "$(arg x) or ${env:X}"}
_FILE_KIND = {"type": "string", "pattern": r"\.py(:[A-Za-z_][A-Za-z0-9_]*)?$"}  # of the user's own
_SCALAR = {"type": ["string", "number", "boolean", "null"]}


def json_schema() -> dict[str, Any]:
    """Return the JSON schema (draft 2020-12) of a launch file; a quantity is a number or text."""
    beside: dict[str, dict[str, Any]] = {
        "device": properties(fields_of(ServoSettings)),
        "environment": properties(fields_of(EnvironmentConfig, COMPUTATION)),
    }
    link = _mapping(properties(fields_of(Impairment)))
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "forcebound launch file",
        **_mapping(
            {
                "forcebound": {"const": FORMAT, "description": "version of the format"},
                "include": {"type": "string", "description": "launch file to lie beneath this one"},
                "arguments": {"type": ["object", "null"], "additionalProperties": _argument()},
                **properties(fields_of(GraphConfig, RUN_KEYS)),
                **{name: _kinds(name, beside.get(name, {})) for name in KINDS},
                "links": _mapping(dict.fromkeys(LINKS, link)),
                "realtime": _mapping(properties(fields_of(RealtimeConfig))),
                "remote": _mapping(properties(fields_of(RemoteConfig))),
                "phases": {"type": "array", "items": _phase()},
            }
        ),
        "required": ["forcebound"],
    }


def _mapping(properties: Mapping[str, Any]) -> dict[str, Any]:
    return {
        "type": ["object", "null"],
        "properties": dict(properties),
        "additionalProperties": False,
    }


def _argument() -> dict[str, Any]:
    declared = _mapping(
        {
            "default": _SCALAR,
            "help": {"type": "string"},
            "choices": {"type": "array", "items": _SCALAR},
        }
    )
    return {"anyOf": [_SCALAR, declared]}


def _phase() -> dict[str, Any]:
    phase = _mapping(properties(fields_of(PhaseHead)))
    phase["properties"]["set"] = {"type": ["object", "null"]}
    return phase


def _kinds(section: str, beside: Mapping[str, Any]) -> dict[str, Any]:
    """One alternative for each kind; the kind itself may come from an included file."""
    alternatives = []
    for name, kind in sorted(KINDS[section].usable().items()):
        chosen = {"kind": {"anyOf": [{"const": name}, SUBSTITUTION]}}
        alternatives.append(_mapping({**chosen, **properties(fields_of(kind)), **beside}))
    # In a user's file any parameters: only that file knows them.
    known = {"kind": _FILE_KIND, **beside}
    alternatives.append({"type": "object", "properties": known, "required": ["kind"]})
    return {"anyOf": alternatives}


def properties(fields: Mapping[str, Field]) -> dict[str, Any]:
    """Return the schema of each of some fields, by name."""
    return {name: _property(field) for name, field in fields.items()}


def _inlined(schema: Any, definitions: Mapping[str, Any]) -> Any:
    """Return a schema with what it refers to in place of the references."""
    if isinstance(schema, list):
        return [_inlined(entry, definitions) for entry in schema]
    if not isinstance(schema, Mapping):
        return schema
    if "$ref" in schema:
        return _inlined(definitions[schema["$ref"].rpartition("/")[2]], definitions)
    return {name: _inlined(entry, definitions) for name, entry in schema.items()}


def _property(field: Field) -> dict[str, Any]:
    schema = adapter(field).json_schema()
    schema = _inlined(schema["properties"][field.name], schema.get("$defs", {}))
    if field.name == "law":
        schema = {"anyOf": [{"enum": sorted(LAWS)}, _FILE_KIND]}
    described: dict[str, Any] = {"anyOf": [schema, SUBSTITUTION]}
    if not field.required and isinstance(field.default, str | int | float):
        described["default"] = field.default
    return described
