"""Sweeps as campaigns, ``forcebound sweep``: a row for each case, its parameters and figures."""

import json
import math
import time
from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from types import MappingProxyType
from typing import Any, TypeAlias

from forcebound.errors import ConfigError, ForceboundError, RunError
from forcebound.graph.forms import Values
from forcebound.graph.names import parameter_name
from forcebound.graph.problems import unknown
from forcebound.haptics.laws import LAWS
from forcebound.interface.runs import Run
from forcebound.lab.engine import Campaign, Progress, Row, run
from forcebound.lab.runs import run_all
from forcebound.lab.sweep.measures import Measures, value_of
from forcebound.lab.sweep.plan import Sweep, load_sweep
from forcebound.lab.workers import cluster_executor, local_executor
from forcebound.messages.topology import HAND, HAND_SECTIONS
from forcebound.results.figures import REPORTED
from forcebound.run.progress import progress_bar
from forcebound.run.results import RunResult
from forcebound.units import split_quantity, to_si

LARGEST_PART, PARTS = 256, 64  # cases in a part; parts aimed at
#: Keys of a launch file without effect in virtual time.
NO_PARAMETERS = ("forcebound", "description", "realtime", "units")


Case: TypeAlias = tuple[int, Sequence[str]]  # index of its sweep, and values of its columns


def campaign_of(
    sweeps: Sequence[Sweep], cases: Sequence[Case], measures: Measures, drawing: Values
) -> Campaign:
    """Return the campaign of cases, each of one of some sweeps.

    Args:
        sweeps: The sweeps; they differ in their launch file.
        cases: The cases, in the order of the rows.
        measures: Functions of each run, by the name of their column.
        drawing: The map section.
    """
    first = dict(reversed(cases))  # of each sweep
    sweeps = [replace(one, cases=()) for one in sweeps]
    texts = (pair for i, values in cases for pair in zip(sweeps[i].columns, values, strict=True))
    known = ((name, text) for name, text in texts if to_si(text) is not None)
    units = {name: unit for name, text in known if (unit := split_quantity(text)[1])}
    about = {"name": sweeps[0].name, "description": sweeps[0].description, "units": units}
    shown: Any = {"name": "", "description": "", "drawing": {}}  # decides no row
    files = [replace(one, template=one.template.plain, **shown) for one in sweeps]
    parts = [_parts(one, first[index]) for index, one in enumerate(sweeps)]
    return Campaign(
        sweeps[0].name,
        [(number, *case) for number, case in enumerate(cases)],
        partial(_run_part, sweeps, measures),
        part=min(math.ceil(len(cases) / PARTS), LARGEST_PART),
        decisive=(files, parts, dict(measures)),
        about={**about, "map": dict(drawing)},
    )


def _parts(sweep: Sweep, values: Sequence[str]) -> list[object]:
    """Return the parts of a case, whose code decides its rows; none if it is wrong."""
    try:
        config = sweep.graph(values)
    except ForceboundError:
        return []
    hands = config.hands.values()
    parts = [part for hand in hands for part in (hand.device, hand.controller, hand.operator)]
    laws = [LAWS[hand.servo.law] for hand in hands]
    return [*map(type, [*parts, config.environment.model]), *laws]


def _run_part(
    sweeps: Sequence[Sweep], measures: Measures, cases: Sequence[tuple[int, int, Sequence[str]]]
) -> list[Row]:
    return [run_case(sweeps[index], number, values, measures) for number, index, values in cases]


def run_case(
    sweep: Sweep,
    number: int,
    values: Sequence[str],
    measures: Measures = MappingProxyType({}),
    is_trial: bool = False,
) -> Row:
    """Return the row of a case; a failed one has one, too.

    Raises:
        ConfigError: In a trial, if a measure returns something that no column can have.
    """
    row: Row = {"case": number, "engine": None, "error": None}
    for name, text in zip(sweep.columns, values, strict=True):
        in_si = to_si(text)
        row[f"over.{name}"] = text if in_si is None else in_si
    row |= sweep.same
    case = ", ".join(f"{key[5:]}={value}" for key, value in row.items() if key.startswith("over."))
    try:
        (ran,) = run_all([sweep.graph(values)])
        row["engine"] = ran.engine
        if ran.error is not None:
            raise ran.error
        for hand, result in ran.results.items():
            if result.failed:
                raise RunError(f"{hand}: {result.failed}" if hand != HAND else result.failed)
    except Exception as error:  # any failure of a user's part is this case's error
        return row | {"error": f"{type(error).__name__}: {error}"}
    results = {hand: replace(result, explains=False) for hand, result in ran.results.items()}
    for hand, result in results.items():
        row |= _of_hand(hand, result)
    for name, measure in measures.items():
        try:
            row[name] = value_of(name, measure, Run(results))
        except ForceboundError as error:
            if is_trial and isinstance(error, ConfigError):
                raise
            row["error"] = row["error"] or f"{error} (case {number}: {case})"
    return row


def _of_hand(hand: str, result: RunResult) -> Row:
    """Return parameters and figures of a hand, by their names: ``left.peak_force_n``."""
    document = {k: value for k, value in result.document.items() if k not in NO_PARAMETERS}
    own = {k: value for k, value in document.items() if k in HAND_SECTIONS}
    own = _flat(own) | _flat(_figures(result.summary))
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
    campaign = campaign_of([sweep], [(0, values) for values in sweep.cases], {}, sweep.drawing)
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
        sweep.graph(sweep.cases[0])
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
        from forcebound.lab.sweep.maps import draw  # matplotlib is slow to import

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
        sweep.graph(sweep.cases[case])
    except ConfigError as error:
        return error
    return None


def _check_map(sweep: Sweep) -> None:
    """Run the first case, and raise unless it has the figures that the map is to show."""
    if not sweep.drawing:
        return
    row = run_case(sweep, 0, sweep.cases[0])
    figures = [name for name in row if not name.startswith("over.")]
    for key in sweep.drawing.keys() & {"value", "leaks"}:
        name = sweep.drawing[key]
        if row["error"] is None and name not in figures:
            raise ConfigError(f"map: {unknown(f'figure for {key}:', name, figures)}")
