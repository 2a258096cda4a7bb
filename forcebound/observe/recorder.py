"""Recording of a running graph, from now on, by a process that is no part of it.

The launch file in its metadata has the values of now, law included; versions and seed are those of
the run. What changes from then on, by a phase too, is in the events of the nodes.
"""

import json
import math
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING

from forcebound.errors import RunError
from forcebound.files import RECORDING_SUFFIX, check_writable
from forcebound.graph.resolved import to_document
from forcebound.messages.packets import TOPIC_OF, Telemetry
from forcebound.messages.topology import node_name
from forcebound.network import sockets
from forcebound.observe.control import device_status
from forcebound.observe.runs import Watch
from forcebound.run.process.reader import Reader
from forcebound.run.process.recorder import COMPLETE, FailSafeSink, clocks
from forcebound.run.run_directory import RunDocument, read_configuration
from forcebound.stop import Stop

if TYPE_CHECKING:
    from forcebound.recordings.recording import Recorder

BACKLOG_TIMEOUT = 10.0  # s to write what has come by the end
CONNECTED_NS = 100_000_000  # after which the sockets of a recorder receive all that is sent


@dataclass(frozen=True)
class Recorded:
    """A recording of a running graph."""

    recording: str  # the file
    graph: str  # launch file with its arguments
    seconds: float  # how long it was recorded
    packets: Mapping[str, int]  # by topic
    ended: str  # "interrupted", "duration" or "graph ended"

    def __str__(self) -> str:
        telemetry = TOPIC_OF[Telemetry]
        counts = (n for name, n in self.packets.items() if name.rpartition("/")[2] == telemetry)
        ticks = " and ".join(map(str, counts))
        return f"recorded {self.seconds:.1f} s, {ticks} ticks: {self.recording}"


def record_running(
    run_dir: Path,
    file: Path,
    duration: float | None,
    begin: Callable[[str], None],
    stop: Stop,
) -> Recorded:
    """Record a running graph for ``duration`` s, until a request to stop, or until it ends.

    ``begin`` is called with the name of the graph when the recording begins.

    Raises:
        ConfigError: If no graph runs there, or the file cannot be written.
        RunError: If the file could not be written to its end, or nothing came.
        KeyboardInterrupt: If it was stopped before anything came; no file is left.
    """
    check_writable(file, "the recording")
    run, watch = RunDocument.read(run_dir), Watch(run_dir)
    with Reader(run_dir, run.graph.streams, run.core) as reader:
        sockets.wait((stop.descriptor,), CONNECTED_NS)
        recorder = _begun(run_dir, run, file, reader)
        sink = FailSafeSink(recorder)
        begin(run.file)
        start = time.monotonic()
        end = math.inf if duration is None else start + duration
        try:
            while not (stop.requested or watch.is_over or time.monotonic() >= end):
                reader.wait(stop.descriptor)
                sink.take(reader)
                if sink.state != COMPLETE:
                    break
            limit = time.monotonic() + BACKLOG_TIMEOUT
            while sink.take(reader) and time.monotonic() < limit:  # much on a busy machine
                pass
            sink.flush()
        finally:
            with suppress(OSError):  # a full disk, which is reported; the file stays readable
                recorder.close(clocks()[1]) if sink.state == COMPLETE else recorder.abandon()
        seconds = time.monotonic() - start
    if not any(reader.received.values()):
        file.unlink()
        if stop.requested:
            raise KeyboardInterrupt
        raise RunError(f"nothing came from the graph in {run_dir} for {seconds:.1f} s")
    if sink.state != COMPLETE:
        raise RunError(f"recording {sink.state}; {file} has what came before")
    ended = "graph ended" if watch.is_over else "duration"
    ended = "interrupted" if stop.requested else ended
    return Recorded(str(file), run.file, round(seconds, 3), reader.received, ended)


def _begun(run_dir: Path, run: RunDocument, file: Path, reader: Reader) -> "Recorder":
    """Return a recorder of what comes from now on, with the values of now in its metadata."""
    from forcebound.recordings.recording import ENERGY_BEFORE, Recorder  # slow to import

    while True:
        config = read_configuration(run_dir)
        devices = {hand: device_status(run_dir, hand=hand) for hand in run.graph.hands}
        now = {
            node_name(hand, ENERGY_BEFORE): repr(0.0 if one is None else one.energy_before)
            for hand, one in devices.items()
        }
        now["launch"] = json.dumps(to_document(config), sort_keys=True)
        offset_ns, clock = clocks()
        recorder = Recorder(str(file.absolute()), run.metadata | now | clock, offset_ns, run.graph)
        reader.forget()
        if read_configuration(run_dir) == config:
            return recorder
        recorder.abandon()  # a value has changed, and the event of that may be lost


def free_name(folder: Path, run_dir: Path) -> Path:
    """Return a name in a folder for a recording of a running graph that no file has."""
    stem = Path(RunDocument.read(run_dir).file.partition(" ")[0]).stem or "graph"
    now = time.strftime("%Y%m%d-%H%M%S")
    names = (folder / f"{stem}-{now}{f'-{n}' if n > 1 else ''}{RECORDING_SUFFIX}" for n in count(1))
    return next(name for name in names if not name.exists())
