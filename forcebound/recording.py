"""What a run leaves behind: an MCAP file of every packet, and how to read it back.

One channel per topic (``/device_state`` ...), JSON messages, and a jsonschema with units for each,
so that a recording opens in Foxglove and PlotJuggler as it is. A metadata record ``forcebound``
holds the resolved launch file, the versions and the seed as text.

* **A killed recorder loses only what came after the last** :meth:`Recorder.flush`. MCAP collects
  messages in compressed chunks, and a chunk exists in the file only when it is finished; ``flush``
  finishes it. Such a file has no footer: :func:`read` returns what is there and says so
  (:attr:`Recording.complete`).
* **The same calls give the same bytes**: no date, path or host is written. A flush ends a chunk, so
  it counts as one of the calls.
* **The schemas use one type per field**, since Foxglove refuses a list of types. So a field without
  a value (``None``) is left out of its message; a number that is not finite, which JSON cannot
  express, becomes ``null`` and is read back as NaN.
"""

import json
import math
import struct
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from operator import attrgetter
from os import PathLike
from pathlib import Path
from types import TracebackType
from typing import Any, Self, cast, get_args

import numpy as np
from mcap.exceptions import InvalidMagic, McapError
from mcap.records import Channel, Chunk, Footer, Message, Metadata
from mcap.stream_reader import CRCValidationError, StreamReader, breakup_chunk
from mcap.writer import Writer
from msgspec.json import Encoder
from numpy.typing import NDArray
from zstandard import ZstdError

from forcebound.errors import ConfigError
from forcebound.messages.codec import plain
from forcebound.messages.packets import (
    MAX_AXES,
    TOPIC_OF,
    TOPICS,
    Packet,
    Telemetry,
    Vector,
    field_types,
)

METADATA_NAME = "forcebound"  # of the metadata record

DESCRIPTIONS: dict[str, str] = {
    "seq": "count of this packet at its sender, from 0",
    "time_ns": "sender's monotonic clock, ns",
    "elapsed": "time since the force engaged for the first time, s; 0 before",
    "position": "position read, m; grows into the environment",
    "velocity": "velocity, m/s; filtered backward difference of the readings",
    "force": "force, N; positive resists motion in the positive direction",
    "device_seq": "seq of the device state that is answered",
    "device_time_ns": "time_ns of the device state that is answered, device's clock, ns",
    "query_seq": "seq of the query that is answered",
    "query_time_ns": "time_ns of the query that is answered, controller's clock, ns",
    "commanded_force": "force asked of the bounder, N; after age limit, ramp and saturation",
    "applied_force": "force written to the motor, N",
    "force_limit": "largest magnitude that law and saturation allowed, N",
    "estimated_energy": "energy as the law believes it, J",
    "true_energy": "energy that the hand has put into a simulated device, J",
    "true_position": "unquantised position of a simulated device, m",
    "hand_force": "force of the simulated hand on the device, N",
    "engagement": "factor of the engage ramp, 0 to 1",
    "loop_delay": "time from the answered device state to this write, s",
    "deadline_misses": "ticks skipped so far",
    "rejected": "packets refused so far, by reason",
    "environment": "name of an environment; in a query, of the one that serves",
    "node": "process that tells it",
    "event": "what kind of thing happened, one word",
    "is_fault": "something is wrong",
    "message": "what happened, for people",
    "data": "what happened, for programs",
}  # of the packets' fields, with units, for the schemas

_DAMAGE = (McapError, CRCValidationError, ZstdError, struct.error, UnicodeDecodeError)

_encode = Encoder(enc_hook=plain).encode  # what is not finite becomes null


def schema(packet: type[Packet]) -> dict[str, Any]:
    """Return the jsonschema of a packet: types, units and meaning of its fields."""
    types = field_types(packet)
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": f"forcebound.{packet.__name__}",
        "description": (packet.__doc__ or "").strip().splitlines()[0],
        "type": "object",
        "properties": {
            name: _field_schema(hint) | {"description": DESCRIPTIONS[name]}
            for name, hint in types.items()
        },
        "required": [name for name, hint in types.items() if not _is_optional(hint)],
    }


def _is_optional(hint: Any) -> bool:
    return type(None) in get_args(hint)


def _plain_type(hint: Any) -> Any:
    return get_args(hint)[0] if _is_optional(hint) else hint


def _field_schema(hint: Any) -> dict[str, Any]:
    plain = _plain_type(hint)
    if plain is int:
        return {"type": "integer"}
    if plain is float:
        return {"type": "number"}
    if plain is bool:
        return {"type": "boolean"}
    if plain is str:
        return {"type": "string"}
    if plain == Vector:
        numbers = {"type": "number"}
        return {"type": "array", "items": numbers, "minItems": 1, "maxItems": MAX_AXES}
    # Foxglove reads ``properties`` of every object, also of an empty one.
    _, entry = get_args(plain)
    return {"type": "object", "properties": {}, "additionalProperties": _field_schema(entry)}


class Recorder:
    """Writes packets to an MCAP file; a context manager.

    Args:
        path: The file to write; replaced if it exists.
        metadata: Texts by key, for example the resolved launch file, the versions, the seed.
        clock_offset_ns: Added to a packet's ``time_ns`` to give its log time, in ns. A live run
            passes wall clock minus monotonic clock at its start, virtual time 0.

    Raises:
        ConfigError: If the file cannot be created.
    """

    def __init__(
        self,
        path: str | PathLike[str],
        metadata: Mapping[str, str],
        clock_offset_ns: int = 0,
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
        # All topics from the start: the file does not depend on which packet happens to come first.
        self._channels = {packet: self._register(topic) for packet, topic in TOPIC_OF.items()}
        self.flush()

    def _register(
        self, topic: str
    ) -> tuple[int, tuple[str, ...], Callable[[Packet], tuple[Any, ...]]]:
        packet = TOPICS[topic].packet
        schema_id = self._writer.register_schema(
            f"forcebound.{packet.__name__}", "jsonschema", json.dumps(schema(packet)).encode()
        )
        channel = self._writer.register_channel(f"/{topic}", "json", schema_id)
        names = tuple(field_types(packet))
        return channel, names, attrgetter(*names)

    def write(self, packet: Packet) -> None:
        """Record one packet; in the file after the next :meth:`flush` or a full chunk (1 MiB)."""
        channel, names, values_of = self._channels[type(packet)]
        document = {
            name: value
            for name, value in zip(names, values_of(packet), strict=True)
            if value is not None
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

    def close(self) -> None:
        """Write index and footer and close the file; a second call does nothing."""
        if not self._file.closed:
            with self._file:
                self._writer.finish()

    def abandon(self) -> None:
        """Close the file without an end: whoever reads it sees that it is not all there is."""
        self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()


@dataclass(frozen=True)
class TelemetryColumns:
    """The telemetry of a run, one array per field; ``n`` samples, oldest first.

    What is ``None`` in a packet is NaN here (-1 in ``device_seq``).
    """

    time: NDArray[np.float64]  # (n,), s since the first sample with an engaged force
    time_ns: NDArray[np.int64]  # (n,), ns, device's clock
    seq: NDArray[np.int64]  # (n,), tick number
    elapsed: NDArray[np.float64]  # (n,), s since the force engaged for the first time
    position: NDArray[np.float64]  # (n, axes), m, reading
    commanded_force: NDArray[np.float64]  # (n, axes), N
    applied_force: NDArray[np.float64]  # (n, axes), N
    force_limit: NDArray[np.float64]  # (n,), N
    estimated_energy: NDArray[np.float64]  # (n,), J
    true_energy: NDArray[np.float64]  # (n,), J
    true_position: NDArray[np.float64]  # (n, axes), m
    hand_force: NDArray[np.float64]  # (n, axes), N
    engagement: NDArray[np.float64]  # (n,), 0 to 1
    device_seq: NDArray[np.int64]  # (n,), tick that the force answers
    loop_delay: NDArray[np.float64]  # (n,), s
    deadline_misses: NDArray[np.int64]  # (n,), ticks skipped so far
    rejected: Mapping[str, int]  # packets refused by the end of the run, by reason

    @classmethod
    def from_packets(cls, packets: Sequence[Telemetry]) -> Self:
        """Return the columns of ``packets``; without packets, empty columns of one axis.

        Raises:
            ValueError: If the packets differ in their number of axes.
        """
        axes = len(packets[0].position) if packets else 1
        nothing = (math.nan,) * axes

        def floats(values: list[float | None]) -> NDArray[np.float64]:
            return np.array(values, dtype=np.float64)  # None becomes NaN

        def integers(values: list[int]) -> NDArray[np.int64]:
            return np.array(values, dtype=np.int64)

        def vectors(values: list[Vector]) -> NDArray[np.float64]:
            return np.array(values, dtype=np.float64).reshape(len(packets), axes)

        time_ns = integers([p.time_ns for p in packets])
        engagement = floats([p.engagement for p in packets])
        start = int(np.argmax(engagement > 0.0)) if packets else 0
        return cls(
            time=(time_ns - time_ns[start]) * 1e-9 if packets else floats([]),
            time_ns=time_ns,
            seq=integers([p.seq for p in packets]),
            elapsed=floats([p.elapsed for p in packets]),
            position=vectors([p.position for p in packets]),
            commanded_force=vectors([p.commanded_force for p in packets]),
            applied_force=vectors([p.applied_force for p in packets]),
            force_limit=floats([p.force_limit for p in packets]),
            estimated_energy=floats([p.estimated_energy for p in packets]),
            true_energy=floats([p.true_energy for p in packets]),
            true_position=vectors([p.true_position or nothing for p in packets]),
            hand_force=vectors([p.hand_force or nothing for p in packets]),
            engagement=engagement,
            device_seq=integers([-1 if p.device_seq is None else p.device_seq for p in packets]),
            loop_delay=floats([p.loop_delay for p in packets]),
            deadline_misses=integers([p.deadline_misses for p in packets]),
            rejected=dict(packets[-1].rejected) if packets else {},
        )

    def slice(self, chosen: NDArray[np.bool_]) -> Self:
        """Return the chosen samples, a mask of shape (n,); times and counts stay as they are."""
        columns = {
            field.name: getattr(self, field.name)[chosen]
            for field in fields(self)
            if field.name != "rejected"
        }
        return replace(self, **columns)


class Recording:
    """What :func:`read` found in a file.

    Attributes:
        path: Where it was read from.
        metadata: Texts by key, as given to the :class:`Recorder`.
        complete: False if the recorder was killed, or the file was cut or damaged: then these are
            the packets up to there.
    """

    def __init__(
        self,
        path: Path,
        metadata: dict[str, str],
        complete: bool,
        messages: Mapping[str, Sequence[bytes]],
    ) -> None:
        self.path = path
        self.metadata = metadata
        self.complete = complete
        self._messages = messages

    def packets(self, topic: str) -> list[Packet]:
        """Return the packets of a topic, ``"telemetry"`` for example, in the order of recording.

        Raises:
            ConfigError: If there is no such topic, or a message lacks a field of its packet.
        """
        if topic not in TOPICS:
            raise ConfigError(f"no topic {topic!r}; there are {', '.join(TOPICS)}")
        decode = _decoder(TOPICS[topic].packet)
        try:
            return [decode(json.loads(data)) for data in self._messages.get(topic, ())]
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            raise ConfigError(
                f"{self.path}: a message of {topic} is not the packet this version knows "
                f"({type(error).__name__}: {error}); recorded by another version?"
            ) from error

    @cached_property
    def telemetry(self) -> TelemetryColumns:
        """The telemetry as columns.

        Raises:
            ConfigError: If the recording holds none.
        """
        packets = cast("list[Telemetry]", self.packets(TOPIC_OF[Telemetry]))
        if not packets:
            raise ConfigError(
                f"{self.path} holds no telemetry: did the run end before its device node started?"
            )
        return TelemetryColumns.from_packets(packets)


def read(path: str | PathLike[str]) -> Recording:
    """Read a recording, also one whose recorder was killed.

    Raises:
        ConfigError: If the file is missing, is not MCAP, or was not written by forcebound.
    """
    path = Path(path)
    metadata: dict[str, str] | None = None
    topics: dict[int, str] = {}
    messages: dict[str, list[bytes]] = {topic: [] for topic in TOPICS}
    complete = False
    try:
        with path.open("rb") as file:
            # A cut record may claim any length, but none is longer than the file.
            size = path.stat().st_size
            reader = StreamReader(file, emit_chunks=True, record_size_limit=size)
            for record in reader.records:
                if isinstance(record, Metadata) and record.name == METADATA_NAME:
                    metadata = record.metadata
                elif isinstance(record, Chunk):
                    _collect(record, topics, messages)
                complete = isinstance(record, Footer)
    except OSError as error:
        raise ConfigError(f"cannot read the recording {path}: {error.strerror}") from error
    except InvalidMagic:
        if metadata is None:
            raise ConfigError(f"{path} is not an MCAP file") from None
        complete = False  # the closing magic is what is damaged
    except _DAMAGE:
        complete = False  # up to here it is good, and the caller can see that it is not all
    if metadata is None:
        raise ConfigError(f"{path} is not a recording of forcebound (or it was cut at its start)")
    return Recording(path, metadata, complete, messages)


def _collect(chunk: Chunk, topics: dict[int, str], messages: Mapping[str, list[bytes]]) -> None:
    for record in breakup_chunk(chunk, validate_crc=True):
        if isinstance(record, Channel):
            topics[record.id] = record.topic.removeprefix("/")
        elif isinstance(record, Message):
            topic = topics.get(record.channel_id, "")
            if topic in messages:
                messages[topic].append(record.data)


def _decoder(packet: type[Packet]) -> Callable[[Mapping[str, Any]], Packet]:
    """Return a function from a JSON document to the packet."""
    readers = [
        (name, _reader(hint), _is_optional(hint)) for name, hint in field_types(packet).items()
    ]
    build: Callable[..., Packet] = packet

    def decode(document: Mapping[str, Any]) -> Packet:
        return build(
            *(
                None if optional and name not in document else reader(document[name])
                for name, reader, optional in readers
            )
        )

    return decode


def _reader(hint: Any) -> Callable[[Any], Any]:
    plain = _plain_type(hint)
    if plain == Vector:
        return lambda value: tuple(map(_number, value))
    readers: dict[Any, Callable[[Any], Any]] = {float: _number, int: int, str: str, bool: bool}
    return readers.get(plain, dict)


def _number(value: float | None) -> float:
    return math.nan if value is None else float(value)
