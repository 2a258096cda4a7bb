"""Topics of a recording as tables: one file each, and ``columns.csv`` with unit and meaning.

A field with several entries becomes a column for each, ``position[0]``, as `forcebound echo --csv`
names them; what is nested deeper becomes JSON text. A field that no packet of the recording has,
and a topic without packets, are left out. Numbers are exact: the text gives the same bits.
"""

import csv
import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec

from forcebound.errors import ConfigError
from forcebound.files import content_of, reason
from forcebound.messages.packets import TOPICS, Packet, Quaternion, Vector, field_types
from forcebound.recording import Recording
from forcebound.recording_schema import DESCRIPTIONS, UNITS, plain_type

COLUMNS = "columns.csv"  # what each column means
FORMATS = ("csv", "parquet")
_SIMPLE = (int, float, bool, str)
_TYPES = {int: "int64", float: "float64", bool: "bool", str: "string"}

#: Columns of a table by name: the field that each is of, and its values.
Columns = dict[str, tuple[str, list[Any]]]


def export(recording: Recording, folder: Path, kind: str, overwrite: bool = False) -> list[Path]:
    """Write the topics of a recording into a folder, which is made if need be.

    Args:
        recording: With all its topics.
        folder: For the files ``TOPIC.csv`` or ``TOPIC.parquet`` and ``columns.csv``.
        kind: One of :data:`FORMATS`.
        overwrite: Replace files that are there.

    Returns:
        The files.

    Raises:
        ConfigError: If there is no packet; if a file is there or cannot be written; if the format
            needs a package that is missing.
    """
    write = _write_csv if kind == "csv" else _parquet_writer()
    tables: dict[str, Columns] = {}
    with content_of(recording.path):
        for topic in TOPICS:
            columns = columns_of(recording.packets(topic), TOPICS[topic].packet)
            if columns:
                tables[topic] = columns
    if not tables:
        raise ConfigError(f"{recording.path} has no packet: nothing to export")
    files = {topic: folder / f"{topic}.{kind}" for topic in tables}
    _prepare(folder, [*files.values(), folder / COLUMNS], overwrite)
    try:
        for topic, file in files.items():
            write(file, tables[topic])
        _write_rows(folder / COLUMNS, ("table", "column", "unit", "meaning"), _described(tables))
    except OSError as error:  # the disk is full
        raise ConfigError(f"cannot write into the folder {folder}: {reason(error)}") from error
    return [*files.values(), folder / COLUMNS]


def columns_of(packets: Sequence[Packet], kind: type[Packet]) -> Columns:
    """Return the columns of packets of one kind; empty without packets."""
    columns: Columns = {}
    for name, hint in field_types(kind).items():
        values = [getattr(packet, name) for packet in packets]
        if all(value is None for value in values):
            continue
        plain = plain_type(hint)
        if plain in (Vector, Quaternion):
            for i in range(max(len(value or ()) for value in values)):
                columns[f"{name}[{i}]"] = name, [_entry(value, i) for value in values]
        elif plain in _SIMPLE:
            columns[name] = name, values
        else:
            columns[name] = name, [_as_json(value) for value in values]
    return columns


def _entry(value: Vector | None, i: int) -> float | None:
    return None if value is None or i >= len(value) else value[i]


def _as_json(value: Any) -> str:
    return json.dumps(msgspec.to_builtins(value))


def _prepare(folder: Path, files: Sequence[Path], overwrite: bool) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigError(f"cannot write into the folder {folder}: {reason(error)}") from error
    there = [file.name for file in files if file.exists()]
    if there and not overwrite:
        names = ", ".join(there)
        raise ConfigError(f"{folder} has {names}: choose another folder, or add --overwrite")


def _described(tables: Mapping[str, Columns]) -> Iterator[Sequence[str]]:
    for topic, columns in tables.items():
        for column, (name, _) in columns.items():
            yield topic, column, UNITS[name], DESCRIPTIONS[name]


def _write_csv(file: Path, columns: Columns) -> None:
    _write_rows(file, list(columns), zip(*(values for _, values in columns.values()), strict=True))


def _write_rows(file: Path, head: Sequence[str], rows: Any) -> None:
    with file.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(head)
        writer.writerows(rows)


def _parquet_writer() -> Any:
    """Return a function like :func:`_write_csv`; units and meanings are metadata of its columns."""
    try:
        import pyarrow as pa
        import pyarrow.parquet as pq
    except ImportError as missing:
        needed = "Parquet files need pyarrow: pip install 'forcebound[sweep]', or use --csv"
        raise ConfigError(needed) from missing

    def write(file: Path, columns: Columns) -> None:
        fields, arrays = [], []
        for column, (name, values) in columns.items():
            kind = _TYPES[next(type(value) for value in values if value is not None)]
            about = {"unit": UNITS[name], "meaning": DESCRIPTIONS[name]}
            fields.append(pa.field(column, kind, metadata=about))
            arrays.append(pa.array(values, kind))
        pq.write_table(pa.table(arrays, schema=pa.schema(fields)), file, compression="zstd")

    return write
