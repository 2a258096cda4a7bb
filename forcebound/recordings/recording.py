"""Recordings: an MCAP file of every packet of a run, and its reader.

One channel per name of a stream (``/device_state``, ``/left/device_state`` ...), JSON messages, and
a jsonschema with units for each, so that a recording opens in Foxglove and PlotJuggler. A metadata
record ``forcebound`` holds the resolved launch file, the versions and the seed as text.

* **A killed recorder loses only the packets after the last** :meth:`Recorder.flush`. MCAP collects
  messages in compressed chunks, and a chunk is in the file only when it is finished; ``flush``
  finishes it. Such a file has no footer: :func:`read` returns its readable part with
  :attr:`Recording.complete` false.
* **The same calls give the same bytes**: no date, path or host is written. A flush ends a chunk, so
  it counts as one of the calls.
* **The schemas use one type per field** (:mod:`forcebound.recordings.schema`). So a field without
  a value (``None``) is left out of its message; a number that is not finite, which JSON cannot
  express, becomes ``null`` and is read back as NaN.
"""

import json
import math
from collections import deque
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import AbstractContextManager
from functools import cache, cached_property, partial
from operator import attrgetter
from os import PathLike
from pathlib import Path
from typing import Any, get_args

import msgspec
from mcap.records import Metadata
from mcap.writer import Writer
from msgspec.json import Encoder

from forcebound import mcap_file
from forcebound.errors import ConfigError
from forcebound.mcap_file import METADATA_NAME
from forcebound.messages.codec import plain
from forcebound.messages.events import is_of
from forcebound.messages.packets import (
    TOPIC_OF,
    TOPICS,
    EnvironmentReply,
    Event,
    Packet,
    Scene,
    Telemetry,
    field_types,
)
from forcebound.messages.topology import (
    HAND,
    HANDS,
    HERE,
    ONE_HAND,
    Document,
    Graph,
    Stream,
    flat,
    nested,
    node_name,
)
from forcebound.recordings.clock import CLOCK_END
from forcebound.recordings.launched import Launched
from forcebound.recordings.schema import (
    ABSENT,
    DeclaredSignals,
    declared_axes,
    declared_signals,
    schema,
)
from forcebound.recordings.telemetry import TelemetryCollector, TelemetryColumns

OF_ALL = (TOPIC_OF[Scene], TOPIC_OF[Event])  # topics that belong to no hand

ENERGY_BEFORE = "energy_before"  # key of the metadata, and of the status of a device

_encode = Encoder(enc_hook=plain).encode  # a number that is not finite becomes null
_decode = msgspec.json.Decoder(dict[str, Any]).decode


class Recorder(AbstractContextManager["Recorder"]):
    """Writes packets to an MCAP file; a context manager.

    Args:
        path: The file to write; replaced if it exists.
        metadata: Texts by key, for example the resolved launch file, the versions, the seed.
        clock_offset_ns: Added to a packet's ``time_ns`` to give its log time, in ns. A live run
            passes wall clock minus monotonic clock at its start, virtual time 0.
        graph: Whose streams are recorded.

    Raises:
        ConfigError: If the file cannot be created.
    """

    def __init__(
        self,
        path: str | PathLike[str],
        metadata: Mapping[str, str],
        clock_offset_ns: int = 0,
        graph: Graph = ONE_HAND,
    ) -> None:
        try:
            self._file = Path(path).open("wb")  # noqa: SIM115 - open until close()
        except OSError as error:
            raise ConfigError(f"cannot write the recording {path}: {error.strerror}") from error
        self._clock_offset_ns = clock_offset_ns
        # Any: mcap leaves most of its methods unannotated, and strict checking refuses their calls.
        self._writer: Any = Writer(self._file)
        self._writer.start(profile="", library="forcebound")
        self._writer.add_metadata(METADATA_NAME, dict(sorted(metadata.items())))
        self._signals, self._axes = declared_signals(metadata), declared_axes(metadata)
        # All topics from the start: the file does not depend on which packet happens to come first.
        self._channels = {
            (TOPICS[stream.topic], stream.hand or HAND): self._register(stream)
            for stream in {each.name: each for each in graph.streams}.values()
        }
        self.flush()

    def _register(
        self, stream: Stream
    ) -> tuple[int, tuple[str, ...], Callable[[Packet], tuple[Any, ...]]]:
        packet = TOPICS[stream.topic]
        axes = self._axes.get(stream.hand or HAND, ()) if stream.topic not in OF_ALL else ()
        described = schema(packet, self._signals.get(stream.name), axes)
        schema_id = self._writer.register_schema(
            f"forcebound.{packet.__name__}", "jsonschema", json.dumps(described).encode()
        )
        channel = self._writer.register_channel(f"/{stream.name}", "json", schema_id)
        # Of an only hand the field is left out, as a reader supplies it.
        is_only = stream.hand in (None, HAND)
        names = tuple(name for name in field_types(packet) if not (is_only and name == "hand"))
        return channel, names, attrgetter(*names)

    def write(self, packet: Packet) -> None:
        """Record one packet; in the file after the next :meth:`flush` or a full chunk (1 MiB)."""
        channel, names, values_of = self._channels[type(packet), packet.hand]
        document = {
            name: value
            for name, value in zip(names, values_of(packet), strict=True)
            if value is not None and value != "" and value is not msgspec.UNSET
        }
        log_time = packet.time_ns + self._clock_offset_ns
        # The sequence of an MCAP message has 32 bits; the packet's own is in the message.
        self._writer.add_message(
            channel, log_time, _encode(document), log_time, packet.seq & 0xFFFF_FFFF
        )

    def flush(self) -> None:
        """Finish the chunk and hand it to the operating system.

        It then survives the death of this process, though not that of the machine (no ``fsync``).
        """
        self._writer.flush()

    def close(self, clock_end: Mapping[str, str] | None = None) -> None:
        """Write index and footer and close the file; a second call does nothing.

        ``clock_end`` has the ``UTC_OFFSET`` of a live run at its end.
        """
        if not self._file.closed:
            with self._file:
                if clock_end is not None:
                    self._writer.add_metadata(CLOCK_END, clock_end)
                self._writer.finish()

    def abandon(self) -> None:
        """Close the file without index and footer, so that it reads as incomplete."""
        self._file.close()

    def __exit__(self, *error: object) -> None:
        self.close()


class Recording:
    """A recording, which is read from its file as it is asked for; the file stays as it is.

    It gives one hand's packets, beside what belongs to all. Of several hands one is to be chosen.

    Attributes:
        path: Its file.
        metadata: Texts by key, as given to the :class:`Recorder`.
        hands: Names of the hands that it records; ``hand``, if the file has no ``hands``.
    """

    def __init__(
        self,
        path: Path,
        metadata: dict[str, str],
        topics: Collection[str] = tuple(TOPICS),
        hand: str | None = None,
    ) -> None:
        self.path = path
        self.metadata = metadata
        self._topics = topics
        document = self._document
        here = document[HERE] if HERE in document else document[HANDS]
        self.hands = tuple(hand for hand in document[HANDS] if hand in here)
        if hand is not None and hand not in self.hands:
            raise ConfigError(f"{path} has no hand {hand!r}; it has {', '.join(self.hands)}")
        self._hand = self.hands[0] if hand is None and len(self.hands) == 1 else hand
        self._complete: bool | None = None  # known when it was read to its end

    @property
    def by_hand(self) -> "dict[str, Recording]":
        """Recordings of the hand that was chosen, or of each, by its name."""
        if self._hand is not None:
            return {self._hand: self}
        of = partial(Recording, self.path, self.metadata, self._topics)
        return {hand: of(hand) for hand in self.hands}

    @property
    def complete(self) -> bool:
        """False if the recorder was killed, or the file was cut or damaged.

        It then holds the packets up to that point.
        """
        if self._complete is None:
            deque(self._messages(()), maxlen=0)
        return bool(self._complete)

    def packets(self, topic: str) -> list[Packet]:
        """Return the packets of a topic, in the order of recording.

        ``"telemetry"`` for example; of several hands also by the name of the channel,
        ``"leader/telemetry"``.

        Raises:
            ConfigError: As :meth:`stream`, and if there is no such hand.
        """
        hand, _, own = topic.lstrip("/").rpartition("/")
        of = self.by_hand.get(hand)
        return list(self.stream(topic) if of is None else of.stream(own))

    def stream(self, *topics: str) -> Iterator[Packet]:
        """Yield the packets of some topics, one by one: of a long run there are millions.

        Raises:
            ConfigError: If there is no such topic, or a message lacks a field of its packet.
        """
        for topic in topics:
            if topic not in TOPICS:
                raise ConfigError(f"no topic {topic!r}; there are {', '.join(TOPICS)}")
        for _, packet in self._decoded(topics):
            yield packet

    @cached_property
    def run(self) -> tuple[TelemetryColumns, list[Event]]:
        """The telemetry as columns, and the events, read in one go.

        With the contacts if the environment's replies were asked for.

        Raises:
            ConfigError: If the recording holds no telemetry, or the number of axes changes in it.
        """
        collector = TelemetryCollector()
        events: list[Event] = []

        def take_event(event: Event) -> None:
            if is_of(event, self.hand):
                events.append(event)

        takers: dict[str, Callable[[Any], None]] = {
            TOPIC_OF[Telemetry]: collector.take,
            TOPIC_OF[EnvironmentReply]: collector.take_reply,
            TOPIC_OF[Event]: take_event,
        }
        for topic, packet in self._decoded(takers):
            takers[topic](packet)
        if not collector:
            why = "did the run end before its device node started?"
            if not self.complete:
                why = "it was cut or damaged before the first"
            raise ConfigError(f"{self.path} has no telemetry: {why}")
        try:
            return collector.columns(), events
        except ValueError as error:
            raise ConfigError(f"{self.path}: its {error}") from error

    @property
    def telemetry(self) -> TelemetryColumns:
        """The columns of :attr:`run`."""
        return self.run[0]

    def _decoded(self, topics: Collection[str]) -> Iterator[tuple[str, Packet]]:
        """Yield topic and packet, of those of these topics that were asked for."""
        names = {self._stream(topic): topic for topic in topics if topic in self._topics}
        for name, data in self._messages(names):
            topic = names[name]
            try:
                packet = _decoder(TOPICS[topic])(data)
            except (msgspec.MsgspecError, ValueError, RecursionError) as error:
                raise ConfigError(
                    f"{self.path}: a message of {topic} does not match the packet of this version "
                    f"({error}); recorded by another version?"
                ) from error
            yield topic, packet

    def _stream(self, topic: str) -> str:
        """The name of the stream with this hand's packets of a topic."""
        return topic if topic in OF_ALL else node_name(self.hand, topic)

    def _messages(self, topics: Collection[str]) -> Iterator[tuple[str, bytes]]:
        """Yield stream and data of each message until the end, or the damage; note which it was."""
        try:
            for content in mcap_file.contents(self.path, topics):
                if isinstance(content, tuple):
                    yield content
            self._complete = True
        except mcap_file.DamagedError:
            self._complete = False  # what came before the damage is good

    @property
    def hand(self) -> str:
        """The hand whose packets it gives; ConfigError if it has several and none was chosen."""
        if self._hand is None:
            names = " or ".join(f"--hand {hand}" for hand in self.hands)
            raise ConfigError(f"{self.path} has several hands: choose one, {names}")
        return self._hand

    @property
    def signals(self) -> DeclaredSignals:
        """The meaning of each signal that was declared, by topic and name."""
        declared = declared_signals(self.metadata)
        return {topic: declared.get(self._stream(topic), {}) for topic in TOPICS}

    @property
    def energy_before(self) -> float:
        """True energy when the law began with which the recording begins, in J; 0: with the run."""
        return float(self.metadata.get(node_name(self.hand, ENERGY_BEFORE), 0.0))

    @cached_property
    def launch(self) -> Document:
        """The launch file as resolved for the run, empty if none was recorded.

        As if it had the chosen hand alone; if none was chosen, with all hands.
        """
        return self._document if self._hand is None else flat(self._document, self._hand)

    @cached_property
    def _document(self) -> Document:
        text = self.metadata.get("launch", "{}")
        try:
            msgspec.json.decode(text, type=Launched)
            return nested(msgspec.json.decode(text))
        except (msgspec.MsgspecError, ValueError, RecursionError) as error:
            raise ConfigError(
                f"{self.path}: its launch file is none of this version ({error})"
            ) from error


def read(
    path: str | PathLike[str], topics: Collection[str] = tuple(TOPICS), hand: str | None = None
) -> Recording:
    """Return a recording, complete or not.

    Args:
        path: The file.
        topics: Of the packets to read; of others it gives none.
        hand: The name of the hand whose packets it gives; None: the only one.

    Raises:
        ConfigError: If there is no such hand, or the file is missing, is no regular file, is not
            MCAP, was not written by forcebound, or unpacks to more than a recording does. The last
            is seen when that part of the file is read.
    """
    path = Path(path)
    for content in mcap_file.readable(path, ()):
        if isinstance(content, Metadata) and content.name == METADATA_NAME:
            return Recording(path, content.metadata, topics, hand)
    raise ConfigError(f"{path} is not a recording of forcebound (or it was cut at its start)")


@cache
def _decoder(packet: type[Packet]) -> Callable[[bytes], Packet]:
    """Return a function from a recorded message to the packet; raises as msgspec does."""
    hints = field_types(packet)
    may_be_null = [name for name, hint in hints.items() if type(None) in get_args(hint)]
    absent = dict.fromkeys(may_be_null) | ABSENT

    def read_message(data: bytes) -> Packet:
        document = _decode(data)
        if b"null" in data:
            document = {name: _with_nan(value) for name, value in document.items()}
        return msgspec.convert(absent | document, packet)

    return read_message


def _with_nan(value: Any) -> Any:
    """Return a recorded value with NaN for null."""
    if isinstance(value, list):
        return [_with_nan(one) for one in value]
    if isinstance(value, dict):
        return {name: _with_nan(one) for name, one in value.items()}
    return math.nan if value is None else value
