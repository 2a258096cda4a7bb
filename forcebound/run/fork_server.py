"""Fork servers: processes that have imported what a graph needs, and fork its processes from that.

A process that starts as an interpreter of its own imports for half a second, mostly numpy and
numba, and a graph has five of them. How it works:

1. A launcher starts its server by exec, before it reads the launch file. The server imports the
   nodes, runs a few ticks in virtual time, which loads the kernels from their cache, and sets its
   objects aside for the collector. It has one thread, no socket but the one to its launcher, and
   no code of a user: that is loaded in the nodes.
2. For each node the launcher sends the command line and the descriptors of its streams. The server
   forks twice, and its child ends at once: so the grandchild becomes a child of the launcher, the
   *subreaper* of all that it has started. The launcher waits for it, gets its status and ends it as
   any child, and the kernel reports the launcher's death to it (:mod:`forcebound.run.worker`).
3. The grandchild does what the command line says, as an interpreter that was started with it.
   Session, scheduling, cores and locked memory are its own.
4. A Python program (``fb.launch``) has one server for all its launches, some 150 MB until the
   program ends. It forks launchers, which fork their own servers from themselves at once. A
   *monitor* waits for each launcher and writes its status to a pipe, since a program need not be a
   subreaper.

A server ends with who started it, since that closes the other end of the socket. If it ends
earlier, its processes go on, and the next one starts as an interpreter.
"""

import ctypes
import errno
import gc
import io
import json
import logging
import math
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from typing import IO

from forcebound import realtime

#: What a command line begins with.
PROGRAM = (sys.executable, "-m", "forcebound")
PR_SET_NAME = 15  # <linux/prctl.h>; of at most 15 bytes
PR_SET_CHILD_SUBREAPER, PR_GET_CHILD_SUBREAPER = 36, 37  # <linux/prctl.h>
LARGEST = 200_000  # bytes of a request: a command line and an environment
PAUSE = 0.001  # s, between two looks whether a process has ended, or has its new parent
STREAMS = ("stdin", "stdout", "stderr")

_libc = ctypes.CDLL(None, use_errno=True)
_inherited: "ForkServer | None" = None  # of a launcher that was forked itself

_SERVER = """
from forcebound.__main__ import main
from forcebound.run.fork_server import serve
if serve({descriptor}):
    main()
"""


class Forked:
    """A process that a server has forked, as a :class:`subprocess.Popen`."""

    def __init__(self, pid: int, stdout: IO[bytes] | None = None) -> None:
        self.pid, self.stdout = pid, stdout
        self.returncode: int | None = None

    def poll(self) -> int | None:
        """Return the status, negative for a signal; None while it runs."""
        if self.returncode is None:
            self.returncode = self._status()
        return self.returncode

    def _status(self) -> int | None:
        pid, status = os.waitpid(self.pid, os.WNOHANG)
        return os.waitstatus_to_exitcode(status) if pid else None

    def wait(self, timeout: float | None = None) -> int:
        """Return the status when it has ended; TimeoutExpired after ``timeout`` s."""
        seconds = math.inf if timeout is None else timeout
        deadline = time.monotonic() + seconds
        while (status := self.poll()) is None:
            if time.monotonic() > deadline:
                raise subprocess.TimeoutExpired(str(self.pid), seconds)
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


class Launched(Forked):
    """A launcher of a Python program; it ends when its standard input does."""

    def __init__(self, pid: int, stdin: IO[bytes], monitor: int) -> None:
        super().__init__(pid)
        self.stdin = stdin
        self._monitor = os.fdopen(monitor, "rb", buffering=0)
        os.set_blocking(monitor, False)

    def _status(self) -> int | None:
        answer = self._monitor.read()
        if answer is None:  # nothing yet
            return None
        self._monitor.close()
        return int(answer or -signal.SIGKILL)


class ForkServer:
    """The end of a server in the process that uses it."""

    def __init__(self, channel: socket.socket, pid: int) -> None:
        self.pid, self._channel = pid, channel

    def start(self, command: Sequence[str], own_session: bool) -> Forked:
        """Fork a node that does what a command line says, once the server is ready.

        Raises:
            OSError: If the server has ended, or there is no memory or process left.
        """
        reading, writing = os.pipe()
        with os.fdopen(writing), open(os.devnull) as nothing:
            request = {"words": command[len(PROGRAM) :], "own_session": own_session}
            try:
                pid = self._ask(request, nothing.fileno(), writing, writing)
            except OSError:
                os.close(reading)
                raise
        return Forked(pid, os.fdopen(reading, "rb", buffering=0))

    def launch(self, words: Sequence[str], log: int, output: int | None = None) -> Launched:
        """Fork a launcher, whose log and output go to descriptors. Errors: as of :meth:`start`."""
        (stdin, our_stdin), (status, their_status) = os.pipe(), os.pipe()
        with os.fdopen(stdin), os.fdopen(their_status), open(os.devnull, "w") as nothing:
            request = {"words": words, "own_session": True, "is_launcher": True}
            stdout = nothing.fileno() if output is None else output
            try:
                pid = self._ask(request, stdin, stdout, log, their_status)
            except OSError:
                os.close(our_stdin)
                os.close(status)
                raise
        return Launched(pid, os.fdopen(our_stdin, "wb", buffering=0), status)

    def _ask(self, request: Mapping[str, object], *descriptors: int) -> int:
        here = {
            "folder": os.getcwd(),
            "environ": dict(os.environ),
            "cores": [*os.sched_getaffinity(0)],
        }
        content = json.dumps({**here, **request}).encode()
        socket.send_fds(self._channel, [content], descriptors)
        answer = json.loads(self._channel.recv(LARGEST) or b"0")
        if answer <= 0:
            raise OSError(-answer, os.strerror(-answer) if answer else "its fork server has ended")
        return int(answer)

    def close(self) -> None:
        """End the server."""
        self._channel.close()
        with suppress(ProcessLookupError):
            os.kill(self.pid, signal.SIGKILL)
        with suppress(ChildProcessError):
            os.waitpid(self.pid, 0)


def started() -> ForkServer:
    """Start a server by exec."""
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with theirs:
        server = subprocess.Popen(
            [sys.executable, "-c", _SERVER.format(descriptor=theirs.fileno())],
            stdin=subprocess.DEVNULL,
            stdout=2,
            pass_fds=[theirs.fileno()],
            process_group=0,  # Ctrl-C is for the launcher
            env={**os.environ, "PYTHONUNBUFFERED": "1", "OPENBLAS_NUM_THREADS": "1"},
        )
    server.returncode = 0  # it is waited for by ForkServer.close
    return ForkServer(ours, server.pid)


@contextmanager
def fork_server() -> Iterator[ForkServer]:
    """Give the server of a launcher, whose processes are its children in the block; end it."""
    server = _inherited or started()
    before = ctypes.c_int()
    _libc.prctl(PR_GET_CHILD_SUBREAPER, ctypes.byref(before))
    _libc.prctl(PR_SET_CHILD_SUBREAPER, 1)
    try:
        yield server
    finally:
        _libc.prctl(PR_SET_CHILD_SUBREAPER, before.value)
        server.close()


def serve(descriptor: int) -> bool:
    """Serve to the end of who started it; True in a new process, which does what ``argv`` says."""
    gc.disable()  # what is imported stays: to look through it takes 0.1 s
    from forcebound.graph.loader import load
    from forcebound.run import worker  # noqa: F401
    from forcebound.run.trial import try_start

    log, handler = logging.getLogger("forcebound"), logging.StreamHandler()
    log.addHandler(handler)  # it says that it compiles, with an empty cache
    log.setLevel(logging.INFO)
    try_start(load("stiff_wall"))
    log.setLevel(logging.NOTSET)
    log.removeHandler(handler)
    gc.freeze()
    gc.enable()
    return _serve(socket.socket(fileno=descriptor))


def _serve(channel: socket.socket) -> bool:
    realtime.die_with_parent(signal.SIGKILL)
    _call_itself("server")
    while True:
        content, descriptors, _, _ = socket.recv_fds(channel, LARGEST, len(STREAMS) + 1)
        if not content:
            return False
        request = json.loads(content)
        is_launcher = request.pop("is_launcher", False)
        reading, writing = os.pipe()
        child = os.fork()
        if child == 0:
            os.close(reading)
            if is_launcher:
                _go_on_as_launcher(writing, descriptors.pop())
            else:
                _go_on_as_orphan(writing)
            channel.close()
            _become(descriptors, **request)
            return not is_launcher or _serve_itself()
        for descriptor in (writing, *descriptors):
            os.close(descriptor)
        with os.fdopen(reading) as pipe:
            pid = pipe.read() or str(-errno.EAGAIN)
        os.waitpid(child, 0)
        with suppress(OSError):
            channel.send(pid.encode())


def _go_on_as_orphan(report: int) -> None:
    """Go on in a grandchild of the server, whose parent ends; ``report`` gets its identifier."""
    between = os.getpid()
    pid = _fork(report)
    if pid:
        os.write(report, str(pid).encode())
        os._exit(0)
    os.close(report)
    while os.getppid() == between:
        time.sleep(PAUSE)


def _go_on_as_launcher(report: int, status: int) -> None:
    """Go on in a child of a monitor, an orphan that writes its status."""
    if _fork(report):
        os._exit(0)
    pid = _fork(report)
    if pid:
        os.write(report, str(pid).encode())
        os.dup2(status, 3)  # and nothing else stays open
        os.closerange(4, os.sysconf("SC_OPEN_MAX"))
        _, code = os.waitpid(pid, 0)
        with suppress(OSError):  # nobody reads it
            os.write(3, str(os.waitstatus_to_exitcode(code)).encode())
        os._exit(0)
    os.close(report)
    os.close(status)


def _fork(report: int) -> int:
    """Fork; a failure is reported, and ends the process."""
    try:
        return os.fork()
    except OSError as error:
        os.write(report, str(-(error.errno or errno.EAGAIN)).encode())
        os._exit(1)


def _become(
    descriptors: Sequence[int],
    words: Sequence[str],
    own_session: bool,
    folder: str,
    environ: Mapping[str, str],
    cores: Sequence[int],
) -> None:
    """Take the place of an interpreter that has just been started."""
    import numpy as np  # a launcher has not waited for it

    os.setsid() if own_session else os.setpgid(0, 0)
    for number, (name, descriptor) in enumerate(zip(STREAMS, descriptors, strict=True)):
        os.dup2(descriptor, number)
        if number:
            raw = io.FileIO(number, "wb", closefd=False)
            setattr(sys, name, io.TextIOWrapper(raw, errors="backslashreplace", write_through=True))
    for descriptor in {*descriptors}:
        os.close(descriptor)
    os.chdir(folder)
    os.environ.clear()
    os.environ.update(environ)
    os.sched_setaffinity(0, cores)
    np.random.seed()  # else all processes of a server have the same numbers
    sys.argv[1:] = words
    _call_itself(words[1] if words[0] == "node" else words[0])


def _call_itself(name: str) -> None:
    """Set the name that ``ps -o comm`` and ``top`` show; the command line is the server's."""
    _libc.prctl(PR_SET_NAME, ctypes.c_char_p(f"fb {name}".encode()))


def _serve_itself() -> bool:
    """Fork the server of this launcher; True in the launcher, and in each of its nodes."""
    global _inherited
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    pid = os.fork()
    if pid == 0:
        ours.close()
        return _serve(theirs)
    theirs.close()
    _inherited = ForkServer(ours, pid)
    threading.Thread(target=_end_with_input, daemon=True).start()
    return True


def _end_with_input() -> None:
    os.read(0, 1)
    os.kill(os.getpid(), signal.SIGTERM)
