"""Parts of a sweep on disk: cases in order, one file per finished part.

The division into parts does not depend on the executor. The rows of a part are written in one step
to a file of its own, in the folder ``RESULT.parts`` next to the result. The digest in
``sweep.json`` identifies the sweep: it covers all cases, the launch file and the
version of forcebound.
"""

import hashlib
import json
import math
import os
import shutil
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any, TypeAlias

from forcebound.errors import ConfigError
from forcebound.files import read_bytes, reason
from forcebound.sweep.plan import Sweep

Row: TypeAlias = dict[str, Any]
Part: TypeAlias = tuple[int, int]  # first case, and one past the last

SMALLEST_PART, LARGEST_PART, PARTS = 32, 256, 64  # cases in a part; parts aimed at
MAX_PART = 100_000_000  # bytes of the file of a part, a thousand times as many as it has


def parts_of(cases: int) -> list[Part]:
    """Return the parts of ``cases`` cases."""
    size = min(max(math.ceil(cases / PARTS), SMALLEST_PART), LARGEST_PART)
    return [(first, min(first + size, cases)) for first in range(0, cases, size)]


def digest_of(sweep: Sweep) -> str:
    """Return a digest that two sweeps share only if their rows are equal."""
    decisive = (version("forcebound"), sweep.template.plain, sweep.duration, dict(sweep.constants))
    text = json.dumps([*decisive, sweep.columns, sweep.cases], default=str)
    return hashlib.sha256(text.encode()).hexdigest()


class PartFolder:
    """Folder of finished parts, next to the result.

    Args:
        result: The Parquet file of the sweep.
        digest: Digest of the sweep.
        restart: Discard all parts in the folder, also of another sweep.

    Raises:
        ConfigError: If the folder holds parts of another sweep, or cannot be written.
    """

    def __init__(self, result: Path, digest: str, restart: bool) -> None:
        self._folder = result.with_name(result.name + ".parts")
        note = self._folder / "sweep.json"
        try:
            if restart and self._folder.exists():
                shutil.rmtree(self._folder)
            if note.exists() and json.loads(read_bytes(note, MAX_PART))["digest"] != digest:
                raise ConfigError(
                    f"{self._folder} holds parts of another sweep (other cases, launch file or "
                    "version); finish that one, choose another --output, or discard them with "
                    "--restart"
                )
            self._folder.mkdir(parents=True, exist_ok=True)
            if not note.exists():
                _write(note, json.dumps({"digest": digest}))
        except OSError as error:
            raise ConfigError(f"cannot write {self._folder}: {reason(error)}") from error

    def missing(self, parts: Sequence[Part]) -> list[Part]:
        """Return the parts that are not done."""
        return [part for part in parts if not self._file_of(part).exists()]

    def add(self, part: Part, rows: list[Row]) -> None:
        """Write the rows of a part."""
        _write(self._file_of(part), json.dumps(rows))

    def rows(self, parts: Sequence[Part]) -> list[Row]:
        """Return the rows of all parts, in order."""
        files = map(self._file_of, parts)
        return [row for file in files for row in json.loads(read_bytes(file, MAX_PART))]

    def remove(self) -> None:
        """Remove the folder with all that it holds."""
        shutil.rmtree(self._folder)

    def _file_of(self, part: Part) -> Path:
        return self._folder / f"{part[0]:07d}.json"


def _write(path: Path, text: str) -> None:
    """Write a file in one step: a reader sees all of it or none."""
    unfinished = path.with_suffix(".unfinished")
    with unfinished.open("w") as file:
        file.write(text)
        file.flush()
        os.fsync(file.fileno())
    unfinished.replace(path)
