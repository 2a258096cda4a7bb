"""Topics of a running graph, read from outside: packets, rates, sizes.

A reader looks a hundred times a second and stays off the nodes' core, so that it costs the servo
nothing. Rates are those of the senders' own time stamps, so a slow reader does not change them.
"""

import os
import time
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from forcebound import realtime
from forcebound.config.problems import unknown
from forcebound.errors import ConfigError, PacketError, RunError
from forcebound.launch.run_directory import RUN_FILE, RunDocument, recorded_streams
from forcebound.messages.codec import decode
from forcebound.messages.packets import TOPICS, Event, Packet, field_types
from forcebound.monitor.runs import while_running
from forcebound.network import sockets
from forcebound.network.sockets import Network

DURATION = 2.0  # s, how long rates are measured
PERIOD_NS = 10_000_000  # of looking: waking for each packet would disturb the graph

#: Called with topic, packet and its bytes; returns whether to go on.
Take = Callable[[str, Packet, bytes], bool]


def topic_named(name: str) -> str:
    """Return a topic by its name.

    Raises:
        ConfigError: If there is none of that name.
    """
    if name not in TOPICS:
        raise ConfigError(unknown("topic", name, TOPICS))
    return name


def read_topics(
    run_dir: Path, topics: Collection[str], take: Take, duration: float | None = None
) -> None:
    """Give packets of a running graph to ``take`` until it says no, or the graph ends.

    Args:
        run_dir: Of the graph.
        topics: Of the packets.
        take: What cannot be decoded never gets there.
        duration: Longest time, in s; None: no limit.

    Raises:
        ConfigError: If no graph runs there.
    """
    with while_running(run_dir), _aside(RunDocument.read(run_dir).core), Network() as network:
        streams = [
            (topic, network.subscriber(endpoint, newest_only=False))
            for topic, endpoint in recorded_streams(run_dir, tuple(topics))
            if topic in topics
        ]
        end = None if duration is None else time.monotonic() + duration
        while (end is None or time.monotonic() < end) and (run_dir / RUN_FILE).exists():
            sockets.wait((), PERIOD_NS)
            for topic, subscriber in streams:
                for data in subscriber.receive():
                    packet = _decoded(data, topic)
                    if packet is not None and not take(topic, packet, data):
                        return


@contextmanager
def _aside(core: int | None) -> Iterator[None]:
    """Stay off the core of the nodes."""
    cores = realtime.leave_core(core)
    try:
        yield
    finally:
        os.sched_setaffinity(0, cores)


def _decoded(data: bytes, topic: str) -> Packet | None:
    try:
        return decode(data, TOPICS[topic].packet)
    except PacketError:
        return None  # a reader is no part of the graph, which counts such packets itself


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

    def figures(self, duration: float) -> dict[str, Any]:
        """Return rate, intervals and sizes, fit for JSON.

        ``packets``; ``rate_hz`` (by the senders' time stamps; of topics that are not regular, by
        ``duration``, in s); ``interval_ms`` with ``min``, ``mean``, ``max`` and ``deviation`` (None
        with fewer than two packets); ``missing``: packets of which only the numbers show that they
        were sent; ``bandwidth_b_per_s`` and ``mean_size_b`` (None without packets).
        """
        count = len(self.sizes)
        one = next(iter(self.times_ns.values())) if len(self.times_ns) == 1 else []
        gaps = np.diff(one) * 1e-6
        interval = None
        rate = count / duration
        if gaps.size and gaps.sum() > 0.0:
            rate = 1e3 / float(gaps.mean())
            names = ("min", "mean", "max", "deviation")
            values = (gaps.min(), gaps.mean(), gaps.max(), gaps.std())
            interval = {name: float(value) for name, value in zip(names, values, strict=True)}
        expected = sum(max(seqs) - min(seqs) + 1 for seqs in self.seqs.values())
        return {
            "packets": count,
            "rate_hz": rate,
            "interval_ms": interval,
            "missing": expected - sum(len(set(seqs)) for seqs in self.seqs.values()),
            "bandwidth_b_per_s": sum(self.sizes) / duration,
            "mean_size_b": sum(self.sizes) / count if count else None,
        }


def measure_streams(
    run_dir: Path, topics: Sequence[str], duration: float = DURATION
) -> dict[str, dict[str, Any]]:
    """Return the figures of topics of a running graph, by topic; see :meth:`Stream.figures`.

    Raises:
        ConfigError: If no graph runs there.
        RunError: If the graph has ended meanwhile, and sent nothing before.
    """
    streams = {topic: Stream() for topic in topics}

    def take(topic: str, packet: Packet, data: bytes) -> bool:
        streams[topic].add(packet, len(data))
        return True

    start = time.monotonic()
    read_topics(run_dir, topics, take, duration)
    watched = time.monotonic() - start
    if not (run_dir / RUN_FILE).exists() and not any(one.sizes for one in streams.values()):
        raise RunError(f"the graph in {run_dir} has ended meanwhile")
    return {topic: stream.figures(watched) for topic, stream in streams.items()}


def check_fields(topic: str, names: Collection[str]) -> None:
    """Check that packets of a topic have fields of these names.

    Raises:
        ConfigError: If one has not.
    """
    known = list(field_types(TOPICS[topic].packet))
    for name in names:
        if name not in known:
            raise ConfigError(unknown(f"field of {topic}:", name, known))


def fields_of_packet(packet: Packet) -> dict[str, Any]:
    """Return the fields of a packet by name, as plain types."""
    fields: dict[str, Any] = msgspec.to_builtins(packet)
    return {name: value for name, value in fields.items() if name not in ("packet", "version")}
