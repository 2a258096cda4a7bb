"""The user's folders: for what lives no longer than a session, and for what can be made again.

Run directories and the keys of loopback are in the private one. It is the first of these that
belongs to the user and that nobody else may enter::

    $XDG_RUNTIME_DIR           as the XDG standard says
    /run/user/UID              the same, where the variable is not passed on
    TMPDIR/forcebound-run-UID  made where there is neither; TMPDIR: the temporary folder
"""

import os
import stat
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import suppress
from pathlib import Path

from forcebound.errors import ConfigError

SESSIONS = Path("/run/user")  # of systemd's, one for each user who is logged in


def runtime_folders(variables: Mapping[str, str] = os.environ) -> list[Path]:
    """Return the private folders of this user that there are, the preferred one first."""
    return [folder for folder in _places(variables) if is_own(folder, private=True)]


def runtime_folder(variables: Mapping[str, str] = os.environ) -> Path | None:
    """Return the private folder of this user, made if need be; None if it cannot be."""
    with suppress(OSError):  # it is there, or cannot be made
        if not runtime_folders(variables):
            _fallback().mkdir(mode=0o700)
    return next(iter(runtime_folders(variables)), None)


def home_folder() -> Path:
    """Return the user's home folder; ConfigError if there is none."""
    home = os.path.expanduser("~")
    if not os.path.isabs(home):
        raise ConfigError("this user has no home folder", action="set the variable HOME to one")
    return Path(home)


def cache_folder(name: str) -> Path | None:
    """Return a writable folder for what can be made again; None without one.

    It is within the user's cache or, without a home, the private folder: others may put nothing
    there.
    """
    bases = []
    with suppress(ConfigError):
        bases.append(home_folder() / ".cache")
    private = runtime_folder()
    for base in [*bases, *([private] if private else [])]:
        folder = base / "forcebound" / name
        try:
            folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        except OSError:
            continue
        if os.access(folder, os.W_OK) and folder.stat().st_uid == os.getuid():
            return folder
    return None


def is_own(folder: Path, private: bool = False) -> bool:
    """Return whether this is a folder of this user, and no link; ``private``: for nobody else.

    In a folder that is open to all, others may make a name that looks like ours. Nothing is
    resolved, so no link of theirs is followed.
    """
    try:
        status = folder.lstat()
    except (OSError, ValueError):
        return False
    is_ours = stat.S_ISDIR(status.st_mode) and status.st_uid == os.getuid()
    return is_ours and not (private and status.st_mode & 0o077)


def _places(variables: Mapping[str, str]) -> Iterator[Path]:
    named = Path(variables.get("XDG_RUNTIME_DIR", ""))
    if named.is_absolute():
        yield named
    yield SESSIONS / str(os.getuid())
    with suppress(OSError):  # no folder for temporary files can be used
        yield _fallback()


def _fallback() -> Path:
    return Path(tempfile.gettempdir()) / f"forcebound-run-{os.getuid()}"
