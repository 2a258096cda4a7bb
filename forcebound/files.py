"""Files from outside: read in bounded time and memory, and checked before they are written.

What is opened must be a regular file, which the open file itself is asked: a pipe or a device may
have no end, and its name may change hands between a look and the opening. Text and tables say the
line of what is wrong. :func:`printable` is how a name that came from outside is shown.
"""

import csv
import errno
import os
import re
import stat
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from forcebound.errors import ConfigError, ForceboundError

MAX_TABLE = 100_000_000  # bytes of a CSV file; an hour of delays at 1 kHz
MAX_LINE = 10_000  # characters of a row
RECORDING_SUFFIX = ".mcap"  # here, since no start needs the libraries of forcebound.mcap_file
_LINE = re.compile(r"[^\r\n]*(?:\r\n|\r|\n)|[^\r\n]+")

_KINDS: dict[str, Callable[[int], bool]] = {
    "a folder": stat.S_ISDIR,
    "a pipe": stat.S_ISFIFO,
    "a socket": stat.S_ISSOCK,
    "a device": stat.S_ISCHR,
    "a disk": stat.S_ISBLK,
}


def open_file(path: Path) -> BinaryIO:
    """Open a regular file for reading; never waits.

    Raises:
        OSError: If there is none, it may not be read, or it is no regular file.
    """
    try:
        # A pipe without a writer would be waited for.
        descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK | os.O_NOCTTY)
    except ValueError:  # a zero byte, or half a surrogate pair
        raise OSError(errno.EINVAL, "no file can have this name") from None
    except OSError as error:
        if error.errno == errno.ENXIO:  # what opening a socket says
            raise OSError(errno.ENXIO, "it is a socket, not a file") from None
        raise
    try:
        mode = os.fstat(descriptor).st_mode
        if not stat.S_ISREG(mode):
            kind = next(name for name, is_kind in _KINDS.items() if is_kind(mode))
            raise OSError(errno.EINVAL, f"it is {kind}, not a file")
        return open(descriptor, "rb")
    except BaseException:
        os.close(descriptor)
        raise


def version_of(path: Path) -> tuple[int, int]:
    """Return what tells this content of a file from another one; of a file that is not there, 0s.

    For caches of what a file holds: reading it says what is wrong.
    """
    try:
        status = path.stat()
    except (OSError, ValueError):  # ValueError: a name that no file can have
        return 0, 0
    return status.st_mtime_ns, status.st_size


def read_bytes(path: Path, limit: int) -> bytes:
    """Return the content of a regular file of at most ``limit`` bytes.

    Raises:
        OSError: As :func:`open_file`; or if the file is longer.
    """
    with open_file(path) as file:
        data = file.read(limit + 1) or b""  # None: a file of the kernel that has nothing to say
    if len(data) > limit:
        raise OSError(errno.EFBIG, f"it has more than {limit} bytes")
    return data


def read_text(path: Path, what: str, limit: int) -> str:
    """Return the text of a file in UTF-8, with or without a byte order mark.

    Args:
        path: The file.
        what: Name of the file for messages, such as "the trace".
        limit: Largest size, in bytes.

    Raises:
        ConfigError: If it cannot be read, is longer, or is no text; then it names the line.
    """
    try:
        data = read_bytes(path, limit)
    except OSError as error:
        raise ConfigError(f"cannot read {what} {path}: {reason(error)}") from error
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line, column, _ = place_in(data, error.start)
        raise ConfigError(f"{path}:{line}:{column}: {not_text(data, error.start)}") from None


def not_text(data: bytes, at: int) -> str:
    """Return the message for a byte that is no text."""
    return f"byte 0x{data[at]:02x} is not UTF-8: save the file as UTF-8"


def place_in(data: bytes, at: int) -> tuple[int, int, str]:
    """Return line and column of a byte, both from 1, and the text of that line."""
    *before, last = data[:at].decode("utf-8-sig", "replace").split("\n")
    after = data[at:].decode("utf-8", "replace").partition("\n")[0]
    return len(before) + 1, len(last) + 1, last + after


def read_rows(path: Path, what: str) -> Iterator[tuple[str, list[str]]]:
    """Yield the rows of a CSV file that are not empty, each with its place, ``file.csv:3``.

    A row is a line: no cell of a table of numbers holds a line end.

    Raises:
        ConfigError: As :func:`read_text`; or if a line is longer than any row.
    """
    text = read_text(path, what, MAX_TABLE)
    for number, line in enumerate(_LINE.finditer(text), start=1):
        if len(line[0]) > MAX_LINE:
            raise ConfigError(f"{path}:{number}: more than {MAX_LINE} characters: no row has them")
        try:
            row = next(csv.reader((line[0],), strict=True))
        except csv.Error as error:
            raise ConfigError(f"{path}:{number}: {error}") from None
        if row:
            yield f"{path}:{number}", row


@contextmanager
def content_of(name: object) -> Iterator[None]:
    """Turn whatever is raised within into one sentence: the content of a file may be anything.

    What reads a file checks its form; the code that then works with its values would have to doubt
    every one of them.

    Args:
        name: Of the file, for the message.

    Raises:
        ConfigError: For any exception but those of forcebound, which have their own words.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of numpy, about numbers that are no measurements
            yield
    except ForceboundError:
        raise
    except Exception as error:
        raise ConfigError(
            f"cannot make sense of {name} ({type(error).__name__}: {error}): it is damaged or of"
            " another version, or this is a mistake of forcebound"
        ) from error


def check_writable(path: Path, what: str) -> None:
    """Try before the work begins whether a file can be written; leaves it as it is.

    Args:
        path: File to write; it need not exist.
        what: Name of the file for the message, such as "the recording".

    Raises:
        ConfigError: If it cannot be written; says why.
    """
    if path.is_dir():
        raise ConfigError(f"cannot write {what} {path}: it is a folder")
    is_new = not os.path.lexists(path)
    try:
        os.close(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_CLOEXEC | os.O_NONBLOCK, 0o666))
        if is_new:
            path.unlink()
    except OSError as error:
        folder = path.absolute().parent
        why = error.strerror if folder.is_dir() else f"there is no folder {folder}"
        if error.errno == errno.ENXIO:  # which is said of a pipe, too
            why = "nobody reads at its other end"
        raise ConfigError(f"cannot write {what} {path}: {why}") from error


def reason(error: Exception) -> str:
    """Return why a file could not be used, without its path, for messages that name it already."""
    words = error.strerror if isinstance(error, OSError) else None
    return words or str(error)


def printable(text: str, longest: int | None = None) -> str:
    r"""Return a text from outside for a terminal, a log or a figure.

    Line ends and tabs stay; other characters without a picture, which could steer a terminal or
    hide what is said, are written as Python writes them: ``\x1b``.

    Args:
        text: Any text.
        longest: Most characters to return; the rest becomes "...". None: all.
    """
    if longest is not None and len(text) > longest:
        text = text[: longest - 3] + "..."
    if text.isprintable():
        return text
    return "".join(
        one if one.isprintable() or one in "\n\t" else one.encode("unicode_escape").decode()
        for one in text
    )
