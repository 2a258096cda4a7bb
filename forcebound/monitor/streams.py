"""Topics of a running graph, read from outside: packets, rates, sizes.

Rates are those of the senders' own time stamps, so a slow reader does not change them.
"""

import math
import time
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from msgspec import Struct

from forcebound.config.problems import unknown
from forcebound.errors import ConfigError, RunError
from forcebound.launch.run_directory import RUN_FILE, RunDocument
from forcebound.messages.packets import TOPICS, Event, Packet, field_types
from forcebound.monitor.runs import while_running
from forcebound.process import Reader, Received

DURATION = 2.0  # s, how long rates are measured


def topic_named(name: str) -> str:
    """Return a topic by its name.

    Raises:
        ConfigError: If there is none of that name.
    """
    if name not in TOPICS:
        raise ConfigError(unknown("topic", name, TOPICS))
    return name


def packets_of(
    run_dir: Path, topics: Collection[str], duration: float | None = None
) -> Iterator[Received]:
    """Give the packets of a running graph as they come, until the graph ends.

    Args:
        run_dir: Of the graph.
        topics: Of the packets.
        duration: Longest time, in s; None: no limit.

    Raises:
        ConfigError: If no graph runs there.
    """
    end = math.inf if duration is None else time.monotonic() + duration

    def is_over() -> bool:
        return time.monotonic() >= end or not (run_dir / RUN_FILE).exists()

    with while_running(run_dir):
        run = RunDocument.read(run_dir)
        reader = Reader(run_dir, run.graph.named(*topics), run.core)
    with reader:
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
    """What was seen of a topic.

    Attributes:
        seqs: Of its packets, by sender.
        times_ns: Time stamps of its packets, by sender, in ns.
        sizes: Of its packets, in B.
    """

    seqs: dict[str, list[int]] = field(default_factory=dict)
    times_ns: dict[str, list[int]] = field(default_factory=dict)
    sizes: list[int] = field(default_factory=list)

    def add(self, packet: Packet, size: int) -> None:
        """Add a packet."""
        sender = packet.node if isinstance(packet, Event) else ""
        self.seqs.setdefault(sender, []).append(packet.seq)
        self.times_ns.setdefault(sender, []).append(packet.time_ns)
        self.sizes.append(size)

    def figures(self, duration: float) -> StreamFigures:
        """Return rate, intervals and sizes of what came in ``duration`` s."""
        count = len(self.sizes)
        one = next(iter(self.times_ns.values())) if len(self.times_ns) == 1 else []
        gaps = np.diff(one) * 1e-6
        interval = None
        rate = count / duration
        if gaps.size and gaps.sum() > 0.0:
            rate = 1e3 / float(gaps.mean())
            interval = Interval(*map(float, (gaps.min(), gaps.mean(), gaps.max(), gaps.std())))
        expected = sum(max(seqs) - min(seqs) + 1 for seqs in self.seqs.values())
        return StreamFigures(
            packets=count,
            rate_hz=rate,
            interval_ms=interval,
            missing=expected - sum(len(set(seqs)) for seqs in self.seqs.values()),
            bandwidth_b_per_s=sum(self.sizes) / duration,
            mean_size_b=sum(self.sizes) / count if count else None,
        )


def measure_streams(
    run_dir: Path, topics: Sequence[str], duration: float = DURATION
) -> dict[str, StreamFigures]:
    """Return the figures of topics of a running graph, by topic.

    Raises:
        ConfigError: If no graph runs there.
        RunError: If the graph has ended, and sent nothing before.
    """
    streams = {topic: Stream() for topic in topics}
    start = time.monotonic()
    for topic, packet, data in packets_of(run_dir, topics, duration):
        streams[topic].add(packet, len(data))
    watched = time.monotonic() - start
    if not (run_dir / RUN_FILE).exists() and not any(one.sizes for one in streams.values()):
        raise RunError(f"the graph in {run_dir} has ended")
    return {topic: stream.figures(watched) for topic, stream in streams.items()}


def check_fields(topic: str, names: Collection[str]) -> None:
    """Check that packets of a topic have fields of these names.

    Raises:
        ConfigError: If one has not.
    """
    known = list(field_types(TOPICS[topic]))
    for name in names:
        if name not in known:
            raise ConfigError(unknown(f"field of {topic}:", name, known))


def fields_of_packet(packet: Packet) -> dict[str, Any]:
    """Return the fields of a packet by name, as plain types."""
    fields: dict[str, Any] = msgspec.to_builtins(packet)
    return {name: value for name, value in fields.items() if name not in ("packet", "version")}
