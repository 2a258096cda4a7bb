"""Sandbox: a process with a time limit for code of a user.

Such code may take for ever, end its process (``sys.exit``, ``os._exit``) or crash it. The error
then names it, with the line of the user's file.

The child sends its steps (:data:`Progress`) and, in the end, its result through a pipe. It may
load for :data:`LOADING` and do each thing more for :data:`LIMIT`; then it gets SIGABRT, at which
faulthandler writes down where it was, and is killed with all that it has started.
"""

import contextlib
import faulthandler
import json
import logging
import os
import re
import resource
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from importlib import import_module
from itertools import chain, repeat
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from pathlib import Path
from typing import IO, Any, TypeAlias

from forcebound.errors import ConfigError, ForceboundError
from forcebound.realtime import die_with_parent

_logger = logging.getLogger(__name__)

START = 60.0  # s, until it begins: Python and this package, from a slow disk
LOADING = 60.0  # s, to load the files and give a first answer: imports, a mesh, compilation
LIMIT = 10.0  # s, for each answer more
REMARK = 5.0  # s, after which the log names what is waited for

#: Called with what begins now (of which a message says that it "took more than 10 s"), how many
#: answers have been given, and how many are wanted in all.
Progress: TypeAlias = Callable[[str, int, int], None]

_POLL = 0.1  # s; the pipe may outlive the child, in a process that it has started


def no_progress(doing: str, done: int, total: int) -> None:
    """Take a report of progress and do nothing with it."""


def run_in_sandbox(
    task: Callable[..., Any],
    arguments: list[Any],
    files: Sequence[Path],
    progress: Progress = no_progress,
    limit: float = LIMIT,
    loading: float = LOADING,
) -> Any:
    """Return what ``task(progress, *arguments)`` returns in a new process.

    Args:
        task: A function of a module; what it takes and returns are plain JSON types.
        arguments: What it takes.
        files: With the user's code; messages name them and the line that it was on.
        progress: Called here when the task calls its own.
        limit: How long it may be silent after the second thing that it has begun, in s.
        loading: How long the first one may take, in s.

    Raises:
        ConfigError: If the task raised one of our errors, was silent too long or ended its process.
    """
    reader, writer = Pipe(duplex=False)
    with tempfile.TemporaryFile("w+") as crash, reader:
        with writer:
            descriptors = (writer.fileno(), crash.fileno())
            words = [f"{task.__module__}:{task.__name__}", json.dumps(arguments)]
            child = subprocess.Popen(
                [sys.executable, "-m", __name__, *words, *map(str, descriptors)],
                stdin=subprocess.DEVNULL,
                stdout=2,  # what the user's code prints must not get into a document
                pass_fds=descriptors,
                start_new_session=True,  # to be ended with all that it starts; Ctrl-C is for us
            )
        timeout = _Timeout(", ".join(file.name for file in files))
        limits = chain([loading], repeat(limit))
        try:
            for kind, *content in _messages(child, reader, timeout):
                if kind == "result":
                    return content[0]
                if kind == "error":
                    raise ConfigError(content[0])
                timeout.begin(content[0], next(limits))
                progress(*content)
            status = child.wait(limit)
        except subprocess.TimeoutExpired:
            child.send_signal(signal.SIGABRT)
            with contextlib.suppress(subprocess.TimeoutExpired):
                child.wait(1.0)
            raise ConfigError(_too_slow(timeout, _where(crash, files))) from None
        finally:
            with contextlib.suppress(ProcessLookupError):  # nothing of it is left
                os.killpg(child.pid, signal.SIGKILL)
            child.wait()
        raise ConfigError(_ended(timeout, _where(crash, files), status))


class _Timeout:
    """How long the child may be silent, and with what it is busy."""

    def __init__(self, names: str) -> None:
        self.names = names  # of the user's files
        self.begin("beginning", START)

    def begin(self, doing: str, limit: float) -> None:
        self.doing = doing
        self.limit = limit
        self._since = time.monotonic()
        self._is_silent = True

    def check(self) -> None:
        """Log once what takes long; raise TimeoutExpired when it takes too long."""
        waited = time.monotonic() - self._since
        if waited > self.limit:
            raise subprocess.TimeoutExpired(self.doing, self.limit)
        if waited > REMARK and self._is_silent:
            self._is_silent = False
            message = "%s: %s takes long; it may take %g s"
            _logger.warning(message, self.names, self.doing, self.limit)


def _messages(
    child: subprocess.Popen[bytes], reader: Connection, timeout: _Timeout
) -> Iterator[list[Any]]:
    """What the child sends, until it ends; TimeoutExpired if it is silent for too long."""
    while True:
        is_over = child.poll() is not None  # before the look: what it wrote last is there, then
        if reader.poll(0.0 if is_over else _POLL):
            try:
                yield json.loads(reader.recv_bytes())
            except (EOFError, OSError):
                return
        elif is_over:
            return
        else:
            timeout.check()


def _too_slow(timeout: _Timeout, where: str) -> str:
    return (
        f"{timeout.names}: {timeout.doing} took more than {timeout.limit:g} s: expected an answer"
        f" by then, and while a graph runs within the device's age_limit{where}\n"
        "  Does a loop never end? What takes long (a mesh, a compilation) can be done once, before"
        " the graph starts, and kept in a file that is read here."
    )


def _ended(timeout: _Timeout, where: str, status: int) -> str:
    how = f"exit status {status}"
    if status < 0:
        how = f"signal {-status}, {signal.strsignal(-status)}"
    return (
        f"{timeout.names}: {timeout.doing} ended the process ({how}): expected an answer{where}\n"
        "  A part must not exit; to refuse a parameter, raise ValueError in __post_init__."
    )


def _where(crash: IO[str], files: Sequence[Path]) -> str:
    """The innermost line of the user's files that faulthandler wrote down, if any."""
    crash.seek(0)
    names = "|".join(re.escape(str(file)) for file in files)
    found = re.search(rf'File "({names})", line (\d+)', crash.read())
    if found is None:
        return ""
    file, number = Path(found[1]), int(found[2])
    lines = file.read_text("utf-8", "replace").splitlines()
    text = lines[number - 1].strip() if number <= len(lines) else ""
    return f"\n  in {file}:{number}: {text}"


def _serve(module: str, arguments: str, pipe: str, crash: str) -> None:
    """Be the child."""
    die_with_parent(signal.SIGKILL)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    faulthandler.enable(int(crash), all_threads=False)
    writer = Connection(int(pipe), readable=False)

    def write(*content: Any) -> None:
        writer.send_bytes(json.dumps(content).encode())

    name, _, function = module.partition(":")
    task = getattr(import_module(name), function)
    write("step", "loading it and calling it once", 0, 0)
    try:
        result = task(lambda *step: write("step", *step), *json.loads(arguments))
    except ForceboundError as error:
        write("error", str(error))
    else:
        write("result", result)


if __name__ == "__main__":
    _serve(*sys.argv[1:])
