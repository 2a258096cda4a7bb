"""Which graphs run on this machine? They are found by their run directories, and by nothing else.

A run directory is named ``forcebound-...``, lies in the folder for temporary files, belongs to the
user and holds the document of a launcher that lives (:class:`forcebound.launch.live.RunDocument`).
"""

import json
import os
import tempfile
from collections.abc import Iterable
from pathlib import Path

from forcebound.errors import ConfigError
from forcebound.launch.live import RUN_FILE
from forcebound.launch.supervisor import LAUNCHER


def running(folders: Iterable[Path] | None = None) -> list[Path]:
    """Return the run directories of this user's graphs that run, by name.

    Args:
        folders: Where to look; by default where the launcher makes run directories.
    """
    if folders is None:
        folders = {Path(tempfile.gettempdir()), Path("/tmp")}  # the second where paths are too long
    found = {run_dir.resolve() for folder in folders for run_dir in folder.glob("forcebound-*")}
    return sorted(run_dir for run_dir in found if _is_own(run_dir) and _runs(run_dir))


def find(run: Path | None = None, folders: Iterable[Path] | None = None) -> Path:
    """Return the run directory of the graph that is meant.

    Args:
        run: Its run directory, as :func:`running` gives it; None: the only graph that runs. A node
            that was started by hand counts only where no launcher runs a graph.
        folders: As in :func:`running`.

    Raises:
        ConfigError: If no graph runs, several run and ``run`` does not say which, or ``run`` is no
            directory of one that runs.
    """
    known = running(folders)
    if run is None:
        known = list(filter(_is_launched, known)) or known
        if len(known) == 1:
            return known[0]
        if known:
            raise ConfigError(f"several graphs run; say which run directory: {_names(known)}")
        raise ConfigError("no graph of yours runs on this machine; start one: forcebound launch")
    run_dir = run.resolve()
    if (run_dir / RUN_FILE).is_file() and _is_own(run_dir) and _runs(run_dir):
        return run_dir  # also one that lies elsewhere
    others = f"those that run: {_names(known)}" if known else "none runs"
    raise ConfigError(f"{run} is not the run directory of a graph that runs; {others}")


def _names(run_dirs: Iterable[Path]) -> str:
    return ", ".join(str(run_dir) for run_dir in run_dirs)


def _is_own(run_dir: Path) -> bool:
    # Others can make such a directory, too, and would then be asked in place of the graph.
    try:
        return run_dir.is_dir() and run_dir.stat().st_uid == os.getuid()
    except OSError:
        return False


def _is_launched(run_dir: Path) -> bool:
    return (run_dir / f"control-{LAUNCHER}").exists()


def _runs(run_dir: Path) -> bool:
    try:
        launcher = json.loads((run_dir / RUN_FILE).read_text(encoding="utf-8"))["launcher"]
        os.kill(launcher, 0)
    except (OSError, ValueError, KeyError, TypeError):
        return False  # no run, one that just begins or ends, or what a crash of all left
    return True
