"""Sweeps as campaigns: a row for each case, with its parameters and figures."""

import json
import math
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from forcebound.errors import ForceboundError
from forcebound.graph.graph import GraphConfig
from forcebound.graph.loader import build
from forcebound.lab.engine import Campaign, Progress, Row, run
from forcebound.lab.runs import run_all
from forcebound.lab.sweep.plan import Sweep
from forcebound.results.figures import REPORTED
from forcebound.units import split_quantity, to_si

SMALLEST_PART, LARGEST_PART, PARTS = 32, 256, 64  # cases in a part; parts aimed at


def run_cases(sweep: Sweep, cases: Sequence[tuple[int, tuple[str, ...]]]) -> list[Row]:
    """Return a row for each case, which has a number and values; a failed one has a row, too."""
    rows: list[Row] = []
    configs: list[GraphConfig] = []
    places: list[int] = []
    sweep = replace(sweep, cases=tuple(values for _, values in cases))
    for place, (number, values) in enumerate(cases):
        row: Row = {"case": number, "engine": None, "error": None}
        texts = dict(zip(sweep.columns, values, strict=True))
        row |= {f"over.{name}": _plain(text) for name, text in texts.items()}
        rows.append(row)
        try:
            config = build(sweep.template, sweep.overrides(place))
        except ForceboundError as error:
            row["error"] = f"{type(error).__name__}: {error}"
            continue
        if sweep.duration is not None:
            config = replace(config, duration=sweep.duration)
        configs.append(config)
        places.append(place)
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
    left_out = ("forcebound", "description", "realtime", "units")  # without effect in virtual time
    return {name: value for name, value in document.items() if name not in left_out}


def _figures(summary: Mapping[str, Any]) -> dict[str, Any]:
    rejected = sum(summary["rejected_packets"].values())
    # The kernel does not count the losses of links, and only the graph has events.
    # Spectra are long; `forcebound simulate --json` has them.
    spectra = ("vibration", "displayed_impedance", "undefined", "stiffness_n_per_m", "verdict")
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


def _unit_of(text: str) -> str:
    return "" if to_si(text) is None else split_quantity(text)[1]


def campaign_of(sweep: Sweep) -> Campaign:
    """Return the campaign of a sweep."""
    part = min(max(math.ceil(len(sweep.cases) / PARTS), SMALLEST_PART), LARGEST_PART)
    texts = zip(sweep.columns, zip(*sweep.cases, strict=True), strict=True)
    units = {name: unit for name, column in texts for unit in map(_unit_of, column) if unit}
    about = {"description": sweep.description, "map": dict(sweep.drawing), "name": sweep.name}
    about["units"] = units
    decisive = (sweep.template.plain, sweep.duration, dict(sweep.constants), sweep.columns)
    work = partial(run_cases, replace(sweep, cases=()))
    cases = list(enumerate(sweep.cases))
    return Campaign(sweep.name, cases, work, part, decisive=decisive, about=about)


def run_sweep(
    sweep: Sweep,
    result: Path,
    executor: Executor | None = None,
    progress: Progress = lambda done, cases: None,
    restart: bool = False,
    overwrite: bool = False,
) -> dict[str, Any]:
    """Run a sweep, or its remaining parts; arguments as of :func:`forcebound.lab.engine.run`.

    Returns:
        ``result``, ``cases``, ``failed``, ``first_error``, ``kernel``, ``graph`` (cases by
        engine), ``resumed`` (cases taken over) and ``simulated_s``.

    Raises:
        ConfigError: If ``result`` or the folder of parts is another sweep's, or not writable.
        RunError: If the executor's processes end before the work is done.
    """
    rows, resumed = run(campaign_of(sweep), executor, progress, result, restart, overwrite)
    errors = [row["error"] for row in rows if row["error"] is not None]
    return {
        "result": str(result),
        "cases": len(rows),
        "failed": len(errors),
        "first_error": errors[0] if errors else None,
        "kernel": sum(row["engine"] == "kernel" for row in rows),
        "graph": sum(row["engine"] == "graph" for row in rows),
        "simulated_s": math.fsum(row.get("duration") or 0.0 for row in rows),
        "resumed": resumed,
    }
