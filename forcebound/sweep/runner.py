"""Runner of sweeps: in parts, through any executor; it can be interrupted at any time.

1. Cases are cut into parts, in order (:mod:`forcebound.sweep.parts`).
2. Each part is one task of a :class:`concurrent.futures.Executor`: this machine's cores, a dask
   cluster, anything. Its rows are written to disk at once.
3. When all parts are done they become one Parquet file, in one step, and are deleted.

A sweep that is started again continues with the parts that it finds.
"""

import json
import math
from collections.abc import Callable, Mapping
from concurrent.futures import Executor
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeAlias

from forcebound.analysis.bounder import REPORTED
from forcebound.config.graph import GraphConfig
from forcebound.config.loader import build
from forcebound.errors import ConfigError, ForceboundError
from forcebound.lab.runs import run_all
from forcebound.sweep.parts import PartFolder, Row, digest_of, parts_of
from forcebound.sweep.plan import Sweep
from forcebound.units import to_si
from forcebound.workers import completed

Progress: TypeAlias = Callable[[int, int], None]  # cases done, cases in all


def run_cases(sweep: Sweep, first: int) -> list[Row]:
    """Return one row per case, numbered from ``first``; a failed case has a row, too."""
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
    """Return a swept value for a column: in SI units, or as text."""
    number = to_si(text)
    return text if number is None else number


def _parameters(document: Mapping[str, Any]) -> dict[str, Any]:
    left_out = ("forcebound", "description", "realtime")  # without effect in virtual time
    return {name: value for name, value in document.items() if name not in left_out}


def _figures(summary: Mapping[str, Any]) -> dict[str, Any]:
    rejected = sum(summary["rejected_packets"].values())
    # The kernel does not count the losses of links, and only the graph has events.
    # Spectra are long; `forcebound simulate --json` has them.
    spectra = ("vibration", "displayed_impedance", "undefined")
    left_out = ("law", "rejected_packets", "links", "faults", "phases", *REPORTED, *spectra)
    rest = {key: value for key, value in summary.items() if key not in left_out}
    return {**rest, "rejected_packets": rejected}


def _flat(document: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for name, value in document.items():
        if isinstance(value, Mapping):
            flat |= _flat(value, f"{prefix}{name}.")
        else:
            flat[prefix + name] = json.dumps(value) if isinstance(value, list) else value
    return flat


def run_sweep(
    sweep: Sweep,
    result: Path,
    executor: Executor,
    progress: Progress = lambda done, cases: None,
    restart: bool = False,
    overwrite: bool = False,
) -> dict[str, Any]:
    """Run a sweep, or its remaining parts, and write its Parquet file.

    Args:
        sweep: The sweep to run.
        result: The Parquet file. Until all parts are done they are in a folder of this name with
            ``.parts`` appended.
        executor: Runs the parts.
        progress: Called when cases are done.
        restart: Discard parts of an earlier run.
        overwrite: Replace a ``result`` that is not of this sweep.

    Returns:
        ``result``, ``cases``, ``failed``, ``first_error``, ``kernel``, ``graph`` (cases by
        engine), ``resumed`` (cases taken over) and ``simulated_s``.

    Raises:
        ConfigError: If ``result`` or the folder of parts is another sweep's, or not writable.
        RunError: If the executor's processes end before the work is done.
    """
    from forcebound.sweep.table import (
        write_table,  # fails before the work begins if pyarrow is missing
    )

    digest = digest_of(sweep)
    if not overwrite:
        _check_result(result, digest)
    folder = PartFolder(result, digest, restart)
    parts = parts_of(len(sweep.cases))
    missing = folder.missing(parts)
    resumed = len(sweep.cases) - sum(last - first for first, last in missing)
    done = resumed
    progress(done, len(sweep.cases))
    tasks = [(replace(sweep, cases=sweep.cases[first:last]), first) for first, last in missing]
    for index, rows in completed(executor, _run_part, tasks):
        folder.add(missing[index], rows)
        done += len(rows)
        progress(done, len(sweep.cases))
    rows = folder.rows(parts)
    about = {"description": sweep.description, "map": dict(sweep.drawing), "name": sweep.name}
    write_table(rows, result, {**about, "digest": digest})
    folder.remove()
    return {"result": str(result), **_counts(rows), "resumed": resumed}


def _run_part(task: tuple[Sweep, int]) -> list[Row]:
    return run_cases(*task)


def _check_result(result: Path, digest: str) -> None:
    """Refuse to replace a file that is not an earlier result of the same sweep."""
    from forcebound.sweep.table import read_about

    if not result.exists():
        return
    try:
        is_ours = read_about(result).get("digest") == digest
    except ConfigError:
        is_ours = False
    if not is_ours:
        raise ConfigError(
            f"{result} exists and is not a result of this sweep (other cases, launch file or "
            "version); choose another --output, or replace it with --overwrite"
        )


def _counts(rows: list[Row]) -> dict[str, Any]:
    errors = [row["error"] for row in rows if row["error"] is not None]
    return {
        "cases": len(rows),
        "failed": len(errors),
        "first_error": errors[0] if errors else None,
        "kernel": sum(row["engine"] == "kernel" for row in rows),
        "graph": sum(row["engine"] == "graph" for row in rows),
        "simulated_s": math.fsum(row.get("duration") or 0.0 for row in rows),
    }
