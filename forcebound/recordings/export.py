"""Topics of a recording as tables: a CSV file each, and ``columns.csv`` with unit and meaning.

A field with several entries becomes a column for each, ``position[0]``, as `forcebound echo --csv`
names them; a signal is a column ``signals.NAME``; what is nested deeper becomes JSON text. A field
that no packet of the recording has, and a topic without packets, are left out. Numbers are exact:
the text gives the same bits.
"""

import csv
import json
import re
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path

import msgspec

from forcebound.axes import units_on
from forcebound.errors import ConfigError
from forcebound.files import content_of, reason
from forcebound.messages.packets import TOPIC_OF, TOPICS, Meaning, Packet, field_types, meanings
from forcebound.recordings.launched import launched
from forcebound.recordings.recording import Recording

COLUMNS = "columns.csv"  # what each column means


def export(recording: Recording, folder: Path, overwrite: bool = False) -> list[Path]:
    """Write the topics of a recording into a folder, which is made if need be; return the files.

    The recording is read twice, and never as a whole: first to see which columns there are.

    Args:
        recording: With all its topics.
        folder: For the files ``TOPIC.csv`` and ``columns.csv``.
        overwrite: Replace files that are there.

    Raises:
        ConfigError: If there is no packet, or a file is there or cannot be written.
    """
    with content_of(recording.path):
        columns = columns_of(recording)
    if not columns:
        raise ConfigError(f"{recording.path} has no packet: nothing to export")
    files = {topic: folder / f"{topic}.csv" for topic in columns}
    written = [*files.values(), folder / COLUMNS]
    there = ", ".join(file.name for file in written if file.exists())
    if there and not overwrite:
        raise ConfigError(f"{folder} has {there}: choose another folder, or add --overwrite")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with ExitStack() as stack:

            def table(file: Path, names: list[str]) -> "csv.DictWriter[str]":
                stream = stack.enter_context(file.open("w", newline="", encoding="utf-8"))
                rows = csv.DictWriter(stream, names, lineterminator="\n")
                rows.writeheader()
                return rows

            tables = {topic: table(file, columns[topic]) for topic, file in files.items()}
            for packet in recording.stream(*TOPICS):
                tables[TOPIC_OF[type(packet)]].writerow(row_of(packet))
            described_columns = table(folder / COLUMNS, ["table", "column", "unit", "meaning"])
            for topic, names in columns.items():
                for name in names:
                    text, unit = described(recording, topic, name)
                    row = {"table": topic, "column": name, "unit": unit, "meaning": text}
                    described_columns.writerow(row)
    except OSError as error:  # the disk is full
        raise ConfigError(f"cannot write into the folder {folder}: {reason(error)}") from error
    return written


def described(recording: Recording, topic: str, column: str) -> Meaning:
    """Return the meaning and unit of a column of a topic's table, on the axes of its hand."""
    own = {f"signals.{name}": one for name, one in recording.signals.get(topic, {}).items()}
    if column in own:
        return own[column]
    text, unit = meanings(TOPICS[topic])[_field(column)]
    named = launched(recording.launch).axes
    at = re.fullmatch(r".*\[(\d+)\]", column)
    if at is not None and int(at[1]) < len(named):
        axis = named[int(at[1])]
        return Meaning(f"{axis.name}: {text}", axis.unit(unit))
    return Meaning(text, units_on(named, unit))


def row_of(packet: Packet) -> dict[str, float | str]:
    """Return the values of a packet by column; no value: no key."""
    row: dict[str, float | str] = {}
    for name in field_types(type(packet)):
        value = getattr(packet, name)
        if name == "signals" and value is not msgspec.UNSET:
            row |= {f"signals.{signal}": one for signal, one in value.items()}
        elif isinstance(value, tuple) and value and isinstance(value[0], float):
            row |= {f"{name}[{i}]": one for i, one in enumerate(value)}
        elif isinstance(value, int | float | str):
            row[name] = value
        elif value is not None and value is not msgspec.UNSET:
            row[name] = json.dumps(msgspec.to_builtins(value))
    return row


def columns_of(recording: Recording, topics: Sequence[str] = tuple(TOPICS)) -> dict[str, list[str]]:
    """Return the columns of each topic that has packets, in the order of the fields."""
    seen: dict[type[Packet], set[str]] = {}
    for packet in recording.stream(*topics):
        seen.setdefault(type(packet), set()).update(row_of(packet))
    columns = {}
    for kind in filter(seen.__contains__, TOPICS.values()):
        order = list(field_types(kind))
        own = [f"signals.{name}" for name in recording.signals.get(TOPIC_OF[kind], {})]
        names = sorted(
            seen[kind],
            key=lambda n: (order.index(_field(n)), own.index(n) if n in own else len(own), n),
        )
        columns[TOPIC_OF[kind]] = names
    return columns


def _field(column: str) -> str:
    """Return the field of a packet that a column belongs to."""
    return re.split(r"[[.]", column)[0]
