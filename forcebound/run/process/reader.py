"""Receiving every packet of some streams of a run, by a process that is no part of its loop.

A reader looks a hundred times a second and stays off the nodes' core, so that it costs the servo
nothing: waking for each packet would cost half a core.
"""

import os
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import NamedTuple, Self

from forcebound import realtime
from forcebound.errors import PacketError
from forcebound.messages.codec import decode
from forcebound.messages.packets import TOPICS, Packet
from forcebound.messages.topology import Stream, endpoint
from forcebound.network import sockets
from forcebound.network.sockets import Network

PERIOD_NS = 10_000_000  # between two looks


class Received(NamedTuple):
    """A packet that was received."""

    stream: str  # its name
    packet: Packet
    data: bytes  # its frame


class Reader:
    """Receives some streams of a run, off the core of its nodes; to be closed."""

    def __init__(self, run_dir: Path, streams: Iterable[Stream], core: int | None) -> None:
        self._cores = realtime.leave_core(core)
        self.network = Network()  # also for other sockets of this process
        self._subscribers = [
            (stream, self.network.subscriber(endpoint(run_dir, stream))) for stream in streams
        ]
        self.forget()

    def forget(self) -> None:
        """Drop what has come, and count from 0."""
        for _, subscriber in self._subscribers:
            while subscriber.receive():
                pass
        self.received = {stream.name: 0 for stream, _ in self._subscribers}
        self.rejected: dict[str, int] = {}  # frames that were no such packet, by reason

    def wait(self, *descriptors: int) -> None:
        """Sleep until the next look, or until one of some descriptors is readable."""
        sockets.wait(descriptors, PERIOD_NS)

    def take(self) -> Iterator[Received]:
        """Give the packets that have come since the last look; never waits."""
        for stream, subscriber in self._subscribers:
            for data in subscriber.receive():
                try:
                    packet = decode(data, TOPICS[stream.topic])
                except PacketError as error:
                    self.rejected[error.reason] = self.rejected.get(error.reason, 0) + 1
                else:
                    self.received[stream.name] += 1
                    yield Received(stream.name, packet, data)

    def follow(self, is_over: Callable[[], bool]) -> Iterator[Received]:
        """Give the packets as they come, until ``is_over``."""
        while not is_over():
            self.wait()
            yield from self.take()

    def close(self) -> None:
        """Close the sockets, and return to the cores of before."""
        self.network.close()
        os.sched_setaffinity(0, self._cores)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
