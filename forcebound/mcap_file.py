"""MCAP files from outside: their metadata and messages, in bounded memory.

``mcap`` walks the records. It trusts the lengths within a record and the size that a chunk
states, so the file gives no more than it has, a record has at most ``MAX_RECORD`` bytes,
and a chunk is unpacked here: to no more than it says, all chunks to no more than ``MAX_EXPANSION``
times the file.

Source: the MCAP specification, mcap.dev/spec.
"""

import os
import struct
from collections.abc import Collection, Iterator
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any, BinaryIO

import lz4.frame
import zstandard
from mcap.exceptions import McapError
from mcap.records import Channel, Chunk, McapRecord, Message, Metadata
from mcap.stream_reader import StreamReader, breakup_chunk

from forcebound.errors import ConfigError
from forcebound.files import open_file, reason

MAGIC = b"\x89MCAP0\r\n"
METADATA_NAME = "forcebound"  # of the metadata record of a recording
MAX_RECORD = 32 << 20  # bytes; a recorder's chunk has 1 MiB and its last message
MAX_EXPANSION = 100  # of a file as a whole, beyond its first chunks; real ones have some 7
#: What mcap and the libraries of the compressions raise for damaged bytes.
_DAMAGE = (
    McapError, struct.error, ValueError, OverflowError, MemoryError, EOFError, RuntimeError,
    zstandard.ZstdError,
)  # fmt: skip


class DamagedError(Exception):
    """The rest of the file cannot be read.

    Attributes:
        at: Where it begins, in bytes from the start.
    """

    def __init__(self, at: int) -> None:
        self.at = at


class _Bounded:
    """A file at its beginning, with what it has now: a recorder may write faster than one reads."""

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self.size = self._left = os.fstat(file.fileno()).st_size

    def read(self, length: int) -> bytes:
        data = self._file.read(min(length, self._left))
        self._left -= len(data)
        return data


def contents(path: Path, topics: Collection[str]) -> Iterator[Metadata | tuple[str, bytes]]:
    """Yield the metadata of a file and its messages, each as topic and data.

    Args:
        path: The file.
        topics: Of the messages that are asked for.

    Raises:
        ConfigError: As :func:`records`.
        DamagedError: Likewise.
    """
    channels: dict[int, str] = {}
    for record in records(path):
        if isinstance(record, Message):
            topic = channels.get(record.channel_id, "")
            if topic in topics:
                yield topic, record.data
        elif isinstance(record, Channel):
            channels[record.id] = record.topic.removeprefix("/")
        elif isinstance(record, Metadata):
            yield record


def readable(path: Path, topics: Collection[str]) -> Iterator[Metadata | tuple[str, bytes]]:
    """Yield as :func:`contents` what can be read of a file, complete or not.

    Raises:
        ConfigError: As :func:`records`.
    """
    with suppress(DamagedError):
        yield from contents(path, topics)


def records(path: Path) -> Iterator[McapRecord]:
    """Yield the metadata of a file, and the schemas, channels and messages in its chunks.

    Raises:
        ConfigError: If it cannot be read, is not MCAP, or unpacks to more than a recording does.
        DamagedError: If the file is cut or damaged; what came before is good.
    """
    try:
        file = open_file(path)
    except OSError as error:
        raise ConfigError(f"cannot read the recording {path}: {reason(error)}") from error
    with file:
        if file.read(len(MAGIC)) != MAGIC:
            raise ConfigError(f"{path} is not an MCAP file")
        at = file.seek(0) + len(MAGIC)
        bounded: Any = _Bounded(file)
        left = MAX_RECORD + MAX_EXPANSION * bounded.size
        walk = StreamReader(bounded, emit_chunks=True, record_size_limit=MAX_RECORD).records
        while True:
            try:
                record = next(walk, None)
                if isinstance(record, Chunk):
                    left -= record.uncompressed_size
                    if record.uncompressed_size > MAX_RECORD or left < 0:
                        raise ConfigError(f"{path}: it unpacks to far more than a recording does")
                    found = breakup_chunk(_unpacked(record), validate_crc=True)
                else:
                    found = [record] if isinstance(record, Metadata) else []
            except ConfigError:
                raise
            except _DAMAGE as error:
                raise DamagedError(at) from error
            yield from found
            if record is None:
                return
            at = file.tell()


def _unpacked(chunk: Chunk) -> Chunk:
    """Return a chunk without compression; its data has the size that it says."""
    size, data = chunk.uncompressed_size, chunk.data
    if chunk.compression == "zstd":
        unpacker = zstandard.ZstdDecompressor(max_window_size=MAX_RECORD)
        data = unpacker.stream_reader(data).read(size + 1)
    elif chunk.compression == "lz4":
        data = lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=size + 1)
    elif chunk.compression:
        raise ValueError(f"no compression {chunk.compression}")
    if len(data) != size:
        raise ValueError(f"{len(data)} bytes in place of {size}")
    return replace(chunk, compression="", data=data)
