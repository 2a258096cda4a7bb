"""Demonstrations as a LeRobotDataset v3.0, without lerobot.

Numbers are float32, which lerobot's policies expect. Source of the layout: ``lerobot/datasets/``
of lerobot 0.4.4, ``lerobot_dataset.py``, ``utils.py`` and ``compute_stats.py``.
"""

import json
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from forcebound.errors import ConfigError
from forcebound.extras import needed
from forcebound.recordings.demonstrations import DataSet, Demonstration

FILE_SIZE_MB, _CHUNK = 100, 1000  # of rows, after which a file ends; files of a chunk
_FILE = "chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
_QUANTILES = (0.01, 0.1, 0.5, 0.9, 0.99)
_Columns: TypeAlias = dict[str, NDArray[Any]]


def write_lerobot(data: DataSet, folder: Path) -> None:
    """Write a data set into a new folder; ConfigError if its frames per second are not whole."""
    if data.fps != round(data.fps):
        raise ConfigError(
            f"a LeRobotDataset has whole frames per second, got {data.fps}: add --fps"
        )
    parquet = needed("LeRobotDataset", "pyarrow.parquet")
    tasks: dict[str, int] = {}
    episodes: list[dict[str, Any]] = []
    stats: list[dict[str, _Columns]] = []
    columns: _Columns = {}
    rows = number = 0
    with ExitStack() as opened:
        writer: Any = None
        for count, one in enumerate(data.demonstrations()):
            columns = _columns(one, rows, count, tasks.setdefault(one.about["task"], len(tasks)))
            if writer is not None and writer.file_handle.tell() > FILE_SIZE_MB << 20:
                opened.close()
                number, writer = number + 1, None
            where = {"chunk_index": number // _CHUNK, "file_index": number % _CHUNK}
            table = _table(columns)
            if writer is None:
                file = folder / "data" / _FILE.format(**where)
                file.parent.mkdir(parents=True, exist_ok=True)
                writer = opened.enter_context(parquet.ParquetWriter(file, table.schema))
            writer.write_table(table)
            stats.append({name: _figures(values) for name, values in columns.items()})
            row = {"episode_index": count, "tasks": [one.about["task"]], "length": table.num_rows}
            row |= {f"data/{name}": index for name, index in where.items()}
            row |= {"dataset_from_index": rows, "dataset_to_index": rows + table.num_rows}
            for name, figures in stats[-1].items():
                row |= {f"stats/{name}/{key}": value.tolist() for key, value in figures.items()}
            episodes.append(row | {f"meta/episodes/{name}": 0 for name in where})
            rows += table.num_rows
    about = {_name(name): labels for name, labels in data.features.items()}
    info = {
        "codebase_version": "v3.0",
        "robot_type": data.device,
        "total_episodes": len(episodes),
        "total_frames": rows,
        "total_tasks": len(tasks),
        "chunks_size": _CHUNK,
        "data_files_size_in_mb": FILE_SIZE_MB,
        "video_files_size_in_mb": 200,
        "fps": round(data.fps),
        "splits": {"train": f"0:{len(episodes)}"},
        "data_path": f"data/{_FILE}",
        "video_path": None,
        "features": {
            name: {"dtype": str(values.dtype), "shape": [values.shape[1]]}
            | about.get(name, {"names": None})
            for name, values in columns.items()
        },
    }
    _write_meta(folder / "meta", {"info": info, "stats": _pooled(stats)}, episodes, tasks)


def _name(feature: str) -> str:
    return feature if feature == "action" else f"observation.{feature}"


def _columns(one: Demonstration, first: int, episode: int, task: int) -> _Columns:
    """Return the columns of an episode, shape (n, numbers)."""
    found: _Columns = {_name(name): v.astype(np.float32) for name, v in one.features.items()}
    found |= one.stamps | {"timestamp": one.stamps["timestamp"].astype(np.float32)}
    frames = np.arange(one.about["num_samples"])
    found |= {"frame_index": frames, "episode_index": np.full_like(frames, episode)}
    found |= {"index": frames + first, "task_index": np.full_like(frames, task)}
    return {name: values.reshape(frames.size, -1) for name, values in found.items()}


def _table(columns: _Columns) -> Any:
    """Return the columns as a table of arrow: of several numbers, lists of a fixed size."""
    arrow = needed("LeRobotDataset", "pyarrow")
    arrays = {}
    for name, values in columns.items():
        arrays[name] = arrow.array(values.reshape(-1))
        if values.shape[1] > 1:
            arrays[name] = arrow.FixedSizeListArray.from_arrays(arrays[name], values.shape[1])
    return arrow.table(arrays)


def _figures(values: NDArray[Any]) -> _Columns:
    """Return the statistics of an episode's column, of each number."""
    found = {key: getattr(np, key)(values, axis=0) for key in ("min", "max", "mean", "std")}
    found["count"] = np.array([len(values)])
    quantiles = np.quantile(values, _QUANTILES, axis=0)
    return found | {f"q{100 * q:02.0f}": row for q, row in zip(_QUANTILES, quantiles, strict=True)}


def _pooled(stats: Sequence[Mapping[str, _Columns]]) -> dict[str, dict[str, list[float]]]:
    """Return the statistics of all episodes; quantiles are means of theirs, as lerobot's are."""
    found = {}
    for name in stats[0]:
        each = {key: np.stack([one[name][key] for one in stats]) for key in stats[0][name]}
        shares = each["count"] / each["count"].sum()
        pooled = {key: (rows * shares).sum(0) for key, rows in each.items()}
        spread = each["std"] ** 2 + (each["mean"] - pooled["mean"]) ** 2
        pooled |= {"std": np.sqrt((spread * shares).sum(0)), "count": each["count"].sum(0)}
        pooled |= {"min": each["min"].min(0), "max": each["max"].max(0)}
        found[name] = {key: value.tolist() for key, value in pooled.items()}
    return found


def _write_meta(
    folder: Path,
    documents: Mapping[str, object],
    episodes: Sequence[Mapping[str, Any]],
    tasks: Mapping[str, int],
) -> None:
    arrow = needed("LeRobotDataset", "pyarrow")
    parquet = needed("LeRobotDataset", "pyarrow.parquet")
    file = folder / "episodes" / _FILE.format(chunk_index=0, file_index=0)
    file.parent.mkdir(parents=True)
    parquet.write_table(arrow.Table.from_pylist([*episodes]), file)
    for name, document in documents.items():
        (folder / f"{name}.json").write_text(json.dumps(document, indent=4), encoding="utf-8")
    # lerobot reads this table with pandas and takes the tasks from its index.
    index = "__index_level_0__"
    kind = {"pandas_type": "unicode", "numpy_type": "object", "metadata": None}
    columns = [{"name": None, "field_name": index, **kind}]
    about = {"index_columns": [index], "column_indexes": [], "columns": columns}
    table = arrow.table({"task_index": list(tasks.values()), index: list(tasks)})
    table = table.replace_schema_metadata({"pandas": json.dumps(about)})
    parquet.write_table(table, folder / "tasks.parquet")
