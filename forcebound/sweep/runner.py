"""How is a sweep run? In parts, through any executor, so that it can be stopped at any moment.

Strategy:

1. Cases are cut into parts, in order; how does not depend on who runs them.
2. Each part is one task of a :class:`concurrent.futures.Executor`: this machine's cores, a dask
   cluster, anything. Its rows are written to a file of its own beside the result, in one step.
3. When all parts are there they become one Parquet file, in one step, and the parts go.

A sweep that is started again takes over the parts that it finds. They belong to it if the digest
in ``sweep.json`` is the same: it covers all cases, the launch file and the version of forcebound.
"""

import hashlib
import json
import math
import os
import shutil
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Executor, as_completed
from contextlib import contextmanager
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from typing import Any, TypeAlias

from forcebound.config.graph import GraphConfig
from forcebound.config.loader import build
from forcebound.errors import ConfigError, ForceboundError
from forcebound.quantities import to_si
from forcebound.sweep.engine import run_all
from forcebound.sweep.plan import Sweep

Row: TypeAlias = dict[str, Any]
Progress: TypeAlias = Callable[[int, int], None]  # cases done, cases in all

SMALLEST_PART, LARGEST_PART, PARTS = 32, 256, 64  # cases in a part; how many parts are good


def run_cases(sweep: Sweep, first: int) -> list[Row]:
    """Return the rows of all cases, the first one numbered ``first``; a failed one is a row too."""
    rows: list[Row] = []
    configs: list[GraphConfig] = []
    places: list[int] = []
    for case in range(len(sweep.cases)):
        row: Row = {"case": first + case, "engine": None, "error": None}
        texts = dict(zip(sweep.columns, sweep.cases[case], strict=True))
        row |= {f"over.{name}": _plain(text) for name, text in texts.items()}
        rows.append(row)
        try:
            config = build(sweep.template, sweep.overrides(case))
        except ForceboundError as error:
            row["error"] = f"{type(error).__name__}: {error}"
            continue
        if sweep.duration is not None:
            config = replace(config, duration=sweep.duration)
        configs.append(config)
        places.append(case)
    for place, ran in zip(places, run_all(configs), strict=True):
        rows[place]["engine"] = ran.engine
        if ran.result is None:
            rows[place]["error"] = f"{type(ran.error).__name__}: {ran.error}"
        else:
            rows[place] |= _flat(_parameters(ran.result.document))
            rows[place] |= _flat(_figures(ran.result.summary))
    return rows


def _plain(text: str) -> float | str:
    """A swept value as a column has it: in SI units, or as text."""
    number = to_si(text)
    return text if number is None else number


def _parameters(document: Mapping[str, Any]) -> dict[str, Any]:
    left_out = ("forcebound", "description", "realtime")  # nothing of a virtual run
    return {name: value for name, value in document.items() if name not in left_out}


def _figures(summary: Mapping[str, Any]) -> dict[str, Any]:
    refused = sum(summary["rejected_packets"].values())
    # The kernel draws what links lose and does not count it; events are of the graph alone.
    left_out = ("law", "rejected_packets", "links", "faults", "phases")
    rest = {key: value for key, value in summary.items() if key not in left_out}
    return {**rest, "rejected_packets": refused}


def _flat(document: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for name, value in document.items():
        if isinstance(value, Mapping):
            flat |= _flat(value, f"{prefix}{name}.")
        else:
            flat[prefix + name] = json.dumps(value) if isinstance(value, list) else value
    return flat


def parts_of(cases: int) -> list[tuple[int, int]]:
    """Return the parts that ``cases`` cases are cut into, as first and one past last."""
    size = min(max(math.ceil(cases / PARTS), SMALLEST_PART), LARGEST_PART)
    return [(first, min(first + size, cases)) for first in range(0, cases, size)]


def run_sweep(
    sweep: Sweep,
    result: Path,
    executor: Executor,
    progress: Progress = lambda done, cases: None,
    restart: bool = False,
) -> dict[str, Any]:
    """Run a sweep, or what is left of it, and write its Parquet file.

    Args:
        sweep: What to run.
        result: The Parquet file; replaced if it exists. Parts lie in a folder of this name with
            ``.parts`` behind until all are there.
        executor: Who runs the parts.
        progress: Called when cases are done.
        restart: Throw away parts of an earlier run.

    Returns:
        ``result``, ``cases``, ``failed``, ``first_error``, ``kernel``, ``graph`` (cases by
        engine), ``resumed`` (cases taken over) and ``simulated_s``.

    Raises:
        ConfigError: If the folder holds parts of another sweep, or cannot be written.
    """
    from forcebound.sweep.table import write_table  # needs pyarrow: say so before the work begins

    folder = result.with_name(result.name + ".parts")
    parts = parts_of(len(sweep.cases))
    try:
        _prepare(folder, _digest(sweep), restart)
    except OSError as error:
        raise ConfigError(f"cannot write {folder}: {error.strerror}") from error
    missing = [part for part in parts if not _file_of(folder, part).exists()]
    resumed = len(sweep.cases) - sum(last - first for first, last in missing)
    done = resumed
    progress(done, len(sweep.cases))
    futures = {
        executor.submit(run_cases, replace(sweep, cases=sweep.cases[slice(*part)]), part[0]): part
        for part in missing
    }
    try:
        for future in as_completed(futures):
            part = futures.pop(future)
            _write(_file_of(folder, part), json.dumps(future.result()))
            done += part[1] - part[0]
            progress(done, len(sweep.cases))
    finally:
        for future in futures:
            future.cancel()
    rows: list[Row] = []
    for part in parts:
        rows += json.loads(_file_of(folder, part).read_text())
    about = {"description": sweep.description, "map": dict(sweep.drawing), "name": sweep.name}
    write_table(rows, result, about)
    shutil.rmtree(folder)
    return {
        "result": str(result),
        "cases": len(rows),
        "failed": sum(row["error"] is not None for row in rows),
        "first_error": next((row["error"] for row in rows if row["error"] is not None), None),
        "kernel": sum(row["engine"] == "kernel" for row in rows),
        "graph": sum(row["engine"] == "graph" for row in rows),
        "resumed": resumed,
        "simulated_s": math.fsum(row.get("duration") or 0.0 for row in rows),
    }


def _digest(sweep: Sweep) -> str:
    told = (version("forcebound"), sweep.template.plain, sweep.duration, dict(sweep.constants))
    text = json.dumps([*told, sweep.columns, sweep.cases], default=str)
    return hashlib.sha256(text.encode()).hexdigest()


def _prepare(folder: Path, digest: str, restart: bool) -> None:
    note = folder / "sweep.json"
    if restart and folder.exists():
        shutil.rmtree(folder)
    if note.exists() and json.loads(note.read_text())["digest"] != digest:
        raise ConfigError(
            f"{folder} holds parts of another sweep (other cases, launch file or version); "
            "finish that one, choose another --output, or throw them away with --restart"
        )
    folder.mkdir(parents=True, exist_ok=True)
    if not note.exists():
        _write(note, json.dumps({"digest": digest}))


def _file_of(folder: Path, part: tuple[int, int]) -> Path:
    return folder / f"{part[0]:07d}.json"


def _write(path: Path, text: str) -> None:
    """Write a file in one step: whoever looks sees all of it or none."""
    unfinished = path.with_suffix(".unfinished")
    with unfinished.open("w") as file:
        file.write(text)
        file.flush()
        os.fsync(file.fileno())
    unfinished.replace(path)


@contextmanager
def cluster_executor(address: str) -> Iterator[Executor]:
    """Give the workers of a dask cluster; each needs this version of forcebound.

    Args:
        address: Of the scheduler, such as ``tcp://host:8786``.

    Raises:
        ConfigError: If dask is not installed or there is no scheduler.
    """
    try:
        from distributed import Client
    except ImportError as error:
        raise ConfigError("--cluster needs dask: pip install 'forcebound[cluster]'") from error
    try:
        client: Any = Client(address, timeout="10s", set_as_default=False)  # type: ignore[no-untyped-call]  # dask has no types
    except (OSError, ValueError) as error:
        raise ConfigError(f"no dask scheduler at {address}: {error}") from error
    with client:
        yield client.get_executor(pure=False)
