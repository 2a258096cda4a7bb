"""Command ``forcebound sweep``."""

import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from forcebound.config.loader import build
from forcebound.sweep.plan import load_sweep
from forcebound.sweep.runner import run_sweep
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
