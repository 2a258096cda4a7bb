"""Result of a sweep as one Parquet file: one row per case, one column per parameter or figure.

``docs/sweeps.md`` lists the columns. The sweep's description and its map are in the file's metadata
under ``forcebound``.
"""

import json
import os
from collections import UserDict
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from forcebound.errors import ConfigError
from forcebound.files import content_of, read_bytes, reason

try:
    import pyarrow as pa
    import pyarrow.parquet as pq
except ImportError as missing:  # pragma: no cover - an installation without the extra
    raise ConfigError("sweeps need pyarrow: pip install 'forcebound[sweep]'") from missing

_KEY = b"forcebound"
_TYPES = (pa.bool_(), pa.int64(), pa.float64(), pa.string())  # of the columns that we write
MAX_CELLS = 50_000_000  # rows times columns that are read, some 40 bytes each; a map reads ten
MAX_BYTES = 1_000_000_000  # that a result unpacks to; two million cases have some hundred MB
_TEXTS = ("error", "engine")  # text columns, even if empty


@dataclass(frozen=True)
class Table:
    """Result of a sweep: columns by name, all of one length, and its description."""

    columns: Mapping[str, list[Any]]  # of a file: each is read when it is first asked for
    about: Mapping[str, Any]


def write_table(rows: Sequence[Mapping[str, Any]], path: Path, about: Mapping[str, Any]) -> None:
    """Write rows to a Parquet file, in one step; the same rows give the same bytes."""
    names = list(dict.fromkeys(name for row in rows for name in row))
    arrays = [_array(name, [row.get(name) for row in rows]) for name in names]
    metadata = {_KEY: json.dumps(about, sort_keys=True).encode()}
    table = pa.table(dict(zip(names, arrays, strict=True))).replace_schema_metadata(metadata)
    unfinished = path.with_name(path.name + ".unfinished")
    pq.write_table(table, unfinished, compression="zstd")
    os.replace(unfinished, path)


def read_table(path: Path) -> Table:
    """Return the content of a Parquet file of a sweep.

    Raises:
        ConfigError: If it is not such a file.
    """
    with _opened(path) as file:
        content = file.metadata
        if max(content.num_rows, content.num_columns, _unpacked(content)) > MAX_BYTES:
            raise ConfigError(f"{path} unpacks to more than {MAX_BYTES} bytes: no sweep has them")
        return Table(_Columns(file, path), _about(file))


class _Columns(UserDict[str, Any]):
    """Columns of a file, of which only those in use take memory."""

    def __init__(self, file: Any, path: Path) -> None:
        super().__init__(dict.fromkeys(file.schema_arrow.names))
        self._file, self._path, self._cells = file, path, 0

    def __getitem__(self, name: str) -> Any:
        if super().__getitem__(name) is None:
            self._cells += self._file.metadata.num_rows
            if self._cells > MAX_CELLS:
                raise ConfigError(f"{self._path}: more than {MAX_CELLS} cells (rows times columns)")
            with content_of(self._path):
                self[name] = _values(self._file.read(columns=[name])[name])
        return super().__getitem__(name)


def read_about(path: Path) -> dict[str, Any]:
    """Return the metadata of a sweep's file: ``name``, ``description``, ``map``, ``digest``.

    Raises:
        ConfigError: If there is no such file, or it is not a result of a sweep.
    """
    with _opened(path) as file:
        return _about(file)


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    try:
        data = read_bytes(path, MAX_BYTES)
    except FileNotFoundError:
        raise ConfigError(f"there is no file {path}; `forcebound sweep` creates one") from None
    except OSError as error:
        raise ConfigError(f"cannot read {path}: {reason(error)}") from None
    try:
        schema = pq.read_schema(pa.BufferReader(data))
        is_flat = all(field.type in _TYPES for field in schema)
        texts = [field.name for field in schema if pa.types.is_string(field.type)]
        file = pq.ParquetFile(pa.BufferReader(data), read_dictionary=texts)
        is_ours = is_flat and _KEY in (file.schema_arrow.metadata or {})
    except (OSError, pa.ArrowException) as error:
        raise ConfigError(f"{path} is not a result of a sweep: {error}") from None
    if not is_ours:
        raise ConfigError(f"{path} is not a result of a sweep")
    with content_of(path):
        yield file


def _values(column: Any) -> list[Any]:
    if not pa.types.is_dictionary(column.type):
        values: list[Any] = column.to_pylist()
        return values
    found = []  # one text for all rows that have it, however long it is
    for chunk in column.chunks:
        texts = [*chunk.dictionary.to_pylist(), None]
        found += [texts[-1 if at is None else at] for at in chunk.indices.to_pylist()]
    return found


def _unpacked(content: Any) -> int:
    return sum(content.row_group(i).total_byte_size for i in range(content.num_row_groups))


def _about(file: Any) -> dict[str, Any]:
    about: dict[str, Any] = json.loads(file.schema_arrow.metadata[_KEY])
    return about


def _array(name: str, values: list[Any]) -> Any:
    kinds = {type(value) for value in values if value is not None}
    if not kinds:
        return pa.array(values, pa.string() if name in _TEXTS else pa.float64())
    if kinds == {bool}:
        return pa.array(values, pa.bool_())
    if kinds == {int}:
        return pa.array(values, pa.int64())
    if kinds <= {int, float}:
        return pa.array([None if v is None else float(v) for v in values], pa.float64())
    return pa.array([None if v is None else str(v) for v in values], pa.string())
