"""Command ``forcebound sweep``: read, run with progress on standard error, draw."""

import time
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from forcebound.config.loader import build
from forcebound.sweep.plan import load_sweep
from forcebound.sweep.runner import run_sweep
from forcebound.workers import cluster_executor, local_executor


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
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    sweep = load_sweep(file, arguments)
    if arguments:  # equal in all cases, so checked once
        build(sweep.template, sweep.overrides(0))
    result = output or Path(f"{sweep.name}.parquet")
    began = time.monotonic()
    columns = (
        TextColumn(sweep.name),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("left:"),
        TimeRemainingColumn(elapsed_when_finished=False),
    )
    bar = Progress(*columns, console=Console(stderr=True))
    task = bar.add_task(sweep.name, total=len(sweep.cases))
    with ExitStack() as stack:
        executor = cluster_executor(cluster) if cluster else local_executor(workers)

        def show(done: int, cases: int) -> None:
            if not bar.live.is_started:  # not before the output was checked
                stack.enter_context(bar)
            bar.update(task, completed=done, total=cases)

        document = run_sweep(sweep, result, stack.enter_context(executor), show, restart, overwrite)
    document["seconds"] = round(time.monotonic() - began, 3)
    if plot and sweep.drawing:
        from forcebound.sweep.maps import draw

        picture = result.with_suffix(".png")
        draw(result, picture)
        document["map"] = str(picture)
    return document
