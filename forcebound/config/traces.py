"""Delay traces: of recorded runs, and the files that launch files name under ``trace``."""

from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

from forcebound.errors import ConfigError
from forcebound.files import content_of, reason
from forcebound.messages.packets import TOPIC_OF, Telemetry
from forcebound.network.impairment import Impairment
from forcebound.network.trace import DelayTrace, read_csv
from forcebound.telemetry import TelemetryColumns

RECORDING_SUFFIX = ".mcap"


def trace_of(impairment: Impairment) -> DelayTrace | None:
    """Return the trace of an impairment, see :func:`read_trace`; None if it names none."""
    return None if impairment.trace is None else read_trace(impairment.trace)


def shortest_of(impairment: Impairment) -> float:
    """Return the shortest time on the way, in s, of its trace if it has one."""
    trace = trace_of(impairment)
    if trace is None or impairment.reorder > 0.0:
        return impairment.shortest
    return trace.shortest


def read_trace(file: Path) -> DelayTrace:
    """Return the trace in a CSV file, or of a recording (``.mcap``) by :func:`as_link_trace`.

    Raises:
        ConfigError: If the file cannot be read or is neither.
    """
    try:
        status = file.stat()
    except (OSError, ValueError) as error:  # ValueError: a name that no file can have
        raise ConfigError(f"cannot read the trace {file}: {reason(error)}") from error
    return _read(file, status.st_mtime_ns, status.st_size)


@lru_cache(maxsize=8)
def _read(file: Path, modified_ns: int, size: int) -> DelayTrace:
    # The loader checks what the links then use, and a sweep does so thousands of times.
    if file.suffix == RECORDING_SUFFIX:
        trace, document, _ = of_recording(file)
        return as_link_trace(trace, document)
    return read_csv(file)


def of_recording(file: Path) -> tuple[DelayTrace, Mapping[str, Any], bool]:
    """Return the loop delays of a recording, its launch document, and whether it is complete.

    Raises:
        ConfigError: If it cannot be read, or has no tick to show a delay.
    """
    from forcebound.recording import read  # slow, and few traces are recordings

    recording = read(file, (TOPIC_OF[Telemetry],))
    with content_of(file):
        try:
            trace = loop_delays(recording.telemetry)
        except ConfigError as error:
            raise ConfigError(f"no trace in {file}: {error}") from None
        return trace, recording.launch, recording.complete


def loop_delays(columns: TelemetryColumns) -> DelayTrace:
    """Return the loop delay of the answer to each tick since the force engaged.

    A tick that no force ever answered counts as lost: its answer, or the query for it, was lost,
    or a newer one overtook it. The last ticks, whose answers may have been on their way at the
    end, are left out: as many as fit in the longest delay.

    Raises:
        ConfigError: If nothing is left.
    """
    import numpy as np  # few launch files name a recording

    answers, first = np.unique(columns.device_seq, return_index=True)
    delay_of = dict(zip(answers.tolist(), columns.loop_delay[first].tolist(), strict=True))
    known = columns.loop_delay[np.isfinite(columns.loop_delay)]
    longest = float(known.max()) if known.size else 0.0
    end = columns.time[-1] - longest if columns.time.size else 0.0
    chosen = (columns.time >= 0.0) & (columns.time <= end)
    ticks = columns.seq[chosen].tolist()
    if not ticks:
        raise ConfigError("it ended before the answers to its first ticks: record for longer")
    began = columns.elapsed[chosen][0]  # not 0 for a part of a run
    times = (columns.time[chosen] + began).tolist()
    return DelayTrace(times, [delay_of.get(tick) for tick in ticks])


def as_link_trace(trace: DelayTrace, document: Mapping[str, Any]) -> DelayTrace:
    """Return delays that give a run these loop delays, if one link has them and nothing else does.

    The device takes an answer when it writes, ``reply_wait`` after the sample that it answers. This
    part of the loop delay is there again in any replay, so it is taken away; the rest is whole
    periods, and leaves an undisturbed loop its ``reply_wait`` to go round.

    Args:
        trace: Loop delays; see :func:`loop_delays`.
        document: The launch file of the run, as resolved; reads ``device.reply_wait`` and ``rate``.
    """
    device = document.get("device") or {}
    waited = device.get("reply_wait", 0.0) / device.get("rate", 1.0)
    return DelayTrace(
        trace.times, [None if delay is None else max(delay - waited, 0.0) for delay in trace.delays]
    )
