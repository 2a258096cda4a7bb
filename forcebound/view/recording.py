"""A recording that a page begins and ends, in a thread of its own."""

import time
from pathlib import Path
from threading import Event, Lock, Thread

from forcebound.errors import ConfigError, ForceboundError, RunError
from forcebound.monitor.recorder import free_name, record_running
from forcebound.process import Stop

POLL_S = 0.05  # between two looks whether the recording has begun


class PageRecording:
    """The recordings of one running graph, one after the other; to be ended.

    Args:
        run_dir: Of the graph.
        folder: Where the files go.
    """

    def __init__(self, run_dir: Path, folder: Path) -> None:
        self._run_dir, self._folder, self._file = run_dir, folder, Path()
        self._thread, self._lock = Thread(), Lock()
        self._stop: Stop | None = None  # None: nothing is recorded
        self._began = 0.0  # s, of the monotonic clock
        self._result = ""  # of the last one

    def begin(self) -> None:
        """Begin a recording.

        Raises:
            ConfigError: If there is one already.
            RunError: If it cannot be; the message says why.
        """
        if self._stop is not None:
            raise ConfigError(f"already recording to {self._file}")
        self._file = free_name(self._folder, self._run_dir).absolute()
        begun, self._stop = Event(), Stop()
        self._thread = Thread(target=self._record, args=(self._stop, begun))
        self._thread.start()
        while not begun.wait(POLL_S) and self._thread.is_alive():
            pass
        if not begun.is_set():
            raise RunError(self._result)
        self._began = time.monotonic()

    def _record(self, stop: Stop, begun: Event) -> None:
        try:
            found = record_running(self._run_dir, self._file, None, lambda _: begun.set(), stop)
            self._result = str(found)
        except (ForceboundError, OSError) as error:
            self._result = str(error)
        except KeyboardInterrupt:
            self._result = "it ended before anything came"
        with self._lock:
            self._stop = None
            stop.close()

    def end(self) -> None:
        """End the recording, if there is one."""
        with self._lock:
            if self._stop is not None:
                self._stop.request()
        if self._thread.is_alive():
            self._thread.join()

    def describe(self) -> dict[str, object]:
        """Return what pages need to know: the file, since when, or what came of the last one."""
        is_running = self._stop is not None
        return {
            "type": "recording",
            "file": str(self._file) if is_running else None,
            "seconds": time.monotonic() - self._began if is_running else None,
            "said": self._result,
        }
