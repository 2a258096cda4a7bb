"""Child processes of a launcher: output, end and signals."""

import os
import signal
import socket
import subprocess
from collections import deque
from collections.abc import Callable, Sequence

from forcebound.ending import end
from forcebound.files import printable
from forcebound.run.fork_server import Forked, ForkServer
from forcebound.stop import SignalPipe, ending_signals

LAST_CHANCE = 2.0  # s to SIGKILL, for the rest of a group, or when the launcher itself fails
TAIL_LINES = 20  # of a node's log, in the message of a failure
CHUNK = 65_536  # bytes
MAX_LINE = 65_536  # bytes without a line end that are kept


def name_begins(pid: int) -> str:
    """Return the beginning of the name of an environment in a process of this machine."""
    return f"{socket.gethostname()[:32]}/{pid}/"


class OsSignals(SignalPipe):
    """Signals that end a run, and ends of children, as bytes on a descriptor."""

    def __init__(self) -> None:
        self._ending = ending_signals()
        super().__init__((*self._ending, signal.SIGCHLD))

    def take(self) -> bool:
        """Read the received signals; return whether one of them ends the run."""
        try:
            numbers = os.read(self.descriptor, CHUNK)
        except BlockingIOError:
            return False
        return any(number in self._ending for number in numbers)


class Child:
    """One process of the run, and its output.

    Ctrl-C does not reach it. Without a new session it is in that of the launcher: then the
    kernel wakes it if it is suspended when the launcher ends, so that it can end, too.
    """

    def __init__(
        self,
        name: str,
        command: Sequence[str],
        show: Callable[[str, str], None],
        own_session: bool = True,
        server: ForkServer | None = None,
    ) -> None:
        self.name = name
        self.tail: deque[str] = deque(maxlen=TAIL_LINES)
        self._show = show
        self._partial = b""
        self.process = self._forked(server, command, own_session) or subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            start_new_session=own_session,
            process_group=None if own_session else 0,
            env={**os.environ, "PYTHONUNBUFFERED": "1"},
        )
        assert self.process.stdout is not None
        self.descriptor = self.process.stdout.fileno()
        os.set_blocking(self.descriptor, False)

    def _forked(
        self, server: ForkServer | None, command: Sequence[str], own_session: bool
    ) -> Forked | None:
        """Return a process of the fork server; None if the server has ended."""
        try:
            return None if server is None else server.start(command, own_session)
        except OSError as error:
            self._show(self.name, f"starts by itself: {error.strerror}")
            return None

    def read(self) -> bool:
        """Show the complete lines read so far; return False at the end of the stream."""
        try:
            data = os.read(self.descriptor, CHUNK)
        except BlockingIOError:
            return True
        *lines, self._partial = (self._partial + data).split(b"\n")
        if not data or len(self._partial) > MAX_LINE:
            lines, self._partial = [*lines, *filter(None, [self._partial])], b""
        for line in lines:
            text = printable(line.decode(errors="replace").rstrip())
            self.tail.append(text)
            self._show(self.name, text)
        return bool(data)

    def request_end(self) -> None:
        """Ask the process to end, also one that is suspended."""
        self.process.terminate()
        self.process.send_signal(signal.SIGCONT)

    def end(self) -> None:
        """End the process if it still runs, and close its stream."""
        end(self.process, LAST_CHANCE)
        assert self.process.stdout is not None
        self.process.stdout.close()
