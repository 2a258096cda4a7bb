"""Command ``forcebound sweep``."""

import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from forcebound.config.loader import build
from forcebound.config.problems import unknown
from forcebound.errors import ConfigError
from forcebound.sweep.plan import Sweep, load_sweep
from forcebound.sweep.runner import run_cases, run_sweep
from forcebound.workers import cluster_executor, local_executor, progress_bar


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
    _check_map(sweep)
    result = output or Path(f"{sweep.name}.parquet")
    began = time.monotonic()
    executors = cluster_executor(cluster) if cluster else local_executor(workers)
    with progress_bar(sweep.name) as show, executors as executor:
        document = run_sweep(sweep, result, executor, show, restart, overwrite)
    document["seconds"] = round(time.monotonic() - began, 3)
    if plot and sweep.drawing:
        from forcebound.sweep.maps import draw

        picture = result.with_suffix(".png")
        draw(result, picture)
        document["map"] = str(picture)
    return document


def _check_map(sweep: Sweep) -> None:
    """Run the first case, and raise unless it has the figures that the map is to show."""
    wanted = {key: sweep.drawing[key] for key in ("value", "leaks") if key in sweep.drawing}
    if not wanted:
        return
    (row,) = run_cases(replace(sweep, cases=sweep.cases[:1]), 0)
    figures = [name for name in row if not name.startswith("over.")]
    for key, name in wanted.items():
        if row["error"] is None and name not in figures:
            raise ConfigError(f"map: {unknown(f'figure for {key}:', name, figures)}")
