"""A recording that a page begins and ends: ``forcebound record``, which a busy page cannot slow."""

import subprocess
import sys
import time
from pathlib import Path

from forcebound.errors import ConfigError, RunError
from forcebound.observe.recorder import free_name

END_TIMEOUT_S = 10.0  # for the end of a recording: there may be much to write to a slow disk


class PageRecording:
    """The recordings of one running graph into a folder, one after the other; to be ended."""

    def __init__(self, run_dir: Path, folder: Path) -> None:
        self._run_dir, self._folder, self._file = run_dir, folder, Path()
        self._process: subprocess.Popen[str] | None = None
        self._began = 0.0  # s, of the monotonic clock
        self._result = ""  # of the last one, in words

    def begin(self) -> None:
        """Begin a recording; ConfigError if there is one already, RunError if it cannot be."""
        if self._is_running():
            raise ConfigError(f"already recording to {self._file}")
        self._file = free_name(self._folder, self._run_dir).absolute()
        words = ["record", str(self._run_dir), "-o", str(self._file)]
        self._process = subprocess.Popen(
            [sys.executable, "-u", "-m", "forcebound", *words],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            start_new_session=True,  # Ctrl-C is for the page's server, which then ends it
        )
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        if not line.startswith("recording "):
            self.end()
            raise RunError(line.strip().removeprefix("forcebound: "))
        self._began = time.monotonic()

    def end(self) -> None:
        """End the recording, if there is one, and keep the last line that it prints."""
        process, self._process = self._process, None
        if process is None:
            return
        process.terminate()
        try:
            printed, _ = process.communicate(timeout=END_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            process.kill()
            printed, _ = process.communicate()
        self._result = [self._result, *printed.splitlines()][-1].removeprefix("forcebound: ")

    def describe(self) -> dict[str, object]:
        """Return what pages need to know: the file, since when, or what came of the last one."""
        is_running = self._is_running()
        return {
            "type": "recording",
            "file": str(self._file) if is_running else None,
            "seconds": time.monotonic() - self._began if is_running else None,
            "result": self._result,
        }

    def _is_running(self) -> bool:
        if self._process is not None and self._process.poll() is not None:
            self.end()  # a full disk, or the end of the graph
        return self._process is not None
