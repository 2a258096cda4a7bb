"""Recording of a running graph, from now on, by a process that is no part of it.

It is the recorder of ``forcebound launch --record``, on all topics, off the nodes' core. The launch
file in its metadata has the values of now, law included; versions and seed are those of the run.
"""

import json
import os
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from itertools import count
from pathlib import Path

from forcebound import process
from forcebound.errors import ConfigError, RunError
from forcebound.files import RECORDING_SUFFIX
from forcebound.launch.run_directory import RunDocument, read_launch_document, recorded_streams
from forcebound.launch.worker import record_run
from forcebound.messages.packets import TOPICS
from forcebound.monitor.control import ask
from forcebound.monitor.runs import Watch


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
        ConfigError: If no graph runs there, its phases change its environment, or the file cannot
            be written.
        RunError: If the file could not be written to its end, or nothing came.
        KeyboardInterrupt: If it was interrupted before anything came; no file is left.
    """
    run = RunDocument.read(run_dir)
    metadata = {**run.metadata, "launch": json.dumps(_launch_of_now(run, run_dir), sort_keys=True)}
    streams = recorded_streams(run_dir, list(TOPICS))
    own = replace(run, record=str(file.absolute()), streams=streams, metadata=metadata)
    began, watch = 0.0, Watch(run_dir)

    def is_over(state: str) -> bool:
        nonlocal began
        if not began:  # it listens now
            began = time.monotonic()
            begin(run.file)
        is_enough = duration is not None and time.monotonic() - began >= duration
        return is_enough or state != process.COMPLETE or watch.is_over

    with process.Stop() as stop:
        name = f"rec-{os.getpid()}"  # no longer than a topic: the path of a socket has a limit
        status = record_run(own, run_dir, stop, name, is_over)
        is_interrupted = stop.requested
    seconds = time.monotonic() - began if began else 0.0
    if not any(status["received"].values()):
        file.unlink()
        if is_interrupted:
            raise KeyboardInterrupt
        raise RunError(f"nothing came from the graph in {run_dir} for {seconds:.1f} s")
    if status["recording"] != process.COMPLETE:
        raise RunError(f"recording {status['recording']}; {file} has what came before")
    ended = "graph ended" if watch.is_over else "duration"
    ended = "interrupted" if is_interrupted else ended
    return Recorded(str(file), run.file, round(seconds, 3), status["received"], ended)


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


def _launch_of_now(run: RunDocument, run_dir: Path) -> dict[str, object]:
    """The launch file with the values of now."""
    phases = json.loads(run.metadata["launch"]).get("phases", ())
    if any(name.startswith("environment.") for phase in phases for name in phase["set"]):
        raise ConfigError(
            "the phases of this graph change its environment, and only a recording of the whole run"
            " says when: `forcebound launch FILE --record RUN.mcap`"
        )
    document = read_launch_document(run_dir)
    status = ask(run_dir, "device", {"request": "status"}) or {}
    if "law" in status:
        document["device"]["law"] = status["law"]
    return document
