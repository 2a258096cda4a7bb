"""Sandbox: a process with a time limit for code of a user.

Such code may take for ever, end its process (``sys.exit``, ``os._exit``) or crash it. The error
then names it, with the line of the user's file.

The child writes its steps (:data:`Progress`) and, in the end, its result to a pipe, each a line of
JSON. It may load for :data:`LOADING` and do each thing more for :data:`LIMIT`; then it gets
SIGABRT, at which Python's faulthandler writes down where it was, and is killed with all that it has
started.
"""

import contextlib
import faulthandler
import json
import logging
import os
import re
import resource
import select
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from importlib import import_module
from itertools import chain, repeat
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
    module = f"{task.__module__}:{task.__name__}"
    with tempfile.TemporaryFile("w+") as crash:
        words = [module, json.dumps(arguments), str(crash.fileno())]
        child = subprocess.Popen(
            [sys.executable, "-m", "forcebound.config.sandbox", *words],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            pass_fds=(crash.fileno(),),
            start_new_session=True,  # to be ended with all that it starts; Ctrl-C is for us alone
        )
        timeout = _Timeout(", ".join(file.name for file in files))
        limits = chain([loading], repeat(limit))
        try:
            for line in _lines(child, timeout):
                kind, *content = json.loads(line)
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
            assert child.stdout is not None
            child.stdout.close()
        raise ConfigError(_ended(timeout, _where(crash, files), status))


class _Timeout:
    """How long the child may be silent, and with what it is busy."""

    def __init__(self, names: str) -> None:
        self.names = names  # of the user's files
        self.begin("beginning", START)

    def begin(self, doing: str, limit: float) -> None:
        """Wait for something else."""
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
            message = "%s: %s takes long; given up after %g s"
            _logger.warning(message, self.names, self.doing, self.limit)


def _lines(child: subprocess.Popen[bytes], timeout: _Timeout) -> Iterator[bytes]:
    """What the child writes, until it ends; TimeoutExpired if it is silent for too long."""
    assert child.stdout is not None
    pipe = child.stdout.fileno()
    unread = b""
    while True:
        is_over = child.poll() is not None  # before the look: what it wrote last is there, then
        if select.select([pipe], [], [], 0.0 if is_over else _POLL)[0]:
            some = os.read(pipe, 65536)
            if not some:
                return
            *lines, unread = (unread + some).split(b"\n")
            yield from lines
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


def _serve(module: str, arguments: str, crash: str) -> None:
    """Be the child."""
    die_with_parent(signal.SIGKILL)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    faulthandler.enable(int(crash), all_threads=False)
    pipe = os.dup(1)
    os.dup2(2, 1)  # what the user's code prints must not get between our lines

    def write(*content: Any) -> None:
        os.write(pipe, json.dumps(content).encode() + b"\n")

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
