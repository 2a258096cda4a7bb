"""The engine of campaigns: runs cases in parts, in processes or on a cluster, and collects rows.

A campaign is a list of cases and a function that turns some of them into rows. The cases are cut
into parts, in order, whatever runs them, so the rows do not depend on the number of workers. With a
result file the rows of a part are on disk as soon as it is done, in the folder ``RESULT.parts``; an
interrupted campaign that is run again does only what is missing there. When all parts are done they
become one Parquet file, in one step (:mod:`forcebound.lab.table`).
"""

import hashlib
import inspect
import json
import os
import shutil
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple, Protocol, TypeAlias

from forcebound.errors import ConfigError
from forcebound.files import read_bytes, reason
from forcebound.lab.workers import completed, local_executor
from forcebound.run.progress import progress_bar

#: Plain values by name, ready for JSON; of a result file: numbers, strings, booleans, None.
Row: TypeAlias = dict[str, Any]
Progress: TypeAlias = Callable[[int, int], None]  # called with the runs done, and in total

MAX_PART = 100_000_000  # largest file of a part, bytes: a thousand times the usual size


class Runnable(Protocol):
    """A case that runs itself. A campaign with its own ``work`` may have cases of any type."""

    @property
    def runs(self) -> int:
        """Number of simulations of this case."""
        ...

    def rows(self) -> Sequence[Row]:
        """Run it."""
        ...


def rows_of_each(cases: Sequence[Runnable]) -> list[Row]:
    """Return the rows of each case."""
    return [row for case in cases for row in case.rows()]


def _source_of(work: Any) -> str:
    """Return a name and the text of the file that defines it: a changed script differs."""
    if isinstance(work, partial):
        work = work.func
    try:
        return str(work.__qualname__) + inspect.getsource(inspect.getmodule(work) or work)
    except (OSError, TypeError):  # typed in, or built in
        return ""


@dataclass(frozen=True)
class Campaign:
    """Cases and how they are run.

    Attributes:
        name: A few words for the progress bar.
        cases: The cases; they are sent to processes, so they can be pickled.
        work: Returns the rows of some of the cases, each one run; can be pickled. By default the
            cases are :class:`Runnable`.
        part: Runs of a part; there should be several parts for each process.
        decisive: Whatever else decides the rows, such as a launch file's text; JSON.
        about: Metadata of the result: ``map`` says how ``forcebound map`` draws it.
    """

    name: str
    cases: Sequence[Any]
    work: Callable[[Sequence[Any]], list[Row]] = rows_of_each
    part: int = 500
    decisive: Sequence[Any] = ()
    about: Row = field(default_factory=dict)

    @property
    def digest(self) -> str:
        """Text that two campaigns share only if version, work, cases and ``decisive`` are equal."""
        code = [_source_of(one) for one in (self.work, *dict.fromkeys(map(type, self.cases)))]
        decisive = [version("forcebound"), code, self.decisive, self.cases]
        text = json.dumps(decisive, default=str)
        return hashlib.sha256(text.encode()).hexdigest()

    def runs(self, part: Sequence[int]) -> int:
        """Return the number of runs of some cases, by their indices."""
        if self.work is rows_of_each:
            return sum(self.cases[index].runs for index in part)
        return len(part)

    def parts(self) -> list[range]:
        """Return the parts: indices of cases, in order."""
        parts, first, runs = [], 0, 0
        for index in range(len(self.cases)):
            runs += self.runs([index])
            if runs >= self.part or index == len(self.cases) - 1:
                parts.append(range(first, index + 1))
                first, runs = index + 1, 0
        return parts


class CampaignResult(NamedTuple):
    """Result of a campaign."""

    rows: list[Row]  # in the order of the cases
    resumed: int  # runs that an earlier, interrupted campaign had done


def run(
    campaign: Campaign,
    executor: Executor | None = None,
    progress: Progress = lambda done, total: None,
    result: Path | None = None,
    restart: bool = False,
    overwrite: bool = False,
) -> CampaignResult:
    """Run a campaign, or the parts of it that are not on disk yet.

    Args:
        campaign: The campaign.
        executor: Runs the parts; None: this process.
        progress: Called when a part is done, in this process.
        result: Parquet file to write; None: the rows are only returned.
        restart: Discard the parts of an earlier run.
        overwrite: Replace a ``result`` of another campaign.

    Raises:
        ConfigError: If ``result`` or its parts are another campaign's, or cannot be written.
        RunError: If the executor's processes end before the work is done.
    """
    if result is not None:
        from forcebound.lab.table import write_table  # fails early if pyarrow is missing

        _check_result(result, campaign.digest, overwrite)
    parts = campaign.parts()
    runs = [campaign.runs(part) for part in parts]
    folder = None if result is None else _Folder(result, campaign.digest, restart)
    found = folder.found() if folder else {}
    missing = [number for number in range(len(parts)) if number not in found]
    done = resumed = sum(runs) - sum(runs[number] for number in missing)
    progress(done, sum(runs))
    tasks = [[campaign.cases[index] for index in parts[number]] for number in missing]
    for place, rows in completed(executor, campaign.work, tasks):
        found[missing[place]] = rows
        if folder:
            folder.add(missing[place], rows)
        done += runs[missing[place]]
        progress(done, sum(runs))
    rows = [row for number in range(len(parts)) for row in found[number]]
    if result is not None and folder:
        write_table(rows, result, {**campaign.about, "digest": campaign.digest})
        folder.remove()
    return CampaignResult(rows, resumed)


def run_here(campaign: Campaign, workers: int | None, result: Path | None = None) -> CampaignResult:
    """Run a campaign on this machine with a progress bar.

    Args:
        campaign: The campaign.
        workers: Processes; None: one for each core; 0: this process.
        result: Parquet file to write; None: the rows are only returned.
    """
    with progress_bar(campaign.name) as show, local_executor(workers) as executor:
        return run(campaign, executor, show, result)


def _check_result(result: Path, digest: str, overwrite: bool) -> None:
    """Refuse to replace a file that is not an earlier result of the same campaign."""
    from forcebound.lab.table import read_about

    if overwrite or not result.exists():
        return
    try:
        is_ours = read_about(result).get("digest") == digest
    except ConfigError:
        is_ours = False
    if not is_ours:
        raise ConfigError(
            f"{result} exists and is not a result of these cases (others, or of another version); "
            "choose another file, or delete it (a sweep: --overwrite)"
        )


class _Folder:
    """Rows of the finished parts, one file each, in a folder next to the result."""

    def __init__(self, result: Path, digest: str, restart: bool) -> None:
        self._folder = result.with_name(result.name + ".parts")
        note = self._folder / "campaign.json"
        try:
            if restart and self._folder.exists():
                shutil.rmtree(self._folder)
            if note.exists() and json.loads(read_bytes(note, MAX_PART))["digest"] != digest:
                raise ConfigError(
                    f"{self._folder} holds parts of other cases, or of another version; choose "
                    "another file, or delete the folder (a sweep: --restart)"
                )
            self._folder.mkdir(parents=True, exist_ok=True)
            if not note.exists():
                write_json(note, {"digest": digest})
        except OSError as error:
            raise ConfigError(f"cannot write {self._folder}: {reason(error)}") from error

    def found(self) -> dict[int, list[Row]]:
        """Return the rows of the parts that are there."""
        files = self._folder.glob("[0-9]*.json")
        return {int(file.stem): json.loads(read_bytes(file, MAX_PART)) for file in files}

    def add(self, number: int, rows: list[Row]) -> None:
        write_json(self._folder / f"{number:07d}.json", rows)

    def remove(self) -> None:
        shutil.rmtree(self._folder)


def write_json(path: Path, content: Any) -> None:
    """Write a file in one step: a reader sees all of it or none."""
    unfinished = path.with_suffix(".unfinished")
    with unfinished.open("w") as file:
        json.dump(content, file)
        file.flush()
        os.fsync(file.fileno())
    unfinished.replace(path)
