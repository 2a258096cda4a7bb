"""Topics of a running graph, read from outside: packets, rates, sizes.

Rates are those of the senders' own time stamps, so a slow reader does not change them.
"""

import math
import time
from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from msgspec import Struct

from forcebound.errors import ConfigError, RunError
from forcebound.graph.problems import unknown
from forcebound.messages.packets import TOPIC_OF, TOPICS, Event, Packet, field_types
from forcebound.run.process.reader import Reader, Received
from forcebound.run.run_directory import RUN_FILE, RunDocument


def streams_of(run_dir: Path, names: Collection[str] = ()) -> dict[str, type[Packet]]:
    """Return the packets of some streams of a running graph, by name; no names: of all.

    Raises:
        ConfigError: If no graph runs there, or it has no such stream.
    """
    graph = RunDocument.read(run_dir).graph
    for name in names:
        if name not in graph.names:
            raise ConfigError(unknown_stream("topic", name, graph.names))
    return {one.name: TOPICS[one.topic] for one in graph.named(*(names or graph.names))}


def unknown_stream(what: str, name: str, known: Collection[str]) -> str:
    """Return the message for a name of no stream: of several hands, those with this topic."""
    of_hands = [one for one in known if one.endswith(f"/{name}")]
    if of_hands:
        return f"whose {name}? It belongs to a hand: {' or '.join(of_hands)}"
    return unknown(what, name, known)


def packets_of(
    run_dir: Path, names: Collection[str], duration: float | None = None
) -> Iterator[Received]:
    """Give the packets of a running graph as they come, for ``duration`` s or until it ends."""
    end = math.inf if duration is None else time.monotonic() + duration

    def is_over() -> bool:
        return time.monotonic() >= end or not (run_dir / RUN_FILE).exists()

    run = RunDocument.read(run_dir)
    with Reader(run_dir, run.graph.named(*names), run.core) as reader:
        yield from reader.follow(is_over)


class Interval(Struct, frozen=True):
    """Times between packets."""

    min: float
    mean: float
    max: float
    deviation: float


class StreamFigures(Struct, frozen=True):
    """Figures of a topic."""

    packets: int
    rate_hz: float  # by the sender's time stamps; of several senders, by the measuring time
    interval_ms: Interval | None  # None: fewer than two packets, or several senders
    missing: int  # packets of which only the numbers show that they were sent
    bandwidth_b_per_s: float
    mean_size_b: float | None  # None: no packet


@dataclass
class Stream:
    """The packets of a topic: number and time (ns) of each, by sender, and their sizes (B)."""

    stamps: dict[str, list[tuple[int, int]]] = field(default_factory=dict)
    sizes: list[int] = field(default_factory=list)

    def add(self, packet: Packet, size: int) -> None:
        """Add a packet."""
        sender = packet.node if isinstance(packet, Event) else packet.hand
        self.stamps.setdefault(sender, []).append((packet.seq, packet.time_ns))
        self.sizes.append(size)

    def figures(self, duration: float) -> StreamFigures:
        """Return rate, intervals and sizes of what came in ``duration`` s."""
        count, interval = len(self.sizes), None
        rate, missing = count / duration, 0
        for stamps in self.stamps.values():
            seqs, times_ns = np.array(stamps).T
            missing += int(seqs.max() - seqs.min()) + 1 - len(set(seqs))
            gaps = np.diff(times_ns) * 1e-6
            if len(self.stamps) == 1 and gaps.sum() > 0.0:
                rate = 1e3 / float(gaps.mean())
                interval = Interval(*map(float, (gaps.min(), gaps.mean(), gaps.max(), gaps.std())))
        return StreamFigures(
            packets=count,
            rate_hz=rate,
            interval_ms=interval,
            missing=missing,
            bandwidth_b_per_s=sum(self.sizes) / duration,
            mean_size_b=sum(self.sizes) / count if count else None,
        )


def measure_streams(
    run_dir: Path, topics: Collection[str], duration: float
) -> dict[str, StreamFigures]:
    """Return the figures of topics of a running graph over ``duration`` s; none: of all.

    Raises:
        RunError: If the graph has ended, and sent nothing before.
    """
    streams = {name: Stream() for name in streams_of(run_dir, topics)}
    start = time.monotonic()
    for topic, packet, data in packets_of(run_dir, streams, duration):
        streams[topic].add(packet, len(data))
    watched = time.monotonic() - start
    if not (run_dir / RUN_FILE).exists() and not any(one.sizes for one in streams.values()):
        raise RunError(f"the graph in {run_dir} has ended")
    return {topic: stream.figures(watched) for topic, stream in streams.items()}


def check_fields(packet: type[Packet], names: Collection[str]) -> None:
    """Raise ConfigError if packets have no field of one of these names."""
    known = list(field_types(packet))
    for name in names:
        if name not in known:
            raise ConfigError(unknown(f"field of {TOPIC_OF[packet]}:", name, known))


def fields_of_packet(packet: Packet) -> dict[str, Any]:
    """Return the fields of a packet by name, as plain types."""
    fields = msgspec.to_builtins(packet).items()
    return {name: value for name, value in fields if name not in ("packet", "version")}
