"""A recording that a page begins and ends: ``forcebound record``, a process of its own."""

import subprocess
import sys
import time
from pathlib import Path
from typing import Any

from forcebound.errors import ConfigError, RunError
from forcebound.launch.run_directory import RunDocument
from forcebound.monitor.recorder import free_name

END_TIMEOUT_S = 10.0  # s for the end of a recording: there may be much to write to a slow disk


class PageRecording:
    """The recordings of one running graph, one after the other; to be ended.

    Args:
        run_dir: Of the graph.
        folder: Where the files go.
    """

    def __init__(self, run_dir: Path, folder: Path) -> None:
        self._run_dir, self._folder = run_dir, folder
        self._process: subprocess.Popen[str] | None = None
        self._file = Path()
        self._began = 0.0  # s, of the monotonic clock
        self._last_line = ""  # of the last one

    def begin(self) -> None:
        """Begin a recording.

        Raises:
            ConfigError: If there is one already.
            RunError: If it cannot be; the message says why.
        """
        if self._is_running():
            raise ConfigError(f"already recording to {self._file}")
        self._file = free_name(self._folder, RunDocument.read(self._run_dir).file).absolute()
        words = ["record", str(self._run_dir), "-o", str(self._file)]
        self._process = subprocess.Popen(
            [sys.executable, "-u", "-m", "forcebound", *words],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,  # Ctrl-C is for the page's server, which then ends it
        )
        assert self._process.stdout is not None
        if not self._process.stdout.readline():  # a line when it records
            self._finish()
            raise RunError(self._last_line)
        self._began = time.monotonic()

    def end(self) -> None:
        """End the recording, if there is one."""
        if self._process is not None:
            self._process.terminate()
            self._finish()

    def describe(self) -> dict[str, Any]:
        """Return what pages need to know: the file, since when, or what came of the last one."""
        is_running = self._is_running()
        return {
            "type": "recording",
            "file": str(self._file) if is_running else None,
            "seconds": time.monotonic() - self._began if is_running else None,
            "said": self._last_line,
        }

    def _is_running(self) -> bool:
        if self._process is not None and self._process.poll() is not None:
            self._finish()  # a full disk, or the end of the graph
        return self._process is not None

    def _finish(self) -> None:
        """Wait for the end, and keep the last line that the process prints."""
        process, self._process = self._process, None
        assert process is not None
        try:
            out, err = process.communicate(timeout=END_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            process.kill()
            out, err = process.communicate()
        lines = (err if process.returncode else out).splitlines() or ["the recorder has ended"]
        self._last_line = lines[-1].removeprefix("forcebound: ")
