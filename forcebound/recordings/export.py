"""Topics of a recording as tables: one file each, and ``columns.csv`` with unit and meaning.

A field with several entries becomes a column for each, ``position[0]``, as `forcebound echo --csv`
names them; what is nested deeper becomes JSON text. A field that no packet of the recording has,
and a topic without packets, are left out. Numbers are exact: the text gives the same bits.
"""

import csv
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing
from functools import partial
from operator import attrgetter
from pathlib import Path
from typing import Any, NamedTuple, Protocol

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
from forcebound.recording import Recording
from forcebound.recording_schema import plain_type

COLUMNS = "columns.csv"  # what each column means
FORMATS = ("csv", "parquet")
_TYPES = {int: "int64", float: "float64", bool: "bool", str: "string"}
_ROWS = 1 << 16  # of a table that wait until they are written


class _Column(NamedTuple):
    """A column of a table."""

    name: str
    meaning: Meaning  # of the packet's field
    kind: str  # Arrow's name of the type
    value_of: Callable[[Packet], Any]


class _Table(Protocol):
    """A table that is written packet by packet."""

    def add(self, packet: Packet) -> None: ...

    def close(self) -> None: ...


def export(recording: Recording, folder: Path, kind: str, overwrite: bool = False) -> list[Path]:
    """Write the topics of a recording into a folder, which is made if need be.

    The recording is read twice, and never as a whole: first to see which columns there are.

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
    table = _Csv if kind == "csv" else _parquet()
    with content_of(recording.path):
        columns = _columns_of(recording)
    if not columns:
        raise ConfigError(f"{recording.path} has no packet: nothing to export")
    files = {topic: folder / f"{topic}.{kind}" for topic in columns}
    _prepare(folder, [*files.values(), folder / COLUMNS], overwrite)
    try:
        with ExitStack() as stack:
            tables = {
                topic: stack.enter_context(closing(table(file, columns[topic])))
                for topic, file in files.items()
            }
            for packet in recording.stream(*TOPICS):
                tables[TOPIC_OF[type(packet)]].add(packet)
        with (folder / COLUMNS).open("w", newline="", encoding="utf-8") as stream:
            rows = csv.writer(stream, lineterminator="\n")
            rows.writerow(("table", "column", "unit", "meaning"))
            rows.writerows(_described(columns))
    except OSError as error:  # the disk is full
        raise ConfigError(f"cannot write into the folder {folder}: {reason(error)}") from error
    return [*files.values(), folder / COLUMNS]


def _columns_of(recording: Recording) -> dict[str, list[_Column]]:
    """Return the columns of each topic that has packets."""
    widths: dict[str, dict[str, int]] = {}  # by topic and field: most entries; a number has one
    names = {kind: tuple(field_types(kind)) for kind in TOPIC_OF}
    values_of = {kind: attrgetter(*names[kind]) for kind in TOPIC_OF}
    for packet in recording.stream(*TOPICS):
        kind = type(packet)
        known = widths.setdefault(TOPIC_OF[kind], {})
        for name, value in zip(names[kind], values_of[kind](packet), strict=True):
            if value is not None:
                entries = len(value) if type(value) is tuple else 1
                if entries > known.get(name, -1):
                    known[name] = entries
    return {
        topic: [
            column
            for name, hint in field_types(TOPICS[topic]).items()
            if name in widths[topic]
            for column in _columns(
                name, meanings(TOPICS[topic])[name], plain_type(hint), widths[topic][name]
            )
        ]
        for topic in TOPICS
        if topic in widths
    }


def _columns(name: str, meaning: Meaning, kind: Any, width: int) -> Iterator[_Column]:
    """Yield the columns of a field; ``kind`` is its type when it has a value."""
    if kind in (Vector, Quaternion):
        for i in range(width):
            yield _Column(f"{name}[{i}]", meaning, "float64", partial(_entry, attrgetter(name), i))
    elif kind in _TYPES:
        yield _Column(name, meaning, _TYPES[kind], attrgetter(name))
    else:
        yield _Column(name, meaning, "string", partial(_as_json, attrgetter(name)))


def _entry(vector_of: Callable[[Packet], Vector | None], i: int, packet: Packet) -> float | None:
    value = vector_of(packet)
    return None if value is None or i >= len(value) else value[i]


def _as_json(value_of: Callable[[Packet], Any], packet: Packet) -> str:
    return json.dumps(msgspec.to_builtins(value_of(packet)))


def _prepare(folder: Path, files: Sequence[Path], overwrite: bool) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigError(f"cannot write into the folder {folder}: {reason(error)}") from error
    there = [file.name for file in files if file.exists()]
    if there and not overwrite:
        names = ", ".join(there)
        raise ConfigError(f"{folder} has {names}: choose another folder, or add --overwrite")


def _described(tables: Mapping[str, Sequence[_Column]]) -> Iterator[Sequence[str]]:
    for topic, columns in tables.items():
        for column in columns:
            yield topic, column.name, column.meaning.unit, column.meaning.text


class _Csv:
    """A table as CSV."""

    def __init__(self, file: Path, columns: Sequence[_Column]) -> None:
        self._stream = file.open("w", newline="", encoding="utf-8")
        self._rows = csv.writer(self._stream, lineterminator="\n")
        self._rows.writerow([column.name for column in columns])
        self._values = [column.value_of for column in columns]

    def add(self, packet: Packet) -> None:
        self._rows.writerow([value_of(packet) for value_of in self._values])

    def close(self) -> None:
        self._stream.close()


def _parquet() -> Callable[[Path, Sequence[_Column]], _Table]:
    """Return the class of tables as Parquet; their columns have units and meanings, too."""
    try:
        import pyarrow as pa
        import pyarrow.parquet as pq
    except ImportError as missing:
        needed = "Parquet files need pyarrow: pip install 'forcebound[lab]', or use --csv"
        raise ConfigError(needed) from missing

    class Parquet:
        def __init__(self, file: Path, columns: Sequence[_Column]) -> None:
            fields = []
            for column in columns:
                about = {"unit": column.meaning.unit, "meaning": column.meaning.text}
                fields.append(pa.field(column.name, column.kind, metadata=about))
            self._schema = pa.schema(fields)
            self._columns = columns
            self._waiting: list[Packet] = []
            self._writer = pq.ParquetWriter(file, self._schema, compression="zstd")

        def add(self, packet: Packet) -> None:
            self._waiting.append(packet)
            if len(self._waiting) == _ROWS:
                self._write()

        def close(self) -> None:
            self._write()
            self._writer.close()

        def _write(self) -> None:
            arrays = [
                pa.array(list(map(column.value_of, self._waiting)), column.kind)
                for column in self._columns
            ]
            self._writer.write_table(pa.table(arrays, schema=self._schema))
            self._waiting.clear()

    return Parquet
