"""Files from outside: read in bounded time and memory, and checked before they are written.

What is opened must be a regular file, which the open file itself is asked: a pipe or a device may
have no end, and its name may change hands between a look and the opening. Text and tables say the
line of what is wrong. :func:`printable` is how a name that came from outside is shown.
"""

import csv
import errno
import io
import os
import stat
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from forcebound.errors import ConfigError, ForceboundError

MAX_TABLE = 100_000_000  # bytes of a CSV file; an hour of delays at 1 kHz
RECORDING_SUFFIX = ".mcap"  # here, since no start needs the libraries of forcebound.mcap_file


def open_file(path: Path) -> BinaryIO:
    """Open a regular file for reading; never waits.

    Raises:
        OSError: If there is none, it may not be read, or it is no regular file.
    """
    # A pipe without a writer would be waited for.
    descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK | os.O_NOCTTY)
    mode = os.fstat(descriptor).st_mode
    if not stat.S_ISREG(mode):
        os.close(descriptor)
        kind = "a folder" if stat.S_ISDIR(mode) else "a pipe or a device"
        raise OSError(errno.EINVAL, f"it is {kind}, not a file")
    return open(descriptor, "rb")


def recording_file(path: Path) -> Path:
    """Return the path of a recording to write; ConfigError if its name says that it is none."""
    if path.suffix not in ("", RECORDING_SUFFIX):
        raise ConfigError(
            f"a recording's name must end in {RECORDING_SUFFIX}, or have no ending, got {path}"
        )
    return path


def version_of(path: Path) -> tuple[int, int]:
    """Return time of change and size of a file; of one that does not exist, zeros.

    For caches of what a file holds: reading it says what is wrong.
    """
    try:
        status = path.stat()
    except OSError:
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

    ``what`` is its name for messages, such as "the trace". ConfigError if it cannot be read, has
    more than ``limit`` bytes, or is no text; then it names the line.
    """
    try:
        data = read_bytes(path, limit)
    except OSError as error:
        raise ConfigError(f"cannot read {what} {path}: {reason(error)}") from error
    return text_of(path, data)


def text_of(path: Path, data: bytes) -> str:
    """Return the text of the file's content; ConfigError with the line if it is not UTF-8."""
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        *before, last = data[: error.start].decode("utf-8-sig").split("\n")
        raise ConfigError(
            f"{path}:{len(before) + 1}:{len(last) + 1}: byte 0x{data[error.start]:02x} is not"
            " UTF-8: save the file as UTF-8"
        ) from None


def read_rows(path: Path, what: str, separators: str = ",") -> Iterator[tuple[str, list[str]]]:
    """Yield the rows of a CSV file that are not empty, each with its place, ``file.csv:3``.

    The first of the ``separators`` that its first line has, or the last, separates its cells.

    Raises:
        ConfigError: As :func:`read_text`; or if a line is no row.
    """
    text = read_text(path, what, MAX_TABLE)
    head = text.partition("\n")[0]
    separator = next((one for one in separators if one in head), separators[-1])
    rows = csv.reader(io.StringIO(text, newline=""), strict=True, delimiter=separator)
    try:
        for row in rows:
            if row:
                yield f"{path}:{rows.line_num}", row
    except csv.Error as error:
        raise ConfigError(f"{path}:{rows.line_num}: {error}") from None


@contextmanager
def content_of(name: object) -> Iterator[None]:
    """Turn whatever is raised within into one ConfigError: a file's content may be anything.

    The errors of forcebound pass as they are.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of numpy, about numbers that are no measurements
            yield
    except ForceboundError:
        raise
    except Exception as error:
        raise ConfigError(
            f"cannot make sense of {name} ({type(error).__name__}: {error}): the file is damaged"
            " or of another version, or this is a bug in forcebound"
        ) from error


def check_writable(path: Path, what: str) -> None:
    """Try before the work begins whether a file can be written; leaves it as it is.

    ConfigError if not; ``what`` is its name in the message, such as "the recording".
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
        raise ConfigError(f"cannot write {what} {path}: {why}") from error


def reason(error: Exception) -> str:
    """Return why a file could not be used, without its path, for messages that name it already."""
    words = error.strerror if isinstance(error, OSError) else None
    return words or str(error)


def printable(text: str, longest: int | None = None) -> str:
    r"""Return a text from outside for a terminal, a log or a figure, cut if it is too long.

    Line ends and tabs stay; other characters without a picture, which could steer a terminal or
    hide what is said, are written as Python writes them: ``\x1b``.
    """
    if longest is not None and len(text) > longest:
        text = text[: longest - 3] + "..."
    if text.isprintable():
        return text
    return "".join(
        one if one.isprintable() or one in "\n\t" else one.encode("unicode_escape").decode()
        for one in text
    )
