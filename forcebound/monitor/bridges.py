"""Bridges to PlotJuggler and Foxglove: topics of a running graph, in the form that each takes.

A bridge is a process of its own that only listens to the graph, off the nodes' core; nobody can
change anything through it. It is reached on loopback, and drops what the other program does not
take.

* *PlotJuggler*, ZMQ subscriber. A packet is a message of three frames: topic, packet as JSON, time
  stamp in s since the epoch as text. Each number becomes a series, ``telemetry/position[0]``.
  Source: PlotJuggler, plugin DataStreamZMQ (receiveLoop), read in version 3.
* *Foxglove*, WebSocket. Channels, schemas and messages are those of a recording. The server is that
  of Foxglove's SDK, without any capability.
"""

import json
import time
from collections.abc import Collection
from pathlib import Path

import msgspec

from forcebound.errors import ConfigError
from forcebound.messages.packets import TOPICS, Packet
from forcebound.monitor.streams import fields_of_packet, read_topics
from forcebound.network.sockets import Network
from forcebound.recording_schema import schema


def serve_plotjuggler(
    run_dir: Path,
    topics: Collection[str],
    port: int,
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


def serve_foxglove(
    run_dir: Path, topics: Collection[str], port: int, duration: float | None = None
) -> None:
    """Serve topics of a running graph to Foxglove, until the graph ends.

    Args:
        run_dir: Of the graph.
        topics: Of the packets.
        port: On loopback.
        duration: Longest time, in s; None: no limit.

    Raises:
        ConfigError: If no graph runs there, the port is in use, or Foxglove's SDK is missing.
    """
    try:
        import foxglove
    except ImportError as missing:
        needed = "this bridge needs Foxglove's SDK: pip install 'forcebound[foxglove]'"
        raise ConfigError(needed) from missing
    context = foxglove.Context()
    channels = {}
    for topic in topics:
        packet = TOPICS[topic].packet
        described = foxglove.Schema(
            name=f"forcebound.{packet.__name__}",
            encoding="jsonschema",
            data=json.dumps(schema(packet)).encode(),
        )
        channels[topic] = foxglove.Channel(
            f"/{topic}", schema=described, message_encoding="json", context=context
        )
    try:
        server = foxglove.start_server(name="forcebound", port=port, context=context)
    except (OSError, RuntimeError) as error:
        raise ConfigError(f"cannot serve Foxglove at port {port}: {error}") from error
    ahead_ns = time.time_ns() - time.monotonic_ns()

    def take(topic: str, packet: Packet, data: bytes) -> bool:
        present = {k: v for k, v in fields_of_packet(packet).items() if v is not None}
        channels[topic].log(msgspec.json.encode(present), log_time=packet.time_ns + ahead_ns)
        return True

    try:
        read_topics(run_dir, topics, take, duration)
    finally:
        server.stop()
