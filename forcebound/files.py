"""Checks of files before the work begins, and reasons of their errors."""

import os
from pathlib import Path

from forcebound.errors import ConfigError


def check_writable(path: Path, what: str) -> None:
    """Raise before the work begins if a file cannot be written.

    Args:
        path: File to write; it need not exist.
        what: Name of the file for the message, such as "the recording".

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
    """Return why a file could not be used, without its path, for messages that name it already."""
    words = error.strerror if isinstance(error, OSError) else None
    return words or str(error)
