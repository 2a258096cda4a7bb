"""The end of a child process and of its group: first in order, then by force."""

import os
import signal
import subprocess
import time
from contextlib import suppress
from typing import Protocol


class Process(Protocol):
    """A child process, such as a :class:`subprocess.Popen`."""

    pid: int

    def poll(self) -> int | None:
        """Return the status; None while it runs."""
        ...

    def wait(self, timeout: float | None = None) -> int:
        """Return the status when it has ended; TimeoutExpired after ``timeout`` s."""
        ...

    def terminate(self) -> None:
        """Ask it to end."""
        ...

    def kill(self) -> None:
        """End it by force."""
        ...


def end(process: Process, grace: float) -> None:
    """End a process and its group if it still runs: SIGTERM, then SIGKILL after ``grace`` s."""
    if process.poll() is not None:
        return
    process.terminate()
    try:
        process.wait(grace)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
    end_group(process.pid, grace)


def end_group(leader: int, grace: float) -> None:
    """Kill what is left of the group of a process that has just ended, after ``grace`` s."""
    deadline = time.monotonic() + grace
    with suppress(ProcessLookupError):
        while time.monotonic() < deadline:
            with suppress(ChildProcessError):  # orphans of its group that became our children
                os.waitpid(-leader, os.WNOHANG)
            os.killpg(leader, 0)
            time.sleep(0.01)
        os.killpg(leader, signal.SIGKILL)
