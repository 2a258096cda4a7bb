"""The JSON schema of launch files, for editors, and the reference page that is made from it.

The schema is less strict than the loader: a key that an included file may give is not required
here, and units are text. What it refuses, the loader refuses too.
"""

import dataclasses
import inspect
import json
import re
from collections.abc import Iterator, Mapping
from typing import Any, get_args

from forcebound.bounding import LAWS
from forcebound.config.fields import Field, adapter, fields_of
from forcebound.config.graph import (
    BESIDE_MODEL,
    FORMAT,
    KINDS,
    RUN_KEYS,
    EnvironmentConfig,
    GraphConfig,
    RealtimeConfig,
    RemoteConfig,
)
from forcebound.config.phases import PhaseHead
from forcebound.geometry.proxy import Surface
from forcebound.messages.packets import LINKS
from forcebound.network.impairment import GilbertElliott, Impairment, Outage, Slot
from forcebound.nodes.servo import ServoSettings

SUBSTITUTION = {"type": "string", "pattern": r"\$[({]", "description": "$(arg x) or ${env:X}"}
_FILE_KIND = {"type": "string", "pattern": r"\.py(:[A-Za-z_][A-Za-z0-9_]*)?$"}  # of the user's own
_SCALAR = {"type": ["string", "number", "boolean", "null"]}


def json_schema() -> dict[str, Any]:
    """Return the JSON schema (draft 2020-12) of a launch file; a quantity is a number or text."""
    beside: dict[str, dict[str, Any]] = {
        "device": {**properties(fields_of(ServoSettings)), "include": {"type": ["string", "null"]}},
        "environment": properties(fields_of(EnvironmentConfig, BESIDE_MODEL)),
    }
    link = _mapping(properties(fields_of(Impairment)))
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "forcebound launch file",
        **_mapping(
            {
                "forcebound": {"const": FORMAT, "description": "version of the format"},
                "include": {"type": "string", "description": "launch file to lie beneath this one"},
                "identified": {"type": "object", "description": "where its numbers come from"},
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


_HEAD = """# Keys of launch files

This page is made from the schema: `make reference` writes it. The
[tutorial](tutorial.md) shows a launch file; `forcebound schema` prints the schema for an editor.

A quantity is a number in the SI unit below, or text with a unit (`10 N/mm`, `5 ms`, `40 %`). A key
without a default must be given. Relative paths start from the folder of the file that names them.

| key at the top | value | default | meaning |
|---|---|---|---|
| `forcebound` | 1 |  | version of the format |
| `include` | text | none | launch file beneath this one: what this file says wins, key by key |
| `identified` | mapping | none | written by `forcebound identify`: where the numbers of `device` come from; no run reads it |
| `arguments` | mapping | none | `name: default` or `name: { default, help, choices }`; used as `$(arg name)` |
"""  # noqa: E501

_COLUMNS = ("| key | value | default | meaning |", "|---|---|---|---|")


def reference_page() -> str:
    """Return the page in Markdown."""
    return _HEAD + "\n".join(_lines()) + "\n"


def _lines() -> Iterator[str]:
    yield from _rows(GraphConfig, RUN_KEYS)
    for section, table in KINDS.items():
        yield from ("", f"## `{section}`")
        if section == "device":
            yield from _table(ServoSettings, "Beside the keys of its kind, those of the servo:")
        elif section == "environment":
            yield from _table(EnvironmentConfig, "Beside the keys of its kind:", BESIDE_MODEL)
            yield from _inner(EnvironmentConfig, BESIDE_MODEL)
            yield from ("", "### `surface`", *_table(Surface))
        for name in sorted(table):
            yield from ("", f"### `kind: {name}`", *_table(table[name]))
            yield from _inner(table[name])
    topics = ", ".join(f"`{topic}`" for topic in LINKS)
    words = f"By topic: {topics}. A topic that is not named is perfect."
    yield from ("", "## `links`", *_table(Impairment, words))
    for key, part in (("gemodel", GilbertElliott), ("slot", Slot), ("outages", Outage)):
        yield from ("", f"### `{key}`", *_table(part))
    for section, settings in (("realtime", RealtimeConfig), ("remote", RemoteConfig)):
        yield from ("", f"## `{section}`", *_table(settings))
    yield from ("", "## `phases`", *_table(PhaseHead, "A list; the run is as long as its phases."))
    yield "| `set` | mapping | {} | parameters by name, such as `links.environment_reply.delay` |"


def _inner(kind: type, names: tuple[str, ...] | None = None, before: str = "") -> Iterator[str]:
    """The tables of the keys of a dataclass that are mappings with keys of their own."""
    for field in fields_of(kind, names).values():
        for part in _dataclasses(field.hint):
            place = f"{before}{field.name}"
            yield from ("", f"#### `{place}`", *_table(part))
            yield from _inner(part, before=f"{place}.")


def _dataclasses(hint: Any) -> Iterator[type]:
    for part in get_args(hint):
        if dataclasses.is_dataclass(part) and isinstance(part, type):
            yield part
        else:
            yield from _dataclasses(part)


def _table(kind: type, words: str = "", names: tuple[str, ...] | None = None) -> Iterator[str]:
    """The keys of a dataclass, beneath some words or its own summary."""
    rows = list(_rows(kind, names))
    yield from ("", words or _summary(kind))
    if rows:
        yield from ("", *_COLUMNS, *rows)


def _rows(kind: type, names: tuple[str, ...] | None = None) -> Iterator[str]:
    meanings = _meanings(kind)
    fields = fields_of(kind, names)
    for name, schema in properties(fields).items():
        field = fields[name]
        default = "" if field.required else _shown(field.default)
        value = _words(schema).replace("|", "\\|")
        yield f"| `{name}` | {value} | {default} | {_plain(meanings.get(name, ''))} |"


def _shown(default: Any) -> str:
    if default in ((), None) or isinstance(default, Mapping):
        return "none"
    if isinstance(default, bool):
        return str(default).lower()
    if any(map(dataclasses.is_dataclass, default if isinstance(default, tuple) else (default,))):
        return "built in"
    return f"{default:g}" if isinstance(default, float) else str(default) or "empty"


def _words(schema: Mapping[str, Any]) -> str:
    """What a property may be."""
    if schema.get("type") == "object":
        return "mapping"
    if "description" in schema:  # of a number: the head of the page says what units are
        words = re.sub(r"; or with its unit, e\.g\. [^;]*", "", schema["description"])
        return f"whole number {words}" if schema.get("type") == "integer" else words
    if "anyOf" in schema:
        options = [_words(option) for option in schema["anyOf"] if option != SUBSTITUTION]
        return " or ".join(dict.fromkeys(options))
    if "enum" in schema or "const" in schema:
        options = schema.get("enum", [schema.get("const")])
        return " or ".join(f"`{json.dumps(o) if not isinstance(o, str) else o}`" for o in options)
    if schema.get("format") == "path":
        return "path"
    kinds = {"integer": "whole number", "string": "text", "boolean": "`true` or `false`"}
    kinds |= {"array": "list", "null": "null"}
    return kinds.get(schema.get("type", ""), str(schema.get("type", "any value")))


def _summary(kind: type) -> str:
    text = inspect.getdoc(kind) or ""
    text = re.split(r"\n\n|\n(?=[A-Z]\w+:\n)", text)[0]
    return _plain(text.replace("\n", " "))


def _plain(text: str) -> str:
    """Markdown of a docstring."""
    text = re.sub(r":\w+:`~?([^`]*)`", r"``\1``", text)
    return text.replace("``", "`").replace("|", "\\|")


def _meanings(kind: type) -> dict[str, str]:
    """The attributes that a docstring explains."""
    meanings: dict[str, str] = {}
    for base in reversed(kind.__mro__):
        _, _, after = (inspect.cleandoc(base.__doc__ or "")).partition("Attributes:\n")
        section = after.partition("\n\n")[0]
        for entry in re.split(r"\n(?=    \w)", f"\n{section}"):
            name, colon, text = entry.strip().partition(": ")
            if colon and name.isidentifier():
                meanings[name] = " ".join(text.split())
    return meanings
