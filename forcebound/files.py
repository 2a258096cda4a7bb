"""Whether a file can be written, asked before the work begins; and why one could not be used."""

import os
from pathlib import Path

from forcebound.errors import ConfigError


def check_writable(path: Path, what: str) -> None:
    """Say now, and not after the work, that a file cannot be written.

    Args:
        path: Where to; it need not exist.
        what: For the message, such as "the recording".

    Raises:
        ConfigError: If the folder is missing, the file is a folder, or it may not be written.
    """
    folder = path.absolute().parent
    if not folder.is_dir():
        raise ConfigError(f"cannot write {what} {path}: there is no folder {folder}")
    if path.is_dir():
        raise ConfigError(f"cannot write {what} {path}: it is a folder")
    if not os.access(path if path.exists() else folder, os.W_OK):
        raise ConfigError(f"cannot write {what} {path}: no permission")


def reason(error: Exception) -> str:
    """Return why a file could not be used, without its path: the message has named it."""
    words = error.strerror if isinstance(error, OSError) else None
    return words or str(error)
