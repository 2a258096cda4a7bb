"""Sandbox: a process with a time limit for code of a user.

Such code may take for ever, end its process (``sys.exit``, ``os._exit``) or crash it. The error
then names it, with the line of the user's file.

The child reports its steps (:data:`Progress`). It may load for :data:`LOADING` and do each thing
more for :data:`LIMIT`.
"""

import json
import logging
import math
import re
import signal
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from importlib import import_module
from itertools import chain, repeat
from pathlib import Path
from typing import Any, TypeAlias

from forcebound.bounded_child import ChildError, Timeout, in_bounded_child, report
from forcebound.errors import ConfigError

_logger = logging.getLogger(__name__)

START = 60.0  # s, until it begins: Python and this package, from a slow disk
LOADING = 60.0  # s, to load the files and give a first answer: imports, a mesh, compilation
LIMIT = 10.0  # s, for each answer more
REMARK = 5.0  # s, after which the log names what is waited for

#: Called with what begins now (of which a message says that it "took more than 10 s"), how many
#: answers have been given, and how many are wanted in all.
Progress: TypeAlias = Callable[[str, int, int], None]


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
    names = ", ".join(file.name for file in files)
    timeout = _Timeout(names, chain([loading], repeat(limit)), progress)
    name = f"{task.__module__}:{task.__name__}"
    try:
        return json.loads(in_bounded_child(partial(_do, name, json.dumps(arguments)), timeout))
    except ChildError as error:
        where, status = _where(error.trace, files), error.status
        words = _too_slow(timeout, where) if status is None else _ended(timeout, where, status)
        raise ConfigError(words) from None


class _Timeout(Timeout):
    """How long the child may be silent, and with what it is busy."""

    def __init__(self, names: str, limits: Iterator[float], progress: Progress) -> None:
        self.names = names  # of the user's files
        self.doing = "beginning"
        self._limits, self._progress = limits, progress
        super().__init__(START)

    def begin(self, limit: float) -> None:
        super().begin(limit)
        self._remark = Timeout(REMARK)

    def hear(self, report: bytes) -> None:
        self.doing, done, total = json.loads(report)
        self.begin(next(self._limits))
        self._progress(self.doing, done, total)

    def check(self) -> None:
        super().check()
        try:
            self._remark.check()
        except TimeoutError:
            message = "%s: %s takes long; it may take %g s"
            _logger.warning(message, self.names, self.doing, self.limit)
            self._remark = Timeout(math.inf)


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


def _where(trace: str, files: Sequence[Path]) -> str:
    """The innermost line of the user's files that faulthandler wrote down, if any."""
    names = "|".join(re.escape(str(file)) for file in files)
    found = re.search(rf'File "({names})", line (\d+)', trace)
    if found is None:
        return ""
    file, number = Path(found[1]), int(found[2])
    lines = file.read_text("utf-8", "replace").splitlines()
    text = lines[number - 1].strip() if number <= len(lines) else ""
    return f"\n  in {file}:{number}: {text}"


def _do(name: str, arguments: str) -> bytes:
    """Do a task in the child; its module may import what never ends."""
    _report("loading it and calling it once", 0, 0)
    module, _, function = name.partition(":")
    task = getattr(import_module(module), function)
    return json.dumps(task(_report, *json.loads(arguments))).encode()


def _report(*step: Any) -> None:
    report(json.dumps(step).encode())
