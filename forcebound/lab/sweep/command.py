"""Command ``forcebound sweep``."""

import time
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

from forcebound.errors import ConfigError
from forcebound.graph.loader import build
from forcebound.graph.problems import unknown
from forcebound.lab.sweep.plan import Sweep, load_sweep
from forcebound.lab.sweep.runner import run_cases, run_sweep
from forcebound.lab.workers import cluster_executor, local_executor, progress_bar
from forcebound.units import split_quantity


def run(
    file: str,
    arguments: Sequence[str] = (),
    output: Path | None = None,
    workers: int | None = None,
    cluster: str | None = None,
    restart: bool = False,
    overwrite: bool = False,
    plot: bool = False,
) -> dict[str, Any]:
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
    wanted = {key: sweep.drawing[key] for key in ("value", "leaks") if key in sweep.drawing}
    if not wanted:
        return
    (row,) = run_cases(sweep, [(0, sweep.cases[0])])
    figures = [name for name in row if not name.startswith("over.")]
    for key, name in wanted.items():
        if row["error"] is None and name not in figures:
            raise ConfigError(f"map: {unknown(f'figure for {key}:', name, figures)}")
