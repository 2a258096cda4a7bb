"""Bridges to PlotJuggler and Foxglove: topics of a running graph, in the form that each takes.

A bridge is a process of its own that only listens to the graph, off the nodes' core; nobody can
change anything through it. It is reached on loopback, and drops what the other program does not
take.

* *PlotJuggler*, ZMQ subscriber. A packet is a message of two frames: topic, and packet as JSON with
  ``timestamp``, in s since the epoch. Each number becomes a series, ``telemetry/position[0]``. The
  program also takes a third frame, with the time stamp, but frees the packet before it reads it:
  some arrive damaged. Source: PlotJuggler 3.17.1, plugin DataStreamZMQ (receiveLoop).
* *Foxglove*, WebSocket. Channels, schemas and messages are those of a recording. The server is that
  of Foxglove's SDK, without any capability.
"""

import json
import logging
import time
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import TypeAlias

import msgspec

from forcebound.errors import ConfigError
from forcebound.extras import needed
from forcebound.messages.packets import Packet, Telemetry
from forcebound.messages.topology import HAND
from forcebound.network.sockets import Network
from forcebound.observe.streams import fields_of_packet, packets_of, streams_of
from forcebound.recordings.schema import declared_axes, declared_signals, schema
from forcebound.run.run_directory import RunDocument

#: Called with topic, packet and its time since the epoch, in ns.
Send: TypeAlias = Callable[[str, Packet, int], None]
#: A schema of packets, by its keys.
Schema: TypeAlias = Mapping[str, object]
#: Opens a port on loopback for packets, with their schemas by topic.
Bridge: TypeAlias = Callable[[Mapping[str, Schema], int], AbstractContextManager[Send]]


def serve(
    bridge: Bridge,
    run: Path,
    topics: Collection[str],
    port: int,
    duration: float | None = None,
    say: Callable[[str], None] = lambda text: None,
) -> None:
    """Give topics (none: all) of a running graph to another program.

    For ``duration`` s (None: no limit), or until the graph ends. ``say`` is called with a line for
    people when the port of loopback is open.

    Raises:
        ConfigError: If there is no such topic, the port is in use, or a package is missing.
    """
    metadata = RunDocument.read(run).metadata
    declared, axes = declared_signals(metadata), declared_axes(metadata)
    streams = {
        name: schema(packet, declared.get(name), axes.get(name.rpartition("/")[0] or HAND, ()))
        for name, packet in streams_of(run, topics).items()
    }
    ahead_ns = time.time_ns() - time.monotonic_ns()
    with bridge(streams, port) as send:
        say(f"{', '.join(streams)} at port {port} of localhost; Ctrl-C ends it")
        for topic, packet, _ in packets_of(run, streams, duration):
            send(topic, packet, packet.time_ns + ahead_ns)


def telemetry_of(run: Path) -> tuple[str, ...]:
    """Return the topics of a running graph that are telemetry: one of each hand."""
    return tuple(name for name, packet in streams_of(run).items() if packet is Telemetry)


@contextmanager
def plotjuggler(streams: Mapping[str, Schema], port: int) -> Iterator[Send]:
    """Publish for PlotJuggler."""
    with Network() as network:
        publisher = network.publisher(f"tcp://127.0.0.1:{port}")
        yield lambda *packet: publisher.send_frames(frames(*packet))


def frames(topic: str, packet: Packet, at_ns: int) -> tuple[bytes, bytes]:
    """Return the frames of a packet for PlotJuggler; arguments as of :data:`Send`.

    A field without a value, or a number that is not finite, becomes null.
    """
    stamped = {**fields_of_packet(packet), "timestamp": at_ns * 1e-9}
    return topic.encode(), msgspec.json.encode(stamped)


@contextmanager
def foxglove(streams: Mapping[str, Schema], port: int) -> Iterator[Send]:
    """Serve Foxglove."""
    sdk = needed("this bridge", "foxglove")
    # It calls each packet an error that a closed window no longer takes: thousands of lines.
    logging.getLogger("foxglove.websocket.connected_client.poller").setLevel(logging.CRITICAL)
    context = sdk.Context()
    channels = {}
    for topic, form in streams.items():
        data = json.dumps(form).encode()
        described = sdk.Schema(name=str(form["title"]), encoding="jsonschema", data=data)
        channels[topic] = sdk.Channel(
            f"/{topic}", schema=described, message_encoding="json", context=context
        )
    try:
        server = sdk.start_server(name="forcebound", port=port, context=context)
    except (OSError, RuntimeError) as error:
        words = f"cannot serve Foxglove at port {port} ({error}): choose another with --port"
        raise ConfigError(words) from error

    def send(topic: str, packet: Packet, at_ns: int) -> None:
        present = {k: v for k, v in fields_of_packet(packet).items() if v is not None}
        channels[topic].log(msgspec.json.encode(present), log_time=at_ns)

    try:
        yield send
    finally:
        server.stop()
