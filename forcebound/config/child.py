"""Runs code that a user wrote where it can do no harm: in a process of its own, with a time limit.

Such code may take for ever, end its process (``sys.exit``, ``os._exit``) or crash it. Whoever waits
for it learns which, and on which line of the user's file.

The child tells on a pipe what it begins to do (:data:`Tell`) and, in the end, its result, each a
line of JSON. It may load for :data:`LOADING` and do each thing more for :data:`LIMIT`; then it gets
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
from collections.abc import Callable, Iterator
from importlib import import_module
from itertools import chain, repeat
from pathlib import Path
from typing import IO, Any, TypeAlias

from forcebound.errors import ConfigError, ForceboundError
from forcebound.realtime import die_with_parent

_logger = logging.getLogger(__name__)

START = 60.0  # s, until it begins: Python and this package, from a slow disk
LOADING = 60.0  # s, to load a file and give a first answer: imports, a mesh, compilation
LIMIT = 10.0  # s, for each answer more
REMARK = 5.0  # s, after which whoever waits is told for what

#: Called with what begins now (of which a message says that it "took more than 10 s"), how many
#: answers have been given, and how many are wanted in all.
Tell: TypeAlias = Callable[[str, int, int], None]

_POLL = 0.1  # s; the pipe may outlive the child, in a process that it has started


def nobody_listens(doing: str, done: int, total: int) -> None:
    """Tell nobody."""


def in_a_child(
    task: Callable[..., Any],
    arguments: list[Any],
    file: Path,
    tell: Tell = nobody_listens,
    limit: float = LIMIT,
    loading: float = LOADING,
) -> Any:
    """Return what ``task(tell, *arguments)`` returns in a new process.

    Args:
        task: A function of a module; what it takes and returns are plain JSON types.
        arguments: What it takes.
        file: With the user's code; messages name it and the line that it was on.
        tell: Called here when the task calls its own.
        limit: How long it may be silent after the second thing that it has begun, in s.
        loading: How long the first one may take, in s.

    Raises:
        ConfigError: If the task raised one of our errors, was silent too long or ended its process.
    """
    module = f"{task.__module__}:{task.__name__}"
    with tempfile.TemporaryFile("w+") as crash:
        words = [module, json.dumps(arguments), str(crash.fileno())]
        child = subprocess.Popen(
            [sys.executable, "-m", "forcebound.config.child", *words],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            pass_fds=(crash.fileno(),),
            start_new_session=True,  # to be ended with all that it starts; Ctrl-C is for us alone
        )
        patience = _Patience(file)
        limits = chain([loading], repeat(limit))
        try:
            for line in _lines(child, patience):
                kind, *content = json.loads(line)
                if kind == "result":
                    return content[0]
                if kind == "error":
                    raise ConfigError(content[0])
                patience.begin(content[0], next(limits))
                tell(*content)
            status = child.wait(limit)
        except subprocess.TimeoutExpired:
            child.send_signal(signal.SIGABRT)
            with contextlib.suppress(subprocess.TimeoutExpired):
                child.wait(1.0)
            raise ConfigError(_too_slow(file, patience, _where(crash, file))) from None
        finally:
            with contextlib.suppress(ProcessLookupError):  # nothing of it is left
                os.killpg(child.pid, signal.SIGKILL)
            child.wait()
            assert child.stdout is not None
            child.stdout.close()
        raise ConfigError(_ended(file, patience.doing, _where(crash, file), status))


class _Patience:
    """How long the child may be silent, and with what it is busy."""

    def __init__(self, file: Path) -> None:
        self._file = file
        self.begin("beginning", START)

    def begin(self, doing: str, limit: float) -> None:
        """Wait for something else."""
        self.doing = doing
        self.limit = limit
        self._since = time.monotonic()
        self._is_silent = True

    def check(self) -> None:
        """Say once what it waits for; raise TimeoutExpired when it has waited too long."""
        waited = time.monotonic() - self._since
        if waited > self.limit:
            raise subprocess.TimeoutExpired(self.doing, self.limit)
        if waited > REMARK and self._is_silent:
            self._is_silent = False
            name, doing, limit = self._file.name, self.doing, self.limit
            _logger.warning("%s: %s takes long; given up after %g s", name, doing, limit)


def _lines(child: subprocess.Popen[bytes], patience: _Patience) -> Iterator[bytes]:
    """What it says, until it ends; TimeoutExpired if it is silent for too long."""
    assert child.stdout is not None
    pipe = child.stdout.fileno()
    unread = b""
    while True:
        is_over = child.poll() is not None  # before the look: what it said last is there, then
        if select.select([pipe], [], [], 0.0 if is_over else _POLL)[0]:
            some = os.read(pipe, 65536)
            if not some:
                return
            *lines, unread = (unread + some).split(b"\n")
            yield from lines
        elif is_over:
            return
        else:
            patience.check()


def _too_slow(file: Path, patience: _Patience, where: str) -> str:
    return (
        f"{file.name}: {patience.doing} took more than {patience.limit:g} s: expected an answer by"
        f" then, and while a graph runs within the device's age_limit{where}\n"
        "  Does a loop never end? What takes long (a mesh, a compilation) can be done once, before"
        " the graph starts, and kept in a file that is read here."
    )


def _ended(file: Path, doing: str, where: str, status: int) -> str:
    how = f"exit status {status}"
    if status < 0:
        how = f"signal {-status}, {signal.strsignal(-status)}"
    return (
        f"{file.name}: {doing} ended the process ({how}): expected an answer{where}\n"
        "  An environment must not exit; to refuse a parameter, raise ValueError in __post_init__."
    )


def _where(crash: IO[str], file: Path) -> str:
    """The innermost line of the user's file that faulthandler wrote down, if any."""
    crash.seek(0)
    found = re.search(rf'File "{re.escape(str(file))}", line (\d+)', crash.read())
    if found is None:
        return ""
    number = int(found[1])
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

    def say(*content: Any) -> None:
        os.write(pipe, json.dumps(content).encode() + b"\n")

    name, _, function = module.partition(":")
    task = getattr(import_module(name), function)
    say("step", "loading it and asking for a first force", 0, 0)
    try:
        result = task(lambda *step: say("step", *step), *json.loads(arguments))
    except ForceboundError as error:
        say("error", str(error))
    else:
        say("result", result)


if __name__ == "__main__":
    _serve(*sys.argv[1:])
