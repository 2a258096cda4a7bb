"""Parts by themselves, outside any launch file."""

from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any

from forcebound.graph.document import device_section
from forcebound.graph.model import read_part
from forcebound.graph.names import split_setting
from forcebound.graph.problems import Place, Problems
from forcebound.graph.servo import check_law
from forcebound.graph.tree import Value, from_plain, scalar
from forcebound.haptics.laws import LAWS
from forcebound.messages.topology import Document


def part_of(section: str, document: Document) -> Any:
    """Return the part of a section of a document; ConfigError if it cannot be made."""
    return _made(section, from_plain(document, section), Problems())


def member_of(section: str, kind: str, overrides: Sequence[str] = ()) -> Any:
    """Return one part by itself, such as an environment, outside any launch file.

    ``kind`` is as in a launch file, with a path from the current folder; ``overrides`` are
    parameters, each ``name:=value``. ConfigError if there is no such kind or a parameter is wrong.
    """
    problems = Problems()
    entries = {"kind": Value(kind, Place(section), text=kind)}
    for name, word in map(split_setting, overrides):
        place = Place(f"argument {name}:={word}")
        if name in entries:
            problems.add(f"{name!r} is given twice, or is no parameter", place)
        else:
            entries[name] = Value(scalar(word), place, text=word)
    return _made(section, Value(entries, Place(section)), problems)


def device_of(path: Path, without: Collection[str]) -> Any:
    """Return the device of a file, as :func:`member_of` does, but for some of its parameters."""
    problems = Problems()
    section = device_section(path, problems)
    return _made("device", section.without(*without), problems)


def law_of(kind: str) -> str:
    """Return a law's kind, absolute if it is in a file; a relative path starts from here.

    Raises:
        ConfigError: If there is no such law.
    """
    check_law(kind)
    law = LAWS.resolve(kind, Path())
    LAWS[law]  # a file is loaded, and checked
    return law


def _made(section: str, value: Value, problems: Problems) -> Any:
    """The part of a section, without the section's settings; ConfigError with problems."""
    part = read_part(section, value, problems)
    problems.raise_if_any()
    return part
