"""What pages see of a running graph: samples, contacts, the scene, events.

The graph is looked at some thirty times a second; each frame has all samples since the last one.
"""

import math
import os
import time
from collections.abc import Iterable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import msgspec

from forcebound import realtime
from forcebound.errors import ConfigError, PacketError
from forcebound.launch.run_directory import RunDocument, recorded_streams
from forcebound.messages.codec import decode
from forcebound.messages.packets import TOPICS, EnvironmentReply, Event, Packet, Scene, Telemetry
from forcebound.network.sockets import Network
from forcebound.view.scene_files import content

SHOWN = ("telemetry", "environment_reply", "scene", "event")
SAMPLES = {
    "position": "position",
    "commanded": "commanded_force",
    "applied": "applied_force",
    "limit": "force_limit",
    "energy": "estimated_energy",
}


class Feed:
    """The streams of a running graph; to be closed.

    Args:
        run_dir: Of the graph.
        energy_before: Of its device's status: the true energy counts from there.
    """

    def __init__(self, run_dir: Path, energy_before: float) -> None:
        self._cores = realtime.leave_core(RunDocument.read(run_dir).core)  # looking disturbs nobody
        self._network = Network()
        self._streams = [
            (TOPICS[topic].packet, self._network.subscriber(endpoint, newest_only=False))
            for topic, endpoint in recorded_streams(run_dir, SHOWN)
        ]
        self._ahead_ns = time.time_ns() - time.monotonic_ns()
        self.scene: dict[str, Any] | None = None  # the newest
        self._began = 0, energy_before, 0.0  # the law: when, in ns, true energy then, of the former

    def look(self) -> list[dict[str, Any]]:
        """Return the messages to the pages about what has come since the last look."""
        samples: list[Telemetry] = []
        messages: list[dict[str, Any]] = []
        contact: EnvironmentReply | None = None
        for packet in self._received():
            if isinstance(packet, Telemetry):
                samples.append(packet)
            elif isinstance(packet, EnvironmentReply):
                contact = packet
            elif isinstance(packet, Scene):
                self.scene = {"type": "scene", **_plain(packet)}
                messages.append(self.scene)
            elif isinstance(packet, Event):
                messages.append(self._event(packet))
        if samples:
            frame = _frame(samples, contact)
            frame["true_energy"] = [self._energy_under_law(sample) for sample in samples]
            messages.append(frame)
        return messages

    def file(self, digest: str) -> dict[str, Any] | None:
        """Return what a file of the scene has to draw, as :func:`content`; None: it is not here.

        It may take seconds.
        """
        for thing in (self.scene or {}).get("objects", ()):
            if thing.get("digest") == digest and thing.get("file"):
                with suppress(ConfigError):
                    return content(thing)
        return None

    def close(self) -> None:
        """Close the streams."""
        self._network.close()
        os.sched_setaffinity(0, self._cores)

    def _received(self) -> Iterable[Packet]:
        for kind, subscriber in self._streams:
            for data in subscriber.receive():
                try:
                    yield decode(data, kind)
                except PacketError:
                    continue  # the graph counts such packets itself

    def _energy_under_law(self, sample: Telemetry) -> float | None:
        """Return the true energy since the law of a sample began, in J."""
        if sample.elapsed == 0.0:  # a device has started
            self._began = 0, 0.0, 0.0
        if sample.true_energy is None:
            return None
        since_ns, now, former = self._began
        energy = sample.true_energy - (now if sample.time_ns > since_ns else former)
        return energy if math.isfinite(energy) else None  # JSON has no other

    def _event(self, event: Event) -> dict[str, Any]:
        if "energy_before" in event.data:
            self._began = event.time_ns, float(event.data["energy_before"]), self._began[1]
        at = (event.time_ns + self._ahead_ns) * 1e-9
        return {
            "type": "event",
            "time": at,
            "node": event.node,
            "event": event.event,
            "data": event.data,
            "is_fault": event.is_fault,
            "message": event.message,
        }


def _frame(samples: Sequence[Telemetry], contact: EnvironmentReply | None) -> dict[str, Any]:
    frame: dict[str, Any] = {
        "type": "frame",
        "time": [sample.time_ns * 1e-9 for sample in samples],
        "delay": [sample.loop_delay for sample in samples],
        "reply_age": [sample.reply_age for sample in samples],
        "engagement": samples[-1].engagement,
        "misses": samples[-1].deadline_misses,
        "tip": samples[-1].true_position or samples[-1].position,
        "proxy": None if contact is None else contact.proxy,
    }
    for name, field in SAMPLES.items():
        frame[name] = [_finite(getattr(sample, field)) for sample in samples]
    return frame


def _finite(value: Any) -> Any:
    """A value that JSON can have."""
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def _plain(packet: Packet) -> dict[str, Any]:
    fields: dict[str, Any] = msgspec.to_builtins(packet)
    return {name: value for name, value in fields.items() if name not in ("packet", "version")}
