"""What pages see of a running graph: samples, signals, contacts, the scene, events.

The graph is looked at some thirty times a second; each frame has all samples since the last one.
"""

import math
import time
from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import msgspec

from forcebound.errors import ConfigError
from forcebound.messages.packets import (
    TOPIC_OF,
    DeviceState,
    EnvironmentReply,
    Event,
    ForceCommand,
    Packet,
    Scene,
    SceneObject,
    Telemetry,
)
from forcebound.messages.topology import HAND, node_name
from forcebound.observe.page.reason import Recent
from forcebound.observe.page.scene_files import content
from forcebound.observe.page.state import LiveState
from forcebound.observe.streams import fields_of_packet
from forcebound.recordings.schema import declared_signals
from forcebound.run.process.reader import Reader
from forcebound.run.run_directory import RunDocument

#: To or from the pages, as JSON.
Message: TypeAlias = dict[str, Any]

RECENT = 5000  # samples from which the cause of little force is judged
SHOWN = ("telemetry", "environment_reply", "scene", "event")
SAMPLES = {
    "position": "position",
    "commanded": "commanded_force",
    "applied": "applied_force",
    "limit": "force_limit",
    "energy": "estimated_energy",
}


class _LawStart(NamedTuple):
    """The beginning of a law."""

    time_ns: int
    energy: float  # J, true energy then
    previous_energy: float  # J, that of the law before
    name: str = ""


class Feed:
    """The streams of a running graph, the true energy of each hand from ``energies``; to be closed.

    ``energies`` are those before the law in use, in J, by hand.
    """

    def __init__(self, run_dir: Path, energies: Mapping[str, float]) -> None:
        run = RunDocument.read(run_dir)
        declared = declared_signals(run.metadata)
        #: Meanings of the signals, by name after that of their stream.
        self.signals = {
            f"{t}.{n}": about for t, own in declared.items() for n, about in own.items()
        }
        streams = [
            one
            for one in run.graph.streams
            if (one.topic in SHOWN or one.name in declared) and one.hand in (None, *energies)
        ]
        self._reader = Reader(run_dir, streams, run.core)
        self._hand_of = {one.name: one.hand for one in streams}
        self._nodes = run.graph.nodes
        self.hands = {
            hand: HandFeed(energy, self.signals_of(hand), hand) for hand, energy in energies.items()
        }
        self._ahead_ns = time.time_ns() - time.monotonic_ns()
        self.scene: Message | None = None  # the newest
        self.is_answered = False  # by the environment, ever

    def signals_of(self, hand: str) -> list[str]:
        """Return the names of the signals that belong to a hand."""
        return [name for name in self.signals if (name.rpartition("/")[0] or HAND) == hand]

    def look(self, keep: int = 1) -> list[Message]:
        """Return the messages to the pages about what has come since the last look.

        A frame of a hand has one of ``keep`` samples, counted back from the newest.
        """
        messages: list[Message] = []
        for stream, packet, _ in self._reader.take():
            hand = self._hand_of[stream]
            if hand is not None:
                self.is_answered = self.is_answered or isinstance(packet, EnvironmentReply)
                self.hands[hand].take(packet)
            elif isinstance(packet, Scene):
                self.scene = {"type": "scene", **fields_of_packet(packet)}
                messages.append(self.scene)
            elif isinstance(packet, Event):
                messages.append(self._event(packet))
        frames = (hand.frame(keep) for hand in self.hands.values())
        return messages + [frame for frame in frames if frame is not None]

    def foresee(self, objects: Sequence[SceneObject]) -> Message | None:
        """Take what the environment will show; return the message, None: it shows it already."""
        if self.scene is not None or not objects:
            return None
        self.scene = {"type": "scene", "objects": msgspec.to_builtins(objects)}
        return self.scene

    def file(self, digest: str) -> Message | None:
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
        self._reader.close()

    def _event(self, event: Event) -> Message:
        sender = self._nodes.get(event.node)
        hand = HAND if sender is None else sender.hand or HAND
        if "energy_before" in event.data:
            energy = float(event.data["energy_before"])
            self.hands[hand].begin_law(event.time_ns, energy, str(event.data.get("law", "")))
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


class HandFeed:
    """What comes from the loop of one hand."""

    def __init__(self, energy_before: float, signals: Iterable[str], hand: str = HAND) -> None:
        self._hand = hand
        self.state = LiveState()
        self._samples: list[Telemetry] = []  # since the last look
        self._contact: EnvironmentReply | None = None  # the newest since then
        self._held: dict[str, float | None] = dict.fromkeys(signals)
        self._published: dict[int, dict[str, float | None]] = {}  # by the tick that they answer
        self._law = _LawStart(0, energy_before, 0.0)
        self._recent: deque[Telemetry] = deque(maxlen=RECENT)
        self._replies: deque[EnvironmentReply] = deque(maxlen=RECENT)

    @property
    def recent(self) -> Recent:
        """The newest packets, from which the cause of little force is judged."""
        return tuple(self._recent), tuple(self._replies)

    def take(self, packet: Packet) -> None:
        """Take a packet in."""
        if isinstance(packet, Telemetry):
            self._samples.append(packet)
        elif isinstance(packet, DeviceState | ForceCommand | EnvironmentReply):
            if isinstance(packet, EnvironmentReply):
                self._contact = packet
                self._replies.append(packet)
            if self._held:
                self._take_signals(packet)

    def begin_law(self, time_ns: int, energy: float, name: str) -> None:
        """Count the energy from another law on, before which the true energy was ``energy``, J."""
        self._law = _LawStart(time_ns, energy, self._law.energy, name)
        self.state.begin(name)
        self._recent.clear()
        self._replies.clear()

    def frame(self, keep: int) -> Message | None:
        """Return the frame of what has come since the last one; None: no sample has."""
        samples, self._samples = self._samples, []
        contact, self._contact = self._contact, None
        if not samples:
            return None
        energies = [self._energy_under_law(sample) for sample in samples]
        before = sum(sample.time_ns <= self._law.time_ns for sample in samples)
        self._recent.extend(samples[before:])
        self.state.take(samples[before:], energies[before:])
        kept = slice((len(samples) - 1) % keep, None, keep)
        signals = self._signals_at(samples)
        return _frame(samples[kept], contact) | {
            "hand": self._hand,
            "true_energy": energies[kept],
            "signals": {name: curve[kept] for name, curve in signals.items()},
            "since": self._law.time_ns * 1e-9,
            "law": self._law.name,
        }

    def _take_signals(self, packet: DeviceState | ForceCommand | EnvironmentReply) -> None:
        tick = packet.seq if isinstance(packet, DeviceState) else packet.device_seq
        topic, numbers = TOPIC_OF[type(packet)], packet.signals or {}
        stream = f"{node_name(self._hand, topic)}."
        own = [name for name in self._held if name.startswith(stream)]
        values = {name: _finite(numbers.get(name.removeprefix(stream))) for name in own}
        self._published.setdefault(tick, {}).update(values)

    def _signals_at(self, samples: Sequence[Telemetry]) -> dict[str, list[float | None]]:
        """Return the signals at some samples, each held from the sample that uses its packet on."""
        curves: dict[str, list[float | None]] = {name: [] for name in self._held}
        for sample in samples:
            for tick in (sample.device_seq, sample.seq):
                self._held |= self._published.pop(-1 if tick is None else tick, {})
            for name, curve in curves.items():
                curve.append(self._held[name])
        newest = samples[-1].seq if samples[-1].device_seq is None else samples[-1].device_seq
        for tick in sorted(tick for tick in self._published if tick < newest):
            self._held |= self._published.pop(tick)  # late, or overtaken: from now on
        return curves

    def _energy_under_law(self, sample: Telemetry) -> float | None:
        """Return the true energy since the law of a sample began, in J."""
        if sample.elapsed == 0.0:  # a device has started
            self._law = _LawStart(0, 0.0, 0.0)
            self.state.begin("")
        if sample.true_energy is None:
            return None
        law = self._law
        is_new = sample.time_ns > law.time_ns
        energy = sample.true_energy - (law.energy if is_new else law.previous_energy)
        return energy if math.isfinite(energy) else None  # JSON has no other


def request_of(text: str | bytes) -> Message | None:
    """Return what a page asks for; None: it is no JSON, or asks for nothing.

    JSON has neither NaN nor half a surrogate pair, which Python's own reader lets through.
    """
    with suppress(msgspec.DecodeError, RecursionError):
        request = msgspec.json.decode(text, type=Message)
        return request if isinstance(request.get("do"), str) else None
    return None


def _frame(samples: Sequence[Telemetry], contact: EnvironmentReply | None) -> Message:
    frame: Message = {
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
    """Return a value that JSON can have."""
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
