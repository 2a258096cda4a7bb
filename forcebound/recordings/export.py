"""Topics of a recording as tables: one file each, and ``columns.csv`` with unit and meaning.

A field with several entries becomes a column for each, ``position[0]``, as `forcebound echo --csv`
names them; a signal is a column ``signals.NAME``; what is nested deeper becomes JSON text. A field
that no packet of the recording has, and a topic without packets, are left out. Numbers are exact:
the text gives the same bits.
"""

import csv
import json
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import msgspec

from forcebound.errors import ConfigError
from forcebound.files import content_of, reason
from forcebound.messages.packets import (
    TOPIC_OF,
    TOPICS,
    Meaning,
    Packet,
    Quaternion,
    Vector,
    field_types,
    meanings,
)
from forcebound.recordings.recording import Recording
from forcebound.recordings.schema import declared_signals, plain_type

COLUMNS = "columns.csv"  # what each column means
_TYPES = {int: "int64", bool: "bool"} | dict.fromkeys(
    (float, Vector, Quaternion, Mapping[str, float]), "float64"
)
_ROWS = 1 << 12  # of a table that wait until they are written

_Row: TypeAlias = dict[str, Any]
_Add: TypeAlias = Callable[[_Row], object]


class _Column(NamedTuple):
    name: str
    meaning: Meaning  # of the packet's field
    kind: str  # Arrow's name of the type


def export(recording: Recording, folder: Path, kind: str, overwrite: bool = False) -> list[Path]:
    """Write the topics of a recording into a folder, which is made if need be.

    The recording is read twice, and never as a whole: first to see which columns there are.

    Args:
        recording: With all its topics.
        folder: For the files ``TOPIC.csv`` or ``TOPIC.parquet`` and ``columns.csv``.
        kind: ``csv`` or ``parquet``.
        overwrite: Replace files that are there.

    Returns:
        The files.

    Raises:
        ConfigError: If there is no packet; if a file is there or cannot be written; if the format
            needs a package that is missing.
    """
    table = _csv if kind == "csv" else _parquet()
    with content_of(recording.path):
        columns = _columns_of(recording)
    if not columns:
        raise ConfigError(f"{recording.path} has no packet: nothing to export")
    files = {topic: folder / f"{topic}.{kind}" for topic in columns}
    _prepare(folder, [*files.values(), folder / COLUMNS], overwrite)
    try:
        with ExitStack() as stack:
            add = {t: stack.enter_context(table(file, columns[t])) for t, file in files.items()}
            for packet in recording.stream(*TOPICS):
                add[TOPIC_OF[type(packet)]](_row_of(packet))
        with _csv(folder / COLUMNS, ("table", "column", "unit", "meaning")) as described:
            for topic, each in columns.items():
                for name, meaning, _ in each:
                    described({"table": topic, "column": name} | _texts(meaning))
    except OSError as error:  # the disk is full
        raise ConfigError(f"cannot write into the folder {folder}: {reason(error)}") from error
    return [*files.values(), folder / COLUMNS]


def _row_of(packet: Packet) -> _Row:
    """Return the values of a packet by column; no value: no key."""
    row: _Row = {}
    for name, hint in field_types(type(packet)).items():
        value = getattr(packet, name)
        if value is None or value is msgspec.UNSET:
            continue
        kind = plain_type(hint)
        if kind in (Vector, Quaternion):
            row |= {f"{name}[{i}]": one for i, one in enumerate(value)}
        elif name == "signals":
            row |= {f"{name}.{signal}": one for signal, one in value.items()}
        elif kind is str or kind in _TYPES:
            row[name] = value
        else:
            row[name] = json.dumps(msgspec.to_builtins(value))
    return row


def _columns_of(recording: Recording) -> dict[str, list[_Column]]:
    """Return the columns of each topic that has packets, in the order of the fields."""
    seen: dict[type[Packet], set[str]] = {}
    for packet in recording.stream(*TOPICS):
        seen.setdefault(type(packet), set()).update(_row_of(packet))
    columns = {}
    signals = declared_signals(recording.metadata)
    for topic, packet_type in TOPICS.items():
        if packet_type in seen:
            hints, meaning = field_types(packet_type), meanings(packet_type)
            declared = {f"signals.{name}": one for name, one in signals.get(topic, {}).items()}
            fields = list(hints)
            names = [(name, re.split(r"[[.]", name)[0]) for name in sorted(seen[packet_type])]
            columns[topic] = [
                _Column(
                    name,
                    declared.get(name, meaning[field]),
                    _TYPES.get(plain_type(hints[field]), "string"),
                )
                for name, field in sorted(names, key=lambda each: fields.index(each[1]))
            ]
    return columns


def _prepare(folder: Path, files: Sequence[Path], overwrite: bool) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigError(f"cannot write into the folder {folder}: {reason(error)}") from error
    there = [file.name for file in files if file.exists()]
    if there and not overwrite:
        names = ", ".join(there)
        raise ConfigError(f"{folder} has {names}: choose another folder, or add --overwrite")


@contextmanager
def _csv(file: Path, columns: Sequence[_Column | str]) -> Iterator[_Add]:
    """Write a table as CSV, row by row."""
    names = [column if isinstance(column, str) else column.name for column in columns]
    with file.open("w", newline="", encoding="utf-8") as stream:
        rows = csv.DictWriter(stream, names, lineterminator="\n")
        rows.writeheader()
        yield rows.writerow


def _parquet() -> Callable[[Path, Sequence[_Column]], AbstractContextManager[_Add]]:
    """Return the like as Parquet; the columns of the table have units and meanings, too."""
    try:
        import pyarrow as pa
        import pyarrow.parquet as pq
    except ImportError as missing:
        needed = "Parquet files need pyarrow: pip install 'forcebound[lab]', or use --csv"
        raise ConfigError(needed) from missing

    @contextmanager
    def parquet(file: Path, columns: Sequence[_Column]) -> Iterator[_Add]:
        schema = pa.schema(
            [pa.field(each.name, each.kind, metadata=_texts(each.meaning)) for each in columns]
        )
        waiting: list[_Row] = []
        with pq.ParquetWriter(file, schema, compression="zstd") as writer:

            def write() -> None:
                writer.write_table(pa.Table.from_pylist(waiting, schema))
                waiting.clear()

            def add(row: _Row) -> None:
                waiting.append(row)
                if len(waiting) == _ROWS:
                    write()

            yield add
            write()

    return parquet


def _texts(meaning: Meaning) -> dict[str, str]:
    return {"unit": meaning.unit, "meaning": meaning.text}
