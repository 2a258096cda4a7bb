"""The engine of campaigns: runs cases in parts, in processes or on a cluster, and collects rows.

A campaign is a list of cases and a function that turns some of them into rows. The cases are cut
into parts, in order, whatever runs them, so the rows do not depend on the number of workers. With a
result file the rows of a part are on disk as soon as it is done, in the folder ``RESULT.parts``; an
interrupted campaign that is run again does only what is missing there. When all parts are done they
become one Parquet file, in one step (:mod:`forcebound.lab.table`).
"""

import json
import os
import shutil
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field
from functools import cached_property, partial
from pathlib import Path
from typing import Any, NamedTuple, Protocol, TypeAlias

from forcebound.errors import ConfigError
from forcebound.files import read_bytes, reason
from forcebound.lab.digest import digest_of, sources
from forcebound.lab.workers import completed, local_executor
from forcebound.run.progress import progress_bar

#: Plain values by name, ready for JSON; of a result file: numbers, strings, booleans, None, lists.
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


@dataclass(frozen=True)
class Campaign:
    """Cases and how they are run.

    ::

        def squares(cases):
            return [{"x": x, "square": x * x} for x in cases]

        rows = run_here(Campaign("squares", range(1000), squares), workers=2).rows

    Attributes:
        name: A few words for the progress bar.
        cases: The cases; they are sent to processes, so they can be pickled.
        work: Returns the rows of some of the cases, each one run; can be pickled. By default the
            cases are :class:`Runnable`.
        part: Runs of a part; there should be several parts for each process.
        decisive: Whatever else decides the rows, such as a launch file's content; None: the
            arguments of ``work``, if it is a :func:`functools.partial`.
        about: Metadata of the result: ``map`` says how ``forcebound map`` draws it.
    """

    name: str
    cases: Sequence[Any]
    work: Callable[[Sequence[Any]], list[Row]] = rows_of_each
    part: int = 500
    decisive: Sequence[Any] | None = None
    about: Row = field(default_factory=dict)

    @cached_property
    def digest(self) -> str:
        """Text that two campaigns share only if code, parts, cases and ``decisive`` are equal.

        Raises:
            ConfigError: If a case has no form that is the same in each process.
        """
        work: Any = self.work
        if self.decisive is not None and isinstance(work, partial):
            work = work.func
        classes = [*dict.fromkeys(map(type, self.cases))]
        return digest_of([sources(), work, classes, self.part, self.decisive, [*self.cases]])

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
    resumed: int  # runs that were on disk


def run(
    campaign: Campaign,
    executor: Executor | None = None,
    progress: Progress = lambda done, total: None,
    result: Path | None = None,
    restart: bool = False,
    overwrite: bool = False,
) -> CampaignResult:
    """Run a campaign, or the parts of it that are not on disk yet.

    A ``result`` that is there already is read, and its metadata written again.

    Args:
        campaign: The campaign.
        executor: Runs the parts; None: this process.
        progress: Called when a part is done, in this process.
        result: Parquet file to write; None: the rows are only returned.
        restart: Discard what an earlier run left, its result included.
        overwrite: Replace a ``result`` of another campaign.

    Raises:
        ConfigError: If ``result`` or its parts are another campaign's, or cannot be written; or if
            something cannot be sent to the executor.
        RunError: If the executor's processes end before the work is done.
    """
    finished: dict[int, list[Row]] = {}
    folder = None
    if result is not None:
        from forcebound.lab.table import read_table, write_table  # fails early without pyarrow

        about = {**campaign.about, "digest": campaign.digest}
        if _is_done(result, campaign.digest, overwrite) and not restart:
            rows = read_table(result).rows
            write_table(rows, result, about)
            return CampaignResult(rows, campaign.runs(range(len(campaign.cases))))
        folder = _Folder(result, campaign.digest, restart)
        finished = folder.finished()
    parts = campaign.parts()
    runs = [campaign.runs(part) for part in parts]
    missing = [number for number in range(len(parts)) if number not in finished]
    done = resumed = sum(runs) - sum(runs[number] for number in missing)
    progress(done, sum(runs))
    tasks = [[campaign.cases[index] for index in parts[number]] for number in missing]
    for place, rows in completed(executor, campaign.work, tasks):
        finished[missing[place]] = rows
        if folder:
            folder.add(missing[place], rows)
        done += runs[missing[place]]
        progress(done, sum(runs))
    rows = [row for number in range(len(parts)) for row in finished[number]]
    if result is not None and folder:
        write_table(rows, result, about)
        folder.remove()
    return CampaignResult(rows, resumed)


def run_here(campaign: Campaign, workers: int | None, result: Path | None = None) -> CampaignResult:
    """Run a campaign on this machine with a progress bar; errors as of :func:`run`.

    Args:
        campaign: The campaign.
        workers: Processes; None: one for each core; 0: this process.
        result: Parquet file to write; None: the rows are only returned.
    """
    with progress_bar(campaign.name) as show, local_executor(workers) as executor:
        return run(campaign, executor, show, result)


def _is_done(result: Path, digest: str, overwrite: bool) -> bool:
    """Return whether a file is the result of a campaign; ConfigError if it is of another one."""
    from forcebound.lab.table import read_about

    if not result.exists():
        return False
    try:
        is_ours: bool = read_about(result).get("digest") == digest
    except ConfigError:
        is_ours = False
    if not is_ours and not overwrite:
        raise ConfigError(
            f"{result} exists and is not a result of these cases (others, or of other code); "
            "choose another file, or delete it (a sweep: --overwrite, overwrite=True)"
        )
    return is_ours


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
                    f"{self._folder} holds parts of other cases, or of other code; choose "
                    "another file, or delete the folder (a sweep: --restart, restart=True)"
                )
            self._folder.mkdir(parents=True, exist_ok=True)
            if not note.exists():
                write_json(note, {"digest": digest})
        except OSError as error:
            raise ConfigError(f"cannot write {self._folder}: {reason(error)}") from error

    def finished(self) -> dict[int, list[Row]]:
        """Return the rows of the parts that are there."""
        files = self._folder.glob("[0-9]*.json")
        return {int(file.stem): json.loads(read_bytes(file, MAX_PART)) for file in files}

    def add(self, number: int, rows: list[Row]) -> None:
        """Keep the rows of a part."""
        write_json(self._folder / f"{number:07d}.json", rows)

    def remove(self) -> None:
        """Delete all parts."""
        shutil.rmtree(self._folder)


def write_json(path: Path, content: Any) -> None:
    """Write a file in one step: a reader sees all of it or none."""
    unfinished = path.with_suffix(".unfinished")
    with unfinished.open("w") as file:
        file.write(json.dumps(content))
        file.flush()
        os.fsync(file.fileno())
    unfinished.replace(path)
