"""The reference page of all keys of launch files, from their schema; `make reference` writes it."""

import dataclasses
import inspect
import json
import re
from collections.abc import Iterator, Mapping
from typing import Any, get_args

from forcebound.graph.document import descriptions
from forcebound.graph.fields import fields_of
from forcebound.graph.graph import (
    KINDS,
    PHASE_KEYS,
    SECTION_SETTINGS,
    EnvironmentConfig,
    GraphConfig,
    Phase,
    RealtimeConfig,
    RemoteConfig,
)
from forcebound.graph.names import RUN_KEYS
from forcebound.graph.schema import SUBSTITUTION, properties
from forcebound.graph.servo import ServoSettings
from forcebound.haptics.geometry.proxy import Surface
from forcebound.messages.topology import IMPAIRABLE
from forcebound.network.impairment import GilbertElliott, Impairment, Outage, Spike
from forcebound.network.presets import PRESETS
from forcebound.observe.formatting import meanings

_HEAD = """# Keys of launch files

This page is made from the schema: `make reference` writes it. The
[tutorial](tutorial.md) shows a launch file; `forcebound schema` prints the schema for an editor.

Every value has a path, its keys joined by dots. On the command line `PATH:=VALUE` puts a value in the
place of that of the file, as `NAME:=VALUE` does for an argument: `forcebound simulate stiff_wall
environment.stiffness:="2 N/mm" device.rate:="2 kHz"`. It is checked as if it stood in the file.

A quantity is a number in the SI unit below, or text with a unit (`10 N/mm`, `5 ms`, `40 %`). A key
without a default must be given. Relative paths start from the folder of the file that names them. A
key that another kind of the section has with the same default is explained there.

| key at the top | value | default | meaning |
|---|---|---|---|
| `forcebound` | 1 |  | version of the format |
| `include` | text | none | launch file that this one builds on: what this file says wins, key by key |
| `identified` | mapping | none | written by `forcebound identify`: where the numbers of `device` come from; no run reads it |
| `arguments` | mapping | none | `name: default` or `name: { default, help, choices }`; used as `$(arg name)` |
"""  # noqa: E501

_TAIL = """
**Next**: [what a run's figures mean](results.md).
"""

_COLUMNS = ("| key | value | default | meaning |", "|---|---|---|---|")


def reference_page() -> str:
    """Return the page in Markdown."""
    return _HEAD + "\n".join(_lines()) + "\n" + _TAIL


_HANDS = """
## `hands`

Several hands in one environment, 1 to 8 of them: two users, a leader and a follower. What one hand
has at the top of a file (`device`, `operator`, `controller`, `links`, `remote`) each has below its
name; the rest belongs to all. A name is a word of letters, digits and `_` that is no section. The
hand of a file without `hands` is called `hand`; one of several cannot have this name.

```yaml
hands:
  left: { include: stiff_wall } # a file of one hand: its sections and arguments
  right:
    include: stiff_wall
    device: { law: none } # what this file says wins, key by key
    links: { environment_query: { delay: 2 ms } }
environment: { kind: wall, stiffness: 10 N/mm, position: 10 mm }
```

`default` is no hand but what a file says of all hands, those of the file that it includes, too.
What the same file says of one hand wins. So two equal arms stand in a file once:

```yaml
# two_arms.yaml
forcebound: 1
include: leader_follower_transfer.yaml
arguments: { rate: 500 Hz }
hands:
  default: { device: { kind: serial_arm, rate: $(arg rate) } } # or kind and include: arm.yaml
  leader: { device: { energy_partner: follower } }
  follower: { device: { energy_partner: leader } }
```

An included file of a device has its keys, or a section `device:` with them, as
`forcebound identify` writes it; `$(arg name)` in it is an argument of the launch file. YAML's own
anchors (`&arm`, `*arm`) are refused: an alias could repeat itself without end.

* All devices have the same number of axes, of the same kinds, and ports of their own.
* Of an included file only the sections of a hand and the `arguments` are taken. An argument that
  several files have is one: `delay:="2 ms"` sets it for all of them.
* The path of a hand's value begins with its name: `left.device.law`, or `hands.left.device.law`,
  `right.links.force_command.loss`; so on the command line, in `param set` and in the settings of a
  phase. Nodes and topics are `left/device`, `left/telemetry`. Names of what belongs to an only hand
  `hand` leave it out: `device.law`, `device`, `telemetry`.
* If a device with `on_loss: wait` is lost, the other hands keep their force; one that does not wait
  ends the run of all.
"""


def _lines() -> Iterator[str]:
    yield from _rows(GraphConfig, RUN_KEYS)
    yield from _shipped()
    yield from _HANDS.rstrip().split("\n")
    for section, table in KINDS.items():
        known: dict[str, str] = {}  # rows of the section, and the kind that has them first
        yield from ("", f"## `{section}`")
        if section == "device":
            yield from _table(ServoSettings, "Beside the keys of its kind, those of the servo:")
        elif section == "environment":
            own = tuple(SECTION_SETTINGS[section])
            yield from _table(EnvironmentConfig, "Beside the keys of its kind:", own)
            yield from _inner(EnvironmentConfig, own)
            yield from ("", "### `surface`", *_table(Surface))
        for name in sorted(table):
            yield from ("", f"### `kind: {name}`", *_table(table[name], known=known, at=name))
            yield from _inner(table[name], known=known, at=name)
    topics = ", ".join(f"`{topic}`" for topic in IMPAIRABLE)
    words = f"By topic: {topics}. A topic that is not named is perfect."
    yield from ("", "## `links`", *_table(Impairment, words))
    names, meaning = " or ".join(f"`{name}`" for name in PRESETS), "[named network](impairments.md)"
    yield f"| `preset` | {names} | none | {meaning}: defaults of the other keys |"
    for key, part in (("gemodel", GilbertElliott), ("outages", Outage), ("spikes", Spike)):
        yield from ("", f"### `{key}`", *_table(part))
    for section, settings in (("realtime", RealtimeConfig), ("remote", RemoteConfig)):
        yield from ("", f"## `{section}`", *_table(settings))
    yield from (
        "",
        "## `phases`",
        *_table(Phase, "A list; the run is as long as its phases.", PHASE_KEYS),
    )
    yield "| `set` | mapping | {} | parameters by name, such as `links.environment_reply.delay` |"


def _shipped() -> Iterator[str]:
    yield from ("", "## Files that come with forcebound", "")
    yield "`forcebound launch NAME` runs one; `forcebound launch` lists them."
    for group, named in descriptions().items():
        yield from ("", f"| {group} | |", "|---|---|")
        yield from (f"| `{name}` | {words} |" for name, words in named.items())


def _inner(
    kind: type,
    names: tuple[str, ...] | None = None,
    before: str = "",
    known: dict[str, str] | None = None,
    at: str = "",
) -> Iterator[str]:
    """The tables of the keys of a dataclass that are mappings with keys of their own."""
    level = "####" if at else "###"  # under a kind, or under the section itself
    for field in fields_of(kind, names).values():
        for part in _dataclasses(field.hint):
            place = f"{before}{field.name}"
            if known is not None and all(f"{place} {row}" in known for row in _rows(part)):
                first = known[f"{place} {next(_rows(part))}"]
                yield from ("", f"`{place}`: as of `kind: {first}`.")
            else:
                yield from ("", f"{level} `{place}`", *_table(part, "", None, known, at, place))
            yield from _inner(part, None, f"{place}.", known, at)


def _dataclasses(hint: Any) -> Iterator[type]:
    for part in get_args(hint):
        if dataclasses.is_dataclass(part) and isinstance(part, type):
            yield part
        else:
            yield from _dataclasses(part)


def _table(
    kind: type,
    words: str = "",
    names: tuple[str, ...] | None = None,
    known: dict[str, str] | None = None,
    at: str = "",
    place: str = "",
) -> Iterator[str]:
    """The keys of a dataclass, after some words or its own summary; known rows in words."""
    rows, same = [], dict[str, list[str]]()
    for row in _rows(kind, names):
        first = (known if known is not None else {}).setdefault(f"{place} {row}".strip(), at)
        if first == at:
            rows.append(row)
        else:
            same.setdefault(first, []).append(row.split(" | ")[0].removeprefix("| "))
    yield from ("", words or _summary(kind))
    if rows:
        yield from ("", *_COLUMNS, *rows)
    for first, keys in same.items():
        yield from ("", f"As of `kind: {first}`: {', '.join(keys)}.")


def _rows(kind: type, names: tuple[str, ...] | None = None) -> Iterator[str]:
    described = meanings(kind)
    fields = fields_of(kind, names)
    for name, schema in properties(fields).items():
        field = fields[name]
        default = "" if field.required else _shown(field.default)
        value = _words(schema).replace("|", "\\|")
        yield f"| `{name}` | {value} | {default} | {_plain(described.get(name, ''))} |"


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


if __name__ == "__main__":
    print(reference_page(), end="")
