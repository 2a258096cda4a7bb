"""Rows of a campaign as one Parquet file; its description and map are in the file's metadata.

::

    read_table(Path("runs.parquet")).columns["contacts"]
"""

import json
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from forcebound.errors import ConfigError
from forcebound.extras import needed
from forcebound.files import content_of, read_bytes, reason
from forcebound.lab.engine import Row

pa = needed("a Parquet file", "pyarrow")
pq = needed("a Parquet file", "pyarrow.parquet")

_KEY = b"forcebound"
_TYPES = (pa.bool_(), pa.int64(), pa.float64(), pa.string())  # of cells and of entries of lists
MAX_BYTES = 1_000_000_000  # that a result has, and unpacks to; two million rows have some 100 MB
MAX_ROWS = 5_000_000
MAX_VALUES = 10 * MAX_ROWS  # of a column, all lists together
_TEXTS = ("error", "engine")  # text columns, even if empty


@dataclass(frozen=True)
class Table:
    """Rows of a campaign: columns by name, all of one length, and what they are about."""

    columns: Mapping[str, list[Any]]
    about: Row

    @property
    def rows(self) -> list[Row]:
        """The rows; each has all columns."""
        rows = zip(*self.columns.values(), strict=True)
        return [dict(zip(self.columns, row, strict=True)) for row in rows]


def write_table(rows: Sequence[Row], path: Path, about: Row) -> None:
    """Write rows to a Parquet file, in one step; the same rows give the same bytes."""
    names = list(dict.fromkeys(name for row in rows for name in row))
    arrays = [_array(name, [row.get(name) for row in rows]) for name in names]
    metadata = {_KEY: json.dumps(about, sort_keys=True).encode()}
    table = pa.table(dict(zip(names, arrays, strict=True))).replace_schema_metadata(metadata)
    unfinished = path.with_name(path.name + ".unfinished")
    pq.write_table(table, unfinished, compression="zstd")
    with unfinished.open("rb") as file:
        os.fsync(file.fileno())  # before a campaign deletes its parts
    os.replace(unfinished, path)


def read_table(path: Path) -> Table:
    """Return the content of a Parquet file of :func:`write_table`.

    Raises:
        ConfigError: If it is not such a file.
    """
    file = _opened(path)
    with content_of(path):
        return Table(_Columns(file.read()), _about(file))


class _Columns(Mapping[str, list[Any]]):
    """Columns of a file, of which only those in use become lists."""

    def __init__(self, content: Any) -> None:
        self._content = content
        self._lists: dict[str, list[Any]] = {}

    def __getitem__(self, name: str) -> list[Any]:
        if name not in self._lists:
            self._lists[name] = self._list_of(name)
        return self._lists[name]

    def _list_of(self, name: str) -> list[Any]:
        column = self._content[name]
        if not pa.types.is_dictionary(column.type):
            values: list[Any] = column.to_pylist()
            return values
        texts_of_rows = []  # one text for all rows that have it, however long it is
        for chunk in column.chunks:
            texts = [*chunk.dictionary.to_pylist(), None]
            texts_of_rows += [texts[-1 if at is None else at] for at in chunk.indices.to_pylist()]
        return texts_of_rows

    def __iter__(self) -> Iterator[str]:
        return iter(self._content.column_names)

    def __len__(self) -> int:
        return len(self._content.column_names)


def read_about(path: Path) -> Row:
    """Return the metadata of a result, such as ``map`` and ``digest``.

    Raises:
        ConfigError: If it is not such a file.
    """
    file = _opened(path)
    with content_of(path):
        return _about(file)


def _opened(path: Path) -> Any:
    try:
        data = read_bytes(path, MAX_BYTES)
    except FileNotFoundError:
        raise ConfigError(f"there is no file {path}; `forcebound sweep` creates one") from None
    except OSError as error:
        raise ConfigError(f"cannot read {path}: {reason(error)}") from None
    try:
        schema = pq.read_schema(pa.BufferReader(data))
        kinds = [f.type.value_type if pa.types.is_list(f.type) else f.type for f in schema]
        is_flat = all(kind in _TYPES for kind in kinds)
        texts = [field.name for field in schema if pa.types.is_string(field.type)]
        file = pq.ParquetFile(pa.BufferReader(data), read_dictionary=texts)
        is_ours = is_flat and _KEY in (file.schema_arrow.metadata or {})
    except (OSError, pa.ArrowException) as error:
        raise ConfigError(f"{path} is not a result of a sweep: {error}") from None
    if not is_ours:
        raise ConfigError(f"{path} is not a result of a sweep")
    content = file.metadata
    groups = [content.row_group(i) for i in range(content.num_row_groups)]
    unpacked = sum(group.total_byte_size for group in groups)
    values = [group.column(i).num_values for group in groups for i in range(group.num_columns)]
    if unpacked > MAX_BYTES or content.num_rows > MAX_ROWS or max(values, default=0) > MAX_VALUES:
        raise ConfigError(
            f"{path} has more than {MAX_ROWS} rows or {MAX_VALUES} numbers in a column, or unpacks "
            f"to more than {MAX_BYTES} bytes"
        )
    return file


def _about(file: Any) -> Row:
    about: Row = json.loads(file.schema_arrow.metadata[_KEY])
    return about


def _array(name: str, values: list[Any]) -> Any:
    known = [value for value in values if value is not None]
    if known and all(isinstance(value, list) for value in known):
        kind = _kind([entry for value in known for entry in value])
        lists = [None if v is None else [_in_kind(kind, entry) for entry in v] for v in values]
        return pa.array(lists, pa.list_(kind))
    kind = _kind(known) if known or name not in _TEXTS else pa.string()
    return pa.array([_in_kind(kind, value) for value in values], kind)


def _kind(values: list[Any]) -> Any:
    kinds = {type(value) for value in values if value is not None}
    if kinds == {bool}:
        return pa.bool_()
    if kinds == {int}:
        return pa.int64()
    return pa.float64() if kinds <= {int, float} else pa.string()


def _in_kind(kind: Any, value: Any) -> Any:
    to = {pa.float64(): float, pa.string(): str}.get(kind)
    return value if value is None or to is None else to(value)
