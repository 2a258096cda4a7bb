"""Recordings: an MCAP file of every packet of a run, and its reader.

One channel per topic (``/device_state`` ...), JSON messages, and a jsonschema with units for each,
so that a recording opens in Foxglove and PlotJuggler. A metadata record ``forcebound``
holds the resolved launch file, the versions and the seed as text.

* **A killed recorder loses only the packets after the last** :meth:`Recorder.flush`. MCAP collects
  messages in compressed chunks, and a chunk is in the file only when it is finished; ``flush``
  finishes it. Such a file has no footer: :func:`read` returns its readable part with
  :attr:`Recording.complete` false.
* **The same calls give the same bytes**: no date, path or host is written. A flush ends a chunk, so
  it counts as one of the calls.
* **The schemas use one type per field**, since Foxglove rejects a list of types. So a field without
  a value (``None``) is left out of its message; a number that is not finite, which JSON cannot
  express, becomes ``null`` and is read back as NaN.
"""

import json
import math
import struct
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from operator import attrgetter
from os import PathLike
from pathlib import Path
from types import TracebackType
from typing import Any, Self, cast, get_args

from mcap.exceptions import InvalidMagic, McapError
from mcap.records import Channel, Chunk, Footer, Message, Metadata
from mcap.stream_reader import CRCValidationError, StreamReader, breakup_chunk
from mcap.writer import Writer
from msgspec.json import Encoder
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
from forcebound.telemetry import TelemetryColumns

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
    "commanded_force": "commanded force, N; after age limit, saturation and engage ramp",
    "applied_force": "applied force, N; written to the motor",
    "force_limit": "limit force, N; largest magnitude that law and saturation allow",
    "estimated_energy": "energy in the ledger of the law, J",
    "true_energy": "energy that the hand has put into a simulated device, J; ground truth",
    "true_position": "unquantised position of a simulated device, m",
    "hand_force": "force of the simulated hand on the device, N",
    "engagement": "factor of the engage ramp, 0 to 1",
    "loop_delay": "time from the answered device state to this write, s",
    "deadline_misses": "ticks skipped so far",
    "rejected": "packets rejected so far, by reason",
    "environment": "name of an environment; in a query, of the serving one",
    "node": "process that sent the event",
    "event": "kind of event, one word",
    "is_fault": "whether the event is a fault",
    "message": "description for people",
    "data": "details for programs",
}  # meaning and unit of the packets' fields, for the schemas

_DAMAGE = (McapError, CRCValidationError, ZstdError, struct.error, UnicodeDecodeError)

_encode = Encoder(enc_hook=plain).encode  # a number that is not finite becomes null


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
        """Close the file without index and footer, so that it reads as incomplete."""
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


class Recording:
    """Content of a recording.

    Attributes:
        path: File that was read.
        metadata: Texts by key, as given to the :class:`Recorder`.
        complete: False if the recorder was killed, or the file was cut or damaged; it then holds
            the packets up to that point.
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
                f"{self.path}: a message of {topic} does not match the packet of this version "
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
                f"{self.path} has no telemetry: did the run end before its device node started?"
            )
        return TelemetryColumns.from_packets(packets)


def read(path: str | PathLike[str]) -> Recording:
    """Read a recording, complete or not.

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
            # A damaged record may claim any length; no real one is longer than the file.
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
        complete = False  # only the closing magic is damaged
    except _DAMAGE:
        complete = False  # the records before the damage are good
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
    build = cast("Callable[..., Packet]", packet)

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
