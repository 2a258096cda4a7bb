"""The end of a child process: first in order, then by force."""

import subprocess
from typing import Any


def end(process: "subprocess.Popen[Any]", patience: float) -> None:
    """End a process if it still runs: SIGTERM, then SIGKILL after ``patience`` s."""
    if process.poll() is not None:
        return
    process.terminate()
    try:
        process.wait(patience)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
