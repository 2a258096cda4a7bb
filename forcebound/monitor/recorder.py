"""Recording of a running graph, from now on, by a process that is no part of it.

It is the recorder of ``forcebound launch --record``, on all topics, off the nodes' core. The launch
file in its metadata has the values of now, law included; versions and seed are those of the run.
What changes from then on, by a phase too, is in the events of the nodes.
"""

import json
import math
import os
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import count
from pathlib import Path
from typing import Any

from forcebound import process
from forcebound.errors import RunError
from forcebound.files import RECORDING_SUFFIX
from forcebound.launch.run_directory import RunDocument, read_launch_document, recorded_streams
from forcebound.launch.worker import record_run
from forcebound.messages.packets import TOPICS
from forcebound.monitor.control import ask
from forcebound.monitor.runs import Watch
from forcebound.recording import ENERGY_BEFORE

CONNECTED = 0.1  # s after which the sockets of a recorder receive all that is sent


class _OutdatedError(Exception):
    """A parameter has changed before its event could be received."""


@dataclass(frozen=True)
class Recorded:
    """A recording of a running graph.

    Attributes:
        recording: The file.
        graph: Launch file with its arguments.
        seconds: How long it was recorded.
        packets: Number by topic.
        ended: ``"interrupted"``, ``"duration"``, or ``"graph ended"``.
    """

    recording: str
    graph: str
    seconds: float
    packets: Mapping[str, int]
    ended: str


def record_running(
    run_dir: Path, file: Path, duration: float | None, begin: Callable[[str], None]
) -> Recorded:
    """Record a running graph until an interrupt, or its end.

    Call it from the main thread, because it catches SIGINT and SIGTERM.

    Args:
        run_dir: Of the graph.
        file: To write; replaced if it exists.
        duration: Longest time, in s; None: no limit.
        begin: Called with the name of the graph when it begins.

    Raises:
        ConfigError: If no graph runs there, or the file cannot be written.
        RunError: If the file could not be written to its end, or nothing came.
        KeyboardInterrupt: If it was interrupted before anything came; no file is left.
    """
    run = RunDocument.read(run_dir)
    own = replace(run, record=str(file.absolute()), streams=recorded_streams(run_dir, list(TOPICS)))
    course = _Course(run_dir, duration, lambda: begin(run.file))
    with process.Stop() as stop:
        name = f"rec-{os.getpid()}"  # no longer than a topic: the path of a socket has a limit
        status: dict[str, Any] | None = None
        while status is None:
            own = replace(own, metadata=run.metadata | course.restart())
            with suppress(_OutdatedError):
                status = record_run(own, run_dir, stop, name, course.is_over)
        is_interrupted = stop.requested
    seconds = course.seconds
    if not any(status["received"].values()):
        file.unlink()
        if is_interrupted:
            raise KeyboardInterrupt
        raise RunError(f"nothing came from the graph in {run_dir} for {seconds:.1f} s")
    if status["recording"] != process.COMPLETE:
        raise RunError(f"recording {status['recording']}; {file} has what came before")
    ended = "graph ended" if course.watch.is_over else "duration"
    ended = "interrupted" if is_interrupted else ended
    return Recorded(str(file), run.file, round(seconds, 3), status["received"], ended)


class _Course:
    """Beginning and end of a recording.

    Args:
        run_dir: Of the graph.
        duration: Longest time, in s; None: no limit.
        begin: Called when it begins.

    Attributes:
        watch: Knows whether the graph has ended.
    """

    def __init__(self, run_dir: Path, duration: float | None, begin: Callable[[], None]) -> None:
        self._run_dir, self._begin = run_dir, begin
        self._duration = math.inf if duration is None else duration
        self._listens = self._began = 0.0  # s of the monotonic clock; 0: not yet
        self.watch = Watch(run_dir)

    @property
    def seconds(self) -> float:
        """Time since it began."""
        return time.monotonic() - self._began if self._began else 0.0

    def restart(self) -> dict[str, str]:
        """Return the values with which it is to begin, for its metadata."""
        self._listens = 0.0
        self._document = read_launch_document(self._run_dir)
        device = ask(self._run_dir, "device", {"request": "status"}) or {}
        return {
            "launch": json.dumps(self._document, sort_keys=True),
            ENERGY_BEFORE: repr(device.get(ENERGY_BEFORE, 0.0)),
        }

    def is_over(self, state: str) -> bool:
        """Return whether it is to end; its recorder asks again and again.

        Raises:
            _OutdatedError: If it is to begin with another document.
        """
        now = time.monotonic()
        self._listens = self._listens or now
        if not self._began and now - self._listens >= CONNECTED:
            if read_launch_document(self._run_dir) != self._document:
                raise _OutdatedError
            self._began = self._listens
            self._begin()
        return state != process.COMPLETE or self.watch.is_over or self.seconds >= self._duration


def free_name(folder: Path, graph: str) -> Path:
    """Return a name for a recording of a graph that no file in a folder has.

    Args:
        folder: Where it is to be.
        graph: Launch file with its arguments.
    """
    stem = Path(graph.partition(" ")[0]).stem or "graph"
    now = time.strftime("%Y%m%d-%H%M%S")
    names = (folder / f"{stem}-{now}{f'-{n}' if n > 1 else ''}{RECORDING_SUFFIX}" for n in count(1))
    return next(name for name in names if not name.exists())
