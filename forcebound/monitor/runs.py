"""The graphs that run on this machine, found by their run directories and by nothing else.

A run directory is named ``forcebound-...``, lies in the folder for temporary files, belongs to the
user, has a run's document (:class:`forcebound.launch.live.RunDocument`) and is held by a launcher
or by nodes that were started by hand (:mod:`forcebound.launch.holding`).
"""

import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from forcebound.errors import ConfigError, RunError
from forcebound.launch.holding import is_held
from forcebound.launch.live import PREFIX, RunDocument, run_folders
from forcebound.process import has_control
from forcebound.processes import LAUNCHER


def running(folders: Iterable[Path] | None = None) -> list[Path]:
    """Return the run directories of this user's graphs that run, by name.

    Args:
        folders: Where to look; by default where the launcher makes run directories.
    """
    folders = run_folders() if folders is None else folders
    found = {run_dir.resolve() for folder in folders for run_dir in folder.glob(f"{PREFIX}*")}
    return sorted(run_dir for run_dir in found if _runs(run_dir))


def find(
    run: Path | None = None,
    folders: Iterable[Path] | None = None,
    *,
    of_graph: bool = False,
    option: str = "--run ",
) -> Path:
    """Return the run directory of the graph that is meant.

    Args:
        run: Its run directory, as :func:`running` gives it; None: the only graph that runs. A node
            that was started by hand counts only where no launcher runs a graph.
        folders: As in :func:`running`.
        of_graph: Whether an environment alone, for a graph on another machine, is not enough.
        option: How a command takes a run directory, for messages.

    Raises:
        ConfigError: If no graph runs, several run and ``run`` does not say which, or ``run`` is no
            directory of one that runs.
    """
    known = running(folders)
    if run is None:
        graphs = [run_dir for run_dir in known if _document(run_dir, "is_graph")]
        if of_graph and known and not graphs:
            told = "only environments for graphs on other machines"
            raise ConfigError(f"no graph of yours runs on this machine, {told}:{_list(known)}")
        known = list(filter(_is_launched, known)) or graphs or known
        if len(known) == 1:
            return known[0]
        if known:
            raise ConfigError(f"several graphs run; say which one: {option}DIR, of{_list(known)}")
        raise ConfigError("no graph of yours runs on this machine; start one: forcebound launch")
    run_dir = run.resolve()
    if _runs(run_dir):  # also one that lies elsewhere
        if of_graph and not _document(run_dir, "is_graph"):
            raise ConfigError(f"in {run} runs an environment alone, and no graph")
        return run_dir
    others = f"those that run:{_list(known)}" if known else "none runs"
    raise ConfigError(f"{run} is not the run directory of a graph that runs; {others}")


@contextmanager
def while_running(run_dir: Path) -> Iterator[None]:
    """Turn what fails because the graph has ended meanwhile into one clear error.

    Raises:
        RunError: If the graph has ended.
    """
    try:
        yield
    except (ConfigError, OSError) as error:
        if _runs(run_dir):
            raise
        raise RunError(f"the graph in {run_dir} has ended meanwhile") from error


def _list(run_dirs: Iterable[Path]) -> str:
    """Return a line for each run directory, with what one may know the graph by."""
    return "".join(f"\n  {run_dir}  {_told(run_dir)}" for run_dir in run_dirs)


def _told(run_dir: Path) -> str:
    file, pid = _document(run_dir, "file") or "?", _document(run_dir, "launcher")
    alone = "" if _document(run_dir, "is_graph") else ", an environment alone"
    return f"({file}, process {pid}{alone})"


def _document(run_dir: Path, name: str) -> object:
    try:
        return getattr(RunDocument.read(run_dir), name)
    except ConfigError:
        return None  # it ended just now


def _is_own(run_dir: Path) -> bool:
    # Others can make such a directory, too, and would then be asked in place of the graph.
    try:
        return run_dir.is_dir() and run_dir.stat().st_uid == os.getuid()
    except OSError:
        return False


def _is_launched(run_dir: Path) -> bool:
    return has_control(run_dir, LAUNCHER)


def _runs(run_dir: Path) -> bool:
    # Without a document: a run that just begins or ends. Without an owner: what a crash has left.
    return _is_own(run_dir) and _document(run_dir, "launcher") is not None and is_held(run_dir)
