"""Texts of sweep files, and an executor that runs their cases at once."""

from collections.abc import Callable
from concurrent.futures import Executor, Future
from pathlib import Path
from typing import Any

SMALL = """
forcebound: 1
description: a small one
launch: stiff_wall
duration: 50 ms
set: { approach_speed: 100 mm/s }
over:
  law: [certified, none]
  stiffness: { from: 1 N/mm, to: 4 N/mm, count: 3, scale: log }
map: { x: stiffness, value: peak_force_n, per: law }
"""

LONG = SMALL.replace("count: 3", "count: 320")


class AtOnce(Executor):
    """Runs each task when it is submitted."""

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        future: Future[Any] = Future()
        future.set_result(fn(*args, **kwargs))
        return future


def written(folder: Path, text: str) -> Path:
    file = folder / "small.yaml"
    file.write_text(text)
    return file
