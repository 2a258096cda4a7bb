"""The end of a child process and of its group: first in order, then by force."""

import os
import signal
import subprocess
import time
from contextlib import suppress
from typing import Any


def end(process: "subprocess.Popen[Any]", grace: float) -> None:
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
            os.killpg(leader, 0)
            time.sleep(0.01)
        os.killpg(leader, signal.SIGKILL)
