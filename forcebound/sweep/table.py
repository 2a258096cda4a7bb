"""Result of a sweep as one Parquet file: one row per case, one column per parameter or figure.

``docs/sweeps.md`` lists the columns. The sweep's description and its map are in the file's metadata
under ``forcebound``.
"""

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from forcebound.errors import ConfigError

try:
    import pyarrow as pa
    import pyarrow.parquet as pq
except ImportError as missing:  # pragma: no cover - an installation without the extra
    raise ConfigError("sweeps need pyarrow: pip install 'forcebound[sweep]'") from missing

_KEY = b"forcebound"
_TEXTS = ("error", "engine")  # text columns, even if empty


@dataclass(frozen=True)
class Table:
    """Result of a sweep: columns by name, all of one length, and its description."""

    columns: Mapping[str, list[Any]]
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
    about = read_about(path)
    table = pq.read_table(path)
    return Table({name: table[name].to_pylist() for name in table.column_names}, about)


def read_about(path: Path) -> dict[str, Any]:
    """Return the metadata of a sweep's file: ``name``, ``description``, ``map``, ``digest``.

    Raises:
        ConfigError: If there is no such file, or it is not a result of a sweep.
    """
    if not path.exists():
        raise ConfigError(f"there is no file {path}; `forcebound sweep` creates one")
    try:
        about: dict[str, Any] = json.loads((pq.read_schema(path).metadata or {})[_KEY])
    except (OSError, pa.ArrowException, KeyError, ValueError) as error:
        raise ConfigError(f"{path} is not a result of a sweep: {error}") from error
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
