"""A function in a child process, with limits of time and memory: it may hang, exit or crash.

For code of a user, and for libraries that read the files of others.
"""

import contextlib
import faulthandler
import os
import pickle
import re
import resource
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

from forcebound.errors import ConfigError, ForceboundError
from forcebound.realtime import die_with_parent

START_S = 60.0  # until the child begins: Python and this package, from a slow disk
_RESULT, _ERROR = b"=", b"!"  # first byte of an answer


class ChildError(ForceboundError):
    """A child ended with ``status``, or was too slow (None); ``trace``: where, by faulthandler."""

    def __init__(self, status: int | None, trace: str) -> None:
        super().__init__("it took too long" if status is None else f"it ended with status {status}")
        self.status, self.trace = status, trace


def in_bounded_child(function: Callable[[], bytes], seconds: float, size: int = 0) -> bytes:
    """Return what ``function``, of a module or a ``partial``, returns in a new process.

    It may take so many ``seconds``, and ``size`` bytes of memory (0: no limit).

    Raises:
        ConfigError: If it raises one of our errors.
        ChildError: If it takes too long or ends its process.
    """
    with tempfile.TemporaryFile() as call, tempfile.TemporaryFile() as back:
        pickle.dump(function, call)
        call.seek(0)
        words = f"import {__name__} as child; child.serve({back.fileno()}, {seconds}, {size})"
        child = subprocess.Popen(
            [sys.executable, "-P", "-c", words],  # as elsewhere, no module of the current folder
            stdin=call,
            stdout=2,  # what it prints must not get into a document
            pass_fds=[back.fileno()],
            start_new_session=True,  # to be ended with all that it starts; Ctrl-C is for us
        )
        try:
            status = child.wait(START_S + seconds)
        except subprocess.TimeoutExpired:
            status = None
        finally:
            with contextlib.suppress(ProcessLookupError):  # nothing of it is left
                os.killpg(child.pid, signal.SIGKILL)
            child.wait()
        back.seek(0)
        answer, rest = back.read(1), back.read()
    if answer == _RESULT:
        return rest
    if answer == _ERROR:
        raise ConfigError(rest.decode())
    trace = (answer + rest).decode("utf-8", "replace")
    raise ChildError(None if trace.startswith("Timeout") else status, trace)


def tried(function: Callable[[], bytes], files: Sequence[Path], seconds: float) -> bytes:
    """Return what a function of a module, or a ``partial``, returns in a child process.

    ConfigError if it raises one of our errors, takes longer than so many ``seconds`` or ends its
    process; it names the ``files`` of the user's code, and the line that it was on.
    """
    try:
        return in_bounded_child(function, seconds)
    except ChildError as error:
        names, where = ", ".join(file.name for file in files), _where(error.trace, files)
        if error.status is None:
            raise ConfigError(
                f"{names}: loading and trying it took more than {seconds:g} s{where}\n"
                "  Does a loop never end, or is the machine busy (try again)? What takes long (a"
                " mesh, a compilation) can be done once, before the graph starts, and kept in"
                " a file that is read here."
            ) from None
        how = f"exit status {error.status}"
        if error.status < 0:
            how = f"signal {-error.status}, {signal.strsignal(-error.status)}"
        raise ConfigError(
            f"{names}: it ended its process ({how}){where}\n"
            "  A part must not exit; to refuse a parameter, raise ValueError in __post_init__."
        ) from None


def _where(trace: str, files: Sequence[Path]) -> str:
    """The innermost line of the user's files in what faulthandler wrote, if there is one."""
    names = "|".join(re.escape(str(file)) for file in files)
    found = re.search(rf'File "({names})", line (\d+)', trace)
    if found is None:
        return ""
    file, number = Path(found[1]), int(found[2])
    lines = file.read_text("utf-8", "replace").splitlines()
    text = lines[number - 1].strip() if number <= len(lines) else ""
    return f"\n  in {file}:{number}: {text}"


def serve(back: int, seconds: float, size: int) -> None:
    """Call the function of standard input, in the child; ``back`` gets its answer or a trace."""
    die_with_parent(signal.SIGKILL)
    os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))  # our parent may be a node
    os.sched_setaffinity(0, range(os.cpu_count() or 1))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    if size:
        resource.setrlimit(resource.RLIMIT_DATA, (size, size))
    faulthandler.enable(back, all_threads=False)
    faulthandler.dump_traceback_later(seconds, exit=True, file=back)
    try:
        answer = _RESULT + pickle.load(sys.stdin.buffer)()
    except ForceboundError as error:
        answer = _ERROR + str(error).encode("utf-8", "replace")
    os.write(back, answer)
