"""Delay traces: of recorded runs, and the files that launch files name under ``trace``."""

import math
from collections.abc import Mapping, Sequence
from functools import lru_cache
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

from forcebound.errors import ConfigError
from forcebound.files import RECORDING_SUFFIX, content_of, version_of
from forcebound.messages.packets import TOPIC_OF, Telemetry
from forcebound.messages.topology import LINKS, Document
from forcebound.network.impairment import LOOP, Impairment
from forcebound.network.trace import TABLE, DelayTrace, read_csv, read_numbers
from forcebound.recordings.hops import Hops
from forcebound.recordings.launched import launched
from forcebound.recordings.telemetry import TelemetryColumns

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from forcebound.recordings.recording import Recording


def trace_of(impairment: Impairment) -> DelayTrace | None:
    """Return the trace of an impairment, see :func:`read_trace`; None if it names none."""
    if impairment.trace is None:
        return None
    if impairment.trace_format == TABLE:
        return read_trace(impairment.trace, impairment.trace_hop)
    numbers = impairment.trace, impairment.trace_format, impairment.trace_interval
    return _read_numbers(*numbers, version_of(impairment.trace))


def shortest_of(impairment: Impairment) -> float:
    """Return the shortest time on the way, in s, of its trace if it has one."""
    trace = trace_of(impairment)
    if trace is None or impairment.reorder > 0.0:
        return impairment.shortest
    return trace.shortest + impairment.delay


def read_trace(file: Path, hop: str = LOOP) -> DelayTrace:
    """Return the trace in a CSV file, or of a recording (``.mcap``).

    Args:
        file: The file.
        hop: Of a recording: a link, by :func:`hop_delays`; or all of the loop, by
            :func:`as_link_trace`.

    Raises:
        ConfigError: If the file cannot be read or is neither.
    """
    version = version_of(file)
    return _read(file, version) if hop == LOOP else _read_hops(file, version)[hop]


@lru_cache(maxsize=8)
def _read(file: Path, version: tuple[int, int]) -> DelayTrace:
    # The loader checks what the links then use, and a sweep does so thousands of times.
    if file.suffix == RECORDING_SUFFIX:
        trace, document, _ = of_recording(file)
        return as_link_trace(trace, document)
    return read_csv(file)


@lru_cache(maxsize=8)
def _read_numbers(file: Path, form: str, interval: float, version: tuple[int, int]) -> DelayTrace:
    return read_numbers(file, form, interval)


@lru_cache(maxsize=2)
def _read_hops(file: Path, version: tuple[int, int]) -> Mapping[str, DelayTrace]:
    from forcebound.recordings.recording import read  # as in of_recording

    recording = read(file, (*LINKS, TOPIC_OF[Telemetry]))
    with content_of(file):
        return hop_delays(recording)


def of_recording(file: Path, hand: str | None = None) -> tuple[DelayTrace, Document, bool]:
    """Return the loop delays of a recording, its launch document, and whether it is complete.

    Of several hands, ``hand`` is the one that is meant.

    Raises:
        ConfigError: If it cannot be read, or has no tick to show a delay.
    """
    from forcebound.recordings.recording import read  # slow, and few traces are recordings

    recording = read(file, (TOPIC_OF[Telemetry],), hand)
    with content_of(file):
        columns = recording.telemetry
        try:
            trace = loop_delays(columns)
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
    times, ticks, delay_of = _answered(columns, columns.time >= 0.0)
    return DelayTrace(times, [delay_of.get(tick) for tick in ticks])


def _answered(
    columns: TelemetryColumns, begun: "NDArray[np.bool_]"
) -> tuple[list[float], list[int], dict[int, float]]:
    """Return times, in s, and numbers of the ticks of a trace, and loop delays by answered tick.

    Args:
        columns: Of the run.
        begun: Which rows may count.
    """
    import numpy as np  # few launch files name a recording

    answers, first = np.unique(columns.device_seq, return_index=True)
    delay_of = dict(zip(answers.tolist(), columns.loop_delay[first].tolist(), strict=True))
    known = columns.loop_delay[np.isfinite(columns.loop_delay)]
    longest = float(known.max()) if known.size else 0.0
    end = columns.time[-1] - longest if columns.time.size else 0.0
    chosen = begun & (columns.time <= end)
    ticks = columns.seq[chosen].tolist()
    if not ticks:
        raise ConfigError("it ended before the answers to its first ticks: record for longer")
    began = columns.elapsed[chosen][0]  # not 0 for a part of a run
    return (columns.time[chosen] + began).tolist(), ticks, delay_of


def as_link_trace(trace: DelayTrace, document: Document) -> DelayTrace:
    """Return delays that give a run these loop delays, if one link has them and nothing else does.

    The device takes an answer when it writes, ``reply_wait`` after the sample that it answers. This
    part of the loop delay is there again in any replay, so it is taken away; the rest is whole
    periods, and leaves an undisturbed loop its ``reply_wait`` to go round.

    Args:
        trace: Loop delays; see :func:`loop_delays`.
        document: The launch file of the run, as resolved; reads ``device.reply_wait`` and ``rate``.
    """
    waited = _waited(document)
    return DelayTrace(
        trace.times, [None if delay is None else max(delay - waited, 0.0) for delay in trace.delays]
    )


def _waited(document: Document) -> float:
    """How long the device of a launch file waits in a tick for an answer, in s."""
    device = launched(document).device
    return device.reply_wait / (device.rate or 1.0)


def hop_delays(recording: "Recording") -> dict[str, DelayTrace]:
    """Return the delays of each link; together they give the recorded loop delays.

    A hop goes from the time stamp of a packet to that of what its receiver made of it: when the
    sender and the receiver took what they answer. Injected computation is so in the hop of the
    query, the time of a node's own code in the hop after it. The last hop ends ``reply_wait``
    before the write that takes the force, as in :func:`as_link_trace`, and what the others take of
    this time does not count, either: a run has it again. A packet that nothing followed is lost.

    * With an environment on another machine, whose clock is another one, the way to it and back is
      all in the query's hop.
    * A controller that answers a state at once does not show when it had the reply. The hop of the
      reply then has no delay.

    Args:
        recording: With telemetry and the topics of the links.

    Raises:
        ConfigError: As :func:`loop_delays`.
    """
    columns = recording.telemetry
    _, ticks, delay_of = _answered(columns, columns.elapsed > 0.0)
    hops = Hops.of(recording.stream(*LINKS))
    states, queries, replies, commands = (hops.sent_ns[topic] for topic in LINKS)
    if recording.launch.get("remote"):
        replies = commands
    answers_states = any(
        queries.get(tick) == commands[tick] < replies.get(tick, math.inf) for tick in commands
    )
    waited_ns = round(_waited(recording.launch) * 1e9)
    rows: dict[str, dict[int, int | None]] = {topic: {} for topic in LINKS}
    for tick in ticks:
        sent = [times.get(tick) for times in (states, queries, replies, commands)]
        taken = None
        if sent[0] is not None and tick in delay_of:
            taken = sent[0] + max(round(delay_of[tick] * 1e9) - waited_ns, 0)
        for topic, (start, end) in zip(LINKS, _hops(sent, taken, answers_states), strict=True):
            if start is not None:
                rows[topic][start] = None if end is None else end - start
    return {topic: _as_trace(rows[topic]) for topic in LINKS}


def _hops(
    sent: Sequence[int | None], taken: int | None, answers_states: bool
) -> list[tuple[int | None, int | None]]:
    """Return start and end of each hop of a tick, in ns; None: there was none.

    Args:
        sent: When state, query, reply and command were sent, in ns.
        taken: When the command was there for the write that took it, in ns.
        answers_states: Whether the command answers the state, not the reply.
    """
    times = sent if taken is None else [None if t is None else min(t, taken) for t in sent]
    state, query, _, command = times
    if not answers_states:
        return list(pairwise((*times, taken)))
    asked, answered = sent[1:3]  # outside of the loop, which is not waiting for it
    back = None if query is None or asked is None or answered is None else query + answered - asked
    return [(state, query), (query, back), (None, None), (command, taken)]


def _as_trace(rows: Mapping[int, int | None]) -> DelayTrace:
    """Return the delays by time of sending, both in ns, as a trace; without any, no delay."""
    if not rows:
        return DelayTrace([0.0], [0.0])
    sent, delays = zip(*sorted(rows.items()), strict=True)
    return DelayTrace(
        [(time - sent[0]) * 1e-9 for time in sent],
        [None if delay is None else delay * 1e-9 for delay in delays],
    )
