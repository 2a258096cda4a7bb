"""A function in a process of its own, with limits of time and memory: it may hang, exit or crash.

For code of a user, and for libraries that read the files of others.
"""

import contextlib
import faulthandler
import os
import pickle
import resource
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from multiprocessing import Pipe
from multiprocessing.connection import Connection

from forcebound.errors import ConfigError, ForceboundError
from forcebound.realtime import die_with_parent

_POLL = 0.1  # s; the pipe may outlive the child, in a process that it has started
_REPORT, _RESULT, _ERROR = b"+", b"=", b"!"  # first byte of a message from the child
_parent: list[Connection] = []  # in a child: the pipe to its parent


class ChildError(ForceboundError):
    """A child ended with ``status``, or was too slow (None); ``trace``: where, by faulthandler."""

    def __init__(self, status: int | None, trace: str) -> None:
        super().__init__("it took too long" if status is None else f"it ended with status {status}")
        self.status, self.trace = status, trace


class Timeout:
    """How long a child may take, in s; a subclass may begin again with a report of the child."""

    def __init__(self, limit: float) -> None:
        self.begin(limit)

    def begin(self, limit: float) -> None:
        """Begin again."""
        self.limit, self._since = limit, time.monotonic()

    def check(self) -> None:
        """Raise TimeoutError if it is over."""
        if time.monotonic() - self._since > self.limit:
            raise TimeoutError

    def hear(self, report: bytes) -> None:
        """Take a report of the child."""


def report(data: bytes) -> None:
    """Send a report from a child to the timeout of its parent."""
    _parent[0].send_bytes(_REPORT + data)


def in_bounded_child(function: Callable[[], bytes], timeout: Timeout, size: int = 0) -> bytes:
    """Return what ``function``, of a module or a ``partial``, returns in a new process.

    Args:
        function: What to call.
        timeout: How long it may take.
        size: How much memory it may take, in bytes; 0: no limit.

    Raises:
        ConfigError: If it raises one of our errors.
        ChildError: If it takes too long or ends its process.
    """
    reader, writer = Pipe(duplex=False)
    with tempfile.TemporaryFile("w+") as crash, reader:
        with writer, tempfile.TemporaryFile() as call:
            pickle.dump(function, call)
            call.seek(0)
            ours = writer.fileno(), crash.fileno()
            words = f"import {__name__} as child; child.serve({ours[0]}, {ours[1]}, {size})"
            child = subprocess.Popen(
                [sys.executable, "-c", words],
                stdin=call,
                stdout=2,  # what it prints must not get into a document
                pass_fds=ours,
                start_new_session=True,  # to be ended with all that it starts; Ctrl-C is for us
            )
        status = None
        try:
            while (message := _next(child, reader, timeout)) is not None:
                kind, data = message[:1], message[1:]
                if kind == _RESULT:
                    return data
                if kind == _ERROR:
                    raise ConfigError(data.decode())
                timeout.hear(data)
            status = child.wait(timeout.limit)
        except (TimeoutError, subprocess.TimeoutExpired):
            child.send_signal(signal.SIGABRT)  # faulthandler writes down where it is
            with contextlib.suppress(subprocess.TimeoutExpired):
                child.wait(1.0)
        finally:
            with contextlib.suppress(ProcessLookupError):  # nothing of it is left
                os.killpg(child.pid, signal.SIGKILL)
            child.wait()
        crash.seek(0)
        raise ChildError(status, crash.read())


def _next(child: subprocess.Popen[bytes], reader: Connection, timeout: Timeout) -> bytes | None:
    """What the child sends next; None: it has ended."""
    while True:
        is_over = child.poll() is not None  # before the look: what it wrote last is there, then
        if reader.poll(0.0 if is_over else _POLL):
            try:
                return reader.recv_bytes()
            except (EOFError, OSError):
                return None
        if is_over:
            return None
        timeout.check()


def serve(pipe: int, crash: int, size: int) -> None:
    """Be the child."""
    die_with_parent(signal.SIGKILL)
    os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))  # our parent may be a node
    os.sched_setaffinity(0, range(os.cpu_count() or 1))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    if size:
        resource.setrlimit(resource.RLIMIT_DATA, (size, size))
    faulthandler.enable(crash, all_threads=False)
    _parent.append(Connection(pipe, readable=False))
    try:
        message = _RESULT + pickle.load(sys.stdin.buffer)()
    except ForceboundError as error:
        message = _ERROR + str(error).encode("utf-8", "replace")
    _parent[0].send_bytes(message)
