"""A bridge to PlotJuggler: topics of a running graph, in the form of its ZMQ subscriber.

Each packet is a message of three frames: topic, packet as JSON, time stamp in s since the epoch as
text. PlotJuggler makes a series of each number, ``telemetry/position[0]``. The bridge is a process
of its own that only listens to the graph, off the nodes' core, and answers nobody; it listens on
loopback, and drops what PlotJuggler does not take.

Source: PlotJuggler, plugin DataStreamZMQ (receiveLoop), read in version 3.
"""

import time
from collections.abc import Collection
from pathlib import Path

import msgspec

from forcebound.messages.packets import Packet
from forcebound.monitor.streams import fields_of_packet, read_topics
from forcebound.network.sockets import Network

PLOTJUGGLER_PORT = 9872  # that its dialog proposes


def serve_plotjuggler(
    run_dir: Path,
    topics: Collection[str],
    port: int = PLOTJUGGLER_PORT,
    duration: float | None = None,
) -> None:
    """Publish topics of a running graph for PlotJuggler, until the graph ends.

    Args:
        run_dir: Of the graph.
        topics: Of the packets.
        port: On loopback.
        duration: Longest time, in s; None: no limit.

    Raises:
        ConfigError: If no graph runs there, or the port is in use.
    """
    ahead_ns = time.time_ns() - time.monotonic_ns()
    with Network() as network:
        publisher = network.publisher(f"tcp://127.0.0.1:{port}")

        def take(topic: str, packet: Packet, data: bytes) -> bool:
            publisher.send_frames(frames(topic, packet, ahead_ns))
            return True

        read_topics(run_dir, topics, take, duration)


def frames(topic: str, packet: Packet, ahead_ns: int) -> tuple[bytes, bytes, bytes]:
    """Return the frames of a packet for PlotJuggler.

    Args:
        topic: Of the packet.
        packet: A field without a value, or a number that is not finite, becomes null.
        ahead_ns: Time since the epoch minus the sender's clock, in ns.
    """
    stamp = (packet.time_ns + ahead_ns) * 1e-9
    return topic.encode(), msgspec.json.encode(fields_of_packet(packet)), f"{stamp:.6f}".encode()
