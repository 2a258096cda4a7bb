"""Sweeps as campaigns, ``forcebound sweep``: a row for each case, its parameters and figures."""

import json
import math
import time
from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import replace
from functools import cache, partial
from pathlib import Path

from forcebound.errors import ConfigError, ForceboundError
from forcebound.graph.graph import GraphConfig
from forcebound.graph.loader import build
from forcebound.graph.names import parameter_name
from forcebound.graph.problems import unknown
from forcebound.lab.engine import Campaign, Progress, Row, run
from forcebound.lab.runs import run_all
from forcebound.lab.sweep.plan import Sweep, load_sweep
from forcebound.lab.workers import cluster_executor, local_executor
from forcebound.messages.topology import HAND, HAND_SECTIONS
from forcebound.results.figures import REPORTED
from forcebound.run.progress import progress_bar
from forcebound.run.results import RunResult
from forcebound.units import split_quantity, to_si

SMALLEST_PART, LARGEST_PART, PARTS = 32, 256, 64  # cases in a part; parts aimed at
#: Keys of a launch file without effect in virtual time.
NO_PARAMETERS = ("forcebound", "description", "realtime", "units")


def _units(sweep: Sweep) -> dict[str, str]:
    """Units in which the varied arguments are written, by name."""
    texts = zip(sweep.columns, zip(*sweep.cases, strict=True), strict=True)
    known = ((name, text) for name, column in texts for text in column if to_si(text) is not None)
    return {name: unit for name, text in known if (unit := split_quantity(text)[1])}


def run_cases(sweep: Sweep, cases: Sequence[tuple[int, tuple[str, ...]]]) -> list[Row]:
    """Return a row for each case, which has a number and values; a failed one has a row, too."""
    rows: list[Row] = []
    configs: list[GraphConfig] = []
    places: list[int] = []
    sweep = replace(sweep, cases=tuple(values for _, values in cases))
    for place, (number, values) in enumerate(cases):
        row: Row = {"case": number, "engine": None, "error": None}
        for name, text in zip(sweep.columns, values, strict=True):
            in_si = to_si(text)
            row[f"over.{name}"] = text if in_si is None else in_si
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
        failures = {hand: one.failed for hand, one in ran.results.items() if one.failed}
        if ran.error is not None:
            rows[place]["error"] = f"{type(ran.error).__name__}: {ran.error}"
        elif failures:
            (hand, why), *_ = failures.items()
            rows[place]["error"] = (
                f"RunError: {hand}: {why}" if hand != HAND else f"RunError: {why}"
            )
        else:
            for hand, result in ran.results.items():
                rows[place] |= _of_hand(hand, result)
    return rows


def _of_hand(hand: str, result: RunResult) -> Row:
    """Return parameters and figures of a hand, by their names: ``left.peak_force_n``."""
    document = {k: value for k, value in result.document.items() if k not in NO_PARAMETERS}
    own = {k: value for k, value in document.items() if k in HAND_SECTIONS}
    own = _flat(own) | _flat(_figures(replace(result, explains=False).summary))
    of_all = _flat({k: value for k, value in document.items() if k not in HAND_SECTIONS})
    return of_all | {parameter_name(hand, name): value for name, value in own.items()}


def _figures(summary: Row) -> Row:
    rejected = sum(summary["rejected_packets"].values())
    # The kernel does not count the losses of links, and only the graph has events.
    # Spectra are long; `forcebound simulate --json` has them.
    spectra = ("vibration", "displayed_impedance", "undefined", "stiffness_n_per_m", "verdict")
    left_out = ("law", "hand", "rejected_packets", "links", "faults", "phases", *REPORTED, *spectra)
    rest = {key: value for key, value in summary.items() if key not in left_out}
    return {**rest, "rejected_packets": rejected}


def _flat(document: Row, prefix: str = "") -> Row:
    flat: Row = {}
    for name, value in document.items():
        if isinstance(value, dict):
            flat |= _flat(value, f"{prefix}{name}.")
        else:
            flat[prefix + name] = json.dumps(value) if isinstance(value, list) else value
    return flat


def run_sweep(
    sweep: Sweep,
    result: Path,
    executor: Executor | None = None,
    progress: Progress = lambda done, cases: None,
    restart: bool = False,
    overwrite: bool = False,
) -> Row:
    """Run a sweep, or its remaining parts; arguments as of :func:`forcebound.lab.engine.run`.

    Returns:
        ``result``, ``cases``, ``failed``, ``first_error``, ``kernel``, ``graph`` (cases by
        engine), ``resumed`` (cases taken over) and ``simulated_s``.

    Raises:
        ConfigError: If ``result`` or the folder of parts is another sweep's, or not writable.
        RunError: If the executor's processes end before the work is done.
    """
    campaign = Campaign(
        sweep.name,
        list(enumerate(sweep.cases)),
        partial(run_cases, replace(sweep, cases=())),
        part=min(max(math.ceil(len(sweep.cases) / PARTS), SMALLEST_PART), LARGEST_PART),
        decisive=(sweep.template.plain, sweep.duration, dict(sweep.constants), sweep.columns),
        about={
            "description": sweep.description,
            "map": dict(sweep.drawing),
            "name": sweep.name,
            "units": _units(sweep),
        },
    )
    rows, resumed = run(campaign, executor, progress, result, restart, overwrite)
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


def run_file(
    file: str,
    arguments: Sequence[str] = (),
    output: Path | None = None,
    workers: int | None = None,
    cluster: str | None = None,
    restart: bool = False,
    overwrite: bool = False,
    plot: bool = False,
) -> Row:
    """Run a sweep file and return its outcome; arguments as on the command line.

    Raises:
        ConfigError: If the file or an option is wrong; before anything runs.
        RunError: If the processes that run it end before it is done.
    """
    sweep = load_sweep(file, arguments)
    if arguments:  # the same in all cases, so checked once
        build(sweep.template, sweep.overrides(0))
    if plot:
        _check_axes(sweep)
    _check_values(sweep)
    _check_map(sweep)
    result = output or Path(f"{sweep.name}.parquet")
    began = time.monotonic()
    executors = cluster_executor(cluster) if cluster else local_executor(workers)
    with progress_bar(sweep.name) as show, executors as executor:
        document = run_sweep(sweep, result, executor, show, restart, overwrite)
    document["seconds"] = round(time.monotonic() - began, 3)
    if plot and sweep.drawing:
        from forcebound.lab.sweep.maps import draw

        picture = result.with_suffix(".png")
        draw(result, picture)
        document["map"] = str(picture)
    return document


def _check_axes(sweep: Sweep) -> None:
    """Raise if the command line holds constant what the map is to vary."""
    for key in ("x", "y"):
        name = sweep.drawing.get(key)
        if name is not None and name not in sweep.columns:
            raise ConfigError(f"map: {name!r} for {key}: is constant here: leave out --plot")


def _check_values(sweep: Sweep) -> None:
    """Raise if a name or a unit is wrong wherever it stands, so that all its cases would fail.

    The first and the last case that have it are asked: another argument may forbid it in one.
    """
    ends: dict[tuple[str, str], tuple[int, int]] = {}
    for number, case in enumerate(sweep.cases):
        for column in zip(sweep.columns, map(_name_or_unit, case), strict=True):
            ends[column] = ends.get(column, (number, number))[0], number
    for first, last in dict.fromkeys(ends.values()):
        error = _error_of(sweep, first)
        if error is not None and _error_of(sweep, last) is not None:
            raise error


@cache
def _name_or_unit(text: str) -> str:
    try:
        return split_quantity(text)[1]
    except ConfigError:
        return text


def _error_of(sweep: Sweep, case: int) -> ConfigError | None:
    try:
        build(sweep.template, sweep.overrides(case))
    except ConfigError as error:
        return error
    return None


def _check_map(sweep: Sweep) -> None:
    """Run the first case, and raise unless it has the figures that the map is to show."""
    if not sweep.drawing:
        return
    (row,) = run_cases(sweep, [(0, sweep.cases[0])])
    figures = [name for name in row if not name.startswith("over.")]
    for key in sweep.drawing.keys() & {"value", "leaks"}:
        name = sweep.drawing[key]
        if row["error"] is None and name not in figures:
            raise ConfigError(f"map: {unknown(f'figure for {key}:', name, figures)}")
