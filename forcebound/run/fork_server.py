"""The fork server of a launcher: it has imported what nodes need, and forks them from that.

A node that starts as an interpreter of its own imports for half a second, mostly numpy and numba,
and a graph has four of them. How it works:

1. The launcher starts the server by exec, before it reads the launch file. The server imports the
   nodes, runs a few ticks in virtual time, which loads the kernels from their cache, and sets all
   its objects aside for the collector. It has one thread, no socket but the one to its launcher,
   and no code of a user: that is loaded in the nodes.
2. For each process the launcher sends the command line and the descriptor of its output. The server
   forks twice: its child ends at once, so the grandchild becomes a child of the launcher, the
   *subreaper* of all that it has started. The launcher waits for it, gets its status and ends it as
   any child, and the kernel reports the launcher's death to it (:mod:`forcebound.run.worker`).
3. The grandchild does what the command line says, as an interpreter would that had been started
   with it. Session, scheduling, cores and locked memory are its own.

The server ends with its launcher, whose end of the socket is closed then. If the server ends
earlier, the nodes go on, and the next one starts as an interpreter.
"""

import ctypes
import gc
import io
import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager, suppress

from forcebound import realtime

PR_SET_CHILD_SUBREAPER, PR_GET_CHILD_SUBREAPER = 36, 37  # <linux/prctl.h>
LARGEST = 1_000_000  # bytes of a request: a command line and an environment
PAUSE = 0.001  # s, between two looks whether a process has its new parent

#: What a command line begins with.
PROGRAM = (sys.executable, "-m", "forcebound")

_libc = ctypes.CDLL(None, use_errno=True)

# As `python -m forcebound`; `-c` has one place for modules of the current folder, set per request.
_PROGRAM = """
from forcebound.__main__ import main
from forcebound.run.fork_server import serve
if serve({descriptor}):
    main()
"""


class Forked:
    """A process that the server has forked, as a :class:`subprocess.Popen`."""

    def __init__(self, pid: int, output: int) -> None:
        self.pid = pid
        self.stdout = os.fdopen(output, "rb", buffering=0)
        self.returncode: int | None = None

    def poll(self) -> int | None:
        """Return the status, negative for a signal; None while it runs."""
        if self.returncode is None:
            pid, status = os.waitpid(self.pid, os.WNOHANG)
            if pid:
                self.returncode = os.waitstatus_to_exitcode(status)
        return self.returncode

    def wait(self, timeout: float | None = None) -> int:
        """Return the status when it has ended; TimeoutExpired after ``timeout`` s."""
        deadline = None if timeout is None else time.monotonic() + timeout
        while (status := self.poll()) is None:
            if deadline is not None and timeout is not None and time.monotonic() > deadline:
                raise subprocess.TimeoutExpired(str(self.pid), timeout)
            time.sleep(PAUSE)
        return status

    def send_signal(self, number: int) -> None:
        """Send it a signal, unless it has ended."""
        if self.poll() is None:
            os.kill(self.pid, number)

    def terminate(self) -> None:
        """Ask it to end."""
        self.send_signal(signal.SIGTERM)

    def kill(self) -> None:
        """End it by force."""
        self.send_signal(signal.SIGKILL)


class ForkServer:
    """The launcher's end of a fork server; use :func:`fork_server`."""

    def __init__(self, channel: socket.socket) -> None:
        self._channel = channel

    def start(self, command: Sequence[str], own_session: bool, cores: Collection[int]) -> Forked:
        """Fork a process that does what a command of ``PROGRAM`` says, once the server is ready.

        Raises:
            OSError: If the server has ended, or there is no memory or process left.
        """
        request = {
            "words": list(command[len(PROGRAM) :]),
            "own_session": own_session,
            "cores": list(cores),
        }
        reading, writing = os.pipe()
        try:
            socket.send_fds(self._channel, [json.dumps(request).encode()], [writing])
            answer = json.loads(self._channel.recv(LARGEST) or b"0")
        except BaseException:
            os.close(reading)
            raise
        finally:
            os.close(writing)
        if answer <= 0:
            os.close(reading)
            raise OSError(-answer, os.strerror(-answer) if answer else "its fork server has ended")
        return Forked(answer, reading)


@contextmanager
def fork_server() -> Iterator[ForkServer]:
    """Start a fork server, and end it; its processes are children of this one in the block."""
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with ours:
        with theirs:
            descriptor = theirs.fileno()
            server = subprocess.Popen(
                [sys.executable, "-c", _PROGRAM.format(descriptor=descriptor)],
                stdin=subprocess.DEVNULL,
                stdout=2,
                pass_fds=[descriptor],
                process_group=0,  # Ctrl-C is for the launcher
                env={**os.environ, "PYTHONUNBUFFERED": "1", "OPENBLAS_NUM_THREADS": "1"},
            )
        before = _adopt_orphans(1)
        try:
            yield ForkServer(ours)
        finally:
            _adopt_orphans(before)
            ours.close()  # which ends it
            server.kill()
            server.wait()


def _adopt_orphans(does: int) -> int:
    """Let orphans among the processes below this one become its children; return what held."""
    before = ctypes.c_int()
    _libc.prctl(PR_GET_CHILD_SUBREAPER, ctypes.byref(before))
    _libc.prctl(PR_SET_CHILD_SUBREAPER, does)
    return before.value


def serve(descriptor: int) -> bool:
    """Serve a launcher; return True in a process that is to run, False at the launcher's end."""
    realtime.die_with_parent(signal.SIGKILL)
    channel = socket.socket(fileno=descriptor)
    _preload()
    gc.collect()
    gc.freeze()
    while True:
        content, descriptors, _, _ = socket.recv_fds(channel, LARGEST, 1)
        if not content:
            return False
        (output,) = descriptors
        try:
            pid = _fork_orphan()
        except OSError as error:
            pid = -(error.errno or 1)
        if pid == 0:
            channel.close()
            _become(output, **json.loads(content))
            return True
        os.close(output)
        with suppress(OSError):
            channel.send(str(pid).encode())


def _preload() -> None:
    from forcebound.graph.loader import load
    from forcebound.run import worker  # noqa: F401
    from forcebound.run.trial import try_start

    try_start(load("stiff_wall"))


def _fork_orphan() -> int:
    """Fork a process whose parent ends at once; return its identifier, and 0 in it."""
    reading, writing = os.pipe()
    first = os.fork()
    if first == 0:
        between = os.getpid()
        try:
            second = os.fork()
        except OSError as error:
            second = -(error.errno or 1)
        if second:
            os.write(writing, str(second).encode())
            os._exit(0)
        os.close(reading)
        os.close(writing)
        while os.getppid() == between:
            time.sleep(PAUSE)
        return 0
    os.close(writing)
    with os.fdopen(reading) as pipe:
        pid = int(pipe.read())
    os.waitpid(first, 0)
    return pid


def _become(output: int, words: Sequence[str], own_session: bool, cores: Collection[int]) -> None:
    """Take the place of an interpreter that has just been started."""
    os.setsid() if own_session else os.setpgid(0, 0)
    for descriptor, name in ((1, "stdout"), (2, "stderr")):
        os.dup2(output, descriptor)
        raw = io.FileIO(descriptor, "wb", closefd=False)
        setattr(sys, name, io.TextIOWrapper(raw, errors="backslashreplace", write_through=True))
    os.close(output)
    os.sched_setaffinity(0, cores)
    sys.argv[1:] = words
