"""The graphs that run on this machine, found by their run directories and by nothing else.

A run directory is named ``forcebound-...``, lies in the user's runtime folder
(:mod:`forcebound.folders`) or in the one for temporary files, belongs to the user, has a run's
document (:class:`forcebound.run.run_directory.RunDocument`) and is held by a launcher, or by an
environment for a graph on another machine (:mod:`forcebound.run.run_directory`).
"""

import os
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from forcebound.errors import ConfigError, RunError
from forcebound.folders import is_own
from forcebound.messages.topology import is_bound
from forcebound.network import sockets
from forcebound.roles import LAUNCHER
from forcebound.run.run_directory import (
    RunDocument,
    graph_in,
    has_launcher,
    is_held,
    own_run_directories,
    run_folders,
)

START_TIMEOUT = 60.0  # s, within which a launcher makes its run directory
POLL_NS = 100_000_000  # between two looks for it


def running() -> dict[Path, RunDocument]:
    """Return the run directories of this user's graphs that run, by name, with their documents."""
    found = {_real(run_dir) for run_dir in own_run_directories(run_folders())}
    documents = {run_dir: _document(run_dir) for run_dir in sorted(found)}
    return {run_dir: document for run_dir, document in documents.items() if document is not None}


def find(
    run: Path | None = None, *, require_graph: bool = False, option: str = "--run GRAPH"
) -> Path:
    """Return the run directory of one running graph: the only one, or that of a directory or name.

    An environment by itself counts only where no launcher runs a graph, and not at all with
    ``require_graph``. ``option`` is how a command takes a run directory, for messages.

    Raises:
        ConfigError: If no graph runs, several run, or ``run`` is not one that runs.
    """
    known = running()
    if run is None:
        return _only(known, require_graph, option)
    run_dir = _real(run)
    document = _document(run_dir)  # the directory may lie elsewhere
    if document is None:
        named = {path: one for path, one in known.items() if _is_named(one, str(run))}
        if named:
            return _only(named, require_graph, option)
        others = f"these are:{_list(known)}" if known else "none runs"
        raise ConfigError(
            f"{run} is not the run directory of a running graph, nor its launch file; {others}"
        )
    if require_graph and not document.is_graph:
        raise ConfigError(f"in {run} runs an environment alone, and no graph")
    return run_dir


def find_launched(launcher: int) -> Path:
    """Return the run directory of a launcher's graph once it runs; RunError after a minute."""
    end = time.monotonic() + START_TIMEOUT
    while time.monotonic() < end:
        run_dir = launched(launcher)
        if run_dir is not None:
            return run_dir
        sockets.wait((), POLL_NS)
    raise RunError(f"process {launcher} has started no graph for {START_TIMEOUT:g} s")


def launched(launcher: int) -> Path | None:
    """Return the run directory of a launcher's graph; None before it runs."""
    found = (run_dir for run_dir, document in running().items() if document.launcher == launcher)
    return next(found, None)


class Watch:
    """Knows whether a graph has ended, also while its launcher still computes the result."""

    def __init__(self, run_dir: Path) -> None:
        self._run_dir = run_dir
        self._launcher = graph_in(run_dir).nodes[LAUNCHER]
        self.was_launched = False  # whether a launcher was seen; an environment has none

    @property
    def is_over(self) -> bool:
        """Whether it has ended."""
        is_launched = is_bound(self._run_dir, self._launcher)
        self.was_launched |= is_launched
        return (self.was_launched and not is_launched) or not is_held(self._run_dir)


def _is_named(document: RunDocument, name: str) -> bool:
    """Whether a graph was launched from a file of this name, with or without folder and ending."""
    file = Path(document.file.partition(" ")[0])
    return name in (str(file), file.name, file.stem)


def _only(known: Mapping[Path, RunDocument], require_graph: bool, option: str) -> Path:
    graphs = [run_dir for run_dir, document in known.items() if document.is_graph]
    if require_graph and known and not graphs:
        which = "only environments for graphs on other machines"
        raise ConfigError(f"no graph of yours runs on this machine, {which}:{_list(known)}")
    launched = [run_dir for run_dir in known if has_launcher(run_dir)]
    candidates = launched or graphs or list(known)
    if not candidates:
        raise ConfigError(
            "no graph of yours runs on this machine; start one with `forcebound launch FILE`"
        )
    if len(candidates) > 1:
        listed = _list({run_dir: known[run_dir] for run_dir in candidates})
        raise ConfigError(f"several graphs run; name one with {option}, of{listed}")
    return candidates[0]


@contextmanager
def while_running(run_dir: Path) -> Iterator[None]:
    """Turn errors into one clear RunError if the graph has ended."""
    try:
        yield
    except (ConfigError, OSError) as error:
        if _document(run_dir) is not None:
            raise
        raise RunError(f"the graph in {run_dir} has ended") from error


def _real(path: Path) -> Path:
    return Path(os.path.realpath(path))  # a link to itself is no error here, as it is of resolve


def _document(run_dir: Path) -> RunDocument | None:
    """Return the document of a run of this user that goes on; None: there is no such run."""
    try:
        # Others can make such a directory, too, and would then be asked in place of the graph.
        if not is_own(run_dir):
            return None
        document = RunDocument.read(run_dir)
    except (ConfigError, OSError):
        return None  # a run that just begins or ends
    return document if is_held(run_dir) else None  # without an owner: a crash has left it


def _list(known: Mapping[Path, RunDocument]) -> str:
    """Return a line for each run directory, with file and process of the graph."""
    lines = []
    for run_dir, document in known.items():
        alone = "" if document.is_graph else ", an environment alone"
        lines.append(f"\n  {run_dir}  ({document.file or '?'}, process {document.launcher}{alone})")
    return "".join(lines)
