"""One part of a graph: the model that a section names, also without a launch file around it."""

from collections.abc import Collection, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from forcebound.bounding import LAWS
from forcebound.config.device_file import WHAT
from forcebound.config.document import MAX_BYTES
from forcebound.config.fields import Section, fields_of
from forcebound.config.graph import KINDS
from forcebound.config.problems import Place, Problems, unknown
from forcebound.config.tree import Value, parse, scalar
from forcebound.config.user_parts import can_be_written, find_class
from forcebound.errors import ConfigError
from forcebound.files import read_text


def model_of(section: Section, beside: Collection[str] = ()) -> Any:
    """Return the model of the kind that a section names; None if a problem was noted.

    Args:
        section: Of a part.
        beside: Keys that stand there and are not the model's.
    """
    taken = {"kind", *beside}
    table = KINDS[section.name]
    kind = section.choose(f"{section.name} kind", "kind", table) if section.is_readable else None
    if kind is None:
        return None
    if table.is_shipped(kind):
        model = table[kind]
    else:
        model = find_class(section, section.value.entries["kind"], table, taken)
    if model is None:
        return None
    section.check_keys({*fields_of(model), *taken})
    made = section.make(model)
    return made if made is None or can_be_written(made, section) else None


def member_of(section: str, kind: str, overrides: Sequence[str] = ()) -> Any:
    """Return one part by itself, such as an environment, outside any launch file.

    Args:
        section: ``"device"``, ``"operator"``, ``"controller"`` or ``"environment"``.
        kind: As in a launch file; a relative path starts from the current folder.
        overrides: Its parameters, each ``name:=value``.

    Raises:
        ConfigError: If there is no such kind or a parameter is wrong.
    """
    problems = Problems()
    entries = {"kind": Value(kind, Place(section), text=kind)}
    for text in overrides:
        place = Place(f"argument {text}")
        name, separator, word = text.partition(":=")
        if not separator:
            problems.add("expected name:=value", place)
        elif name in entries:
            problems.add(f"{name!r} is given twice, or is no parameter", place)
        else:
            entries[name] = Value(scalar(word.strip()), place, text=word.strip())
    value = Value(entries, Place(section))
    made = model_of(Section(value, section, value, problems))
    problems.raise_if_any()
    return made


def device_of(path: Path, without: Collection[str]) -> Any:
    """Return the device of a file, as :func:`member_of` does, but for some of its parameters.

    Raises:
        ConfigError: If it cannot be read, has no device, or anything is wrong with that.
    """
    problems = Problems()
    root = parse(read_text(path, WHAT, MAX_BYTES), str(path), problems)
    problems.raise_if_any()
    section = None if root is None else root.entries.get("device")
    if section is None or "kind" not in section.entries:
        raise ConfigError(f"{path} has no section device: with a kind")
    rest = {name: one for name, one in section.entries.items() if name not in without}
    value = replace(section, content=rest)
    made = model_of(Section(value, "device", value, problems))
    problems.raise_if_any()
    return made


def law_of(kind: str) -> str:
    """Return a law's kind, absolute if it is in a file; a relative path starts from here.

    Raises:
        ConfigError: If there is no such law.
    """
    if kind not in LAWS:
        raise ConfigError(unknown("law", kind, LAWS))
    law = LAWS.resolve(kind, Path())
    LAWS[law]  # a file is loaded, and checked
    return law
