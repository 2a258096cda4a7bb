"""MCAP files from outside: their metadata and messages, in bounded memory.

The records are walked here and not by ``mcap.stream_reader``, which takes three times as long, and
believes what a record says of its length and what a chunk says of its size. Here a record is read
whole, once it is known to fit into the file, so nothing inside can claim more; and a chunk unpacks
to no more than it says, all chunks to no more than ``MAX_EXPANSION`` times the file.

Source: the MCAP specification, mcap.dev/spec.
"""

import io
import os
import struct
import zlib
from collections.abc import Collection, Generator, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any, BinaryIO

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Metadata

from forcebound.errors import ConfigError
from forcebound.files import open_file, reason

METADATA_NAME = "forcebound"  # of the metadata record of a recording
MAGIC = b"\x89MCAP0\r\n"
_HEAD = struct.Struct("<BQ")  # before the data of a record: opcode and length
_READ: dict[int, Any] = {Opcode.METADATA.value: Metadata, Opcode.CHUNK.value: Chunk}
MESSAGE_HEAD = 22  # bytes before the data of a message: channel, sequence, two times
MAX_RECORD = 32 << 20  # bytes; a recorder's chunk has 1 MiB and its last message
MAX_EXPANSION = 100  # of a file as a whole, beyond its first chunks; real ones have some 7


class DamagedError(Exception):
    """The rest of the file cannot be read.

    Attributes:
        at: Where it begins, in bytes from the start.
    """

    at = 0


def contents(path: Path, topics: Collection[str]) -> Iterator[Metadata | tuple[str, bytes]]:
    """Yield the metadata of a file and its messages, each as topic and data.

    Args:
        path: The file.
        topics: Of the messages that are wanted.

    Raises:
        ConfigError: As :func:`parts`.
        DamagedError: Likewise.
    """
    channels: dict[int, str] = {}
    for part in parts(path):
        if isinstance(part, Metadata):
            yield part
            continue
        for opcode, start, end in _places(part):
            if opcode == Opcode.MESSAGE:
                topic = channels.get(part[start] | part[start + 1] << 8, "")
                if topic in topics:
                    yield topic, part[start + MESSAGE_HEAD : end]
            elif opcode == Opcode.CHANNEL:
                channel = parsed(Channel, part[start:end])
                channels[channel.id] = channel.topic.removeprefix("/")


def readable(path: Path, topics: Collection[str]) -> Iterator[Metadata | tuple[str, bytes]]:
    """Yield as :func:`contents` what can be read of a file, complete or not.

    Raises:
        ConfigError: As :func:`parts`.
    """
    with suppress(DamagedError):
        yield from contents(path, topics)


def parts(path: Path) -> Generator[Metadata | bytes, None, None]:
    """Yield the metadata of a file and the records in each chunk, unpacked.

    A :class:`DamagedError` of such records may be thrown into this generator, to learn the place.

    Raises:
        ConfigError: If it cannot be read, is not MCAP, or unpacks to more than a recording does.
        DamagedError: If the file is cut or damaged; what came before is good.
    """
    try:
        file = open_file(path)
    except OSError as error:
        raise ConfigError(f"cannot read the recording {path}: {reason(error)}") from error
    with file:
        size = os.fstat(file.fileno()).st_size
        left = MAX_RECORD + MAX_EXPANSION * size
        if file.read(len(MAGIC)) != MAGIC:
            raise ConfigError(f"{path} is not an MCAP file")
        opcode = None
        while opcode != Opcode.FOOTER:
            start = file.tell()
            try:
                opcode, part = _record(file, size)
                if opcode == Opcode.FOOTER and file.read(len(MAGIC)) != MAGIC:
                    raise DamagedError
                if isinstance(part, Chunk):
                    left -= part.uncompressed_size
                    if part.uncompressed_size > MAX_RECORD or left < 0:
                        raise ConfigError(f"{path}: it unpacks to far more than a recording does")
                    part = _unpacked(part)
                if part is not None:
                    yield part
            except DamagedError as error:
                error.at = start
                raise


def _record(file: BinaryIO, size: int) -> tuple[int, Any]:
    """Return the opcode of the next record; and the record, if it is metadata or a chunk."""
    head = file.read(_HEAD.size)
    opcode, length = _HEAD.unpack(head) if len(head) == _HEAD.size else (0, size)
    kind = _READ.get(opcode)
    if length > size - file.tell() or (kind is not None and length > MAX_RECORD):
        raise DamagedError
    if kind is None:
        file.seek(length, io.SEEK_CUR)
        return opcode, None
    return opcode, parsed(kind, file.read(length))


def parsed(kind: Any, data: bytes) -> Any:
    """Return a record of ``mcap.records``, none of whose fields is longer than the record.

    Raises:
        DamagedError: If it is none.
    """
    try:
        return kind.read(ReadDataStream(io.BytesIO(data)))
    except (McapError, struct.error, UnicodeDecodeError, OverflowError) as error:
        raise DamagedError from error


def _unpacked(chunk: Chunk) -> bytes:
    size = chunk.uncompressed_size
    data: bytes = chunk.data
    try:
        if chunk.compression == "zstd":
            unpacker = zstandard.ZstdDecompressor(max_window_size=MAX_RECORD)
            data = unpacker.stream_reader(data).read(size + 1)
        elif chunk.compression == "lz4":
            data = lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=size + 1)
    except (zstandard.ZstdError, RuntimeError, EOFError) as error:
        raise DamagedError from error
    # A size that is not kept, or a compression that is not known, is damage, too.
    is_sound = not chunk.uncompressed_crc or zlib.crc32(data) == chunk.uncompressed_crc
    if len(data) != size or not is_sound:
        raise DamagedError
    return data


def records(unpacked: bytes) -> Iterator[tuple[int, bytes]]:
    """Yield the records in a chunk, each as opcode and data.

    Raises:
        DamagedError: If they are cut or damaged here.
    """
    for opcode, start, end in _places(unpacked):
        yield opcode, unpacked[start:end]


def _places(unpacked: bytes) -> Iterator[tuple[int, int, int]]:
    """Yield the opcode of each record in a chunk, and where its data begin and end."""
    head, message, end = _HEAD.unpack_from, Opcode.MESSAGE.value, len(unpacked)
    start = _HEAD.size
    while start <= end:
        opcode, length = head(unpacked, start - _HEAD.size)
        following = start + length
        is_short = opcode == message and length < MESSAGE_HEAD
        if following > end or is_short or opcode == 0:  # zeros are no records
            raise DamagedError
        yield opcode, start, following
        start = following + _HEAD.size
    if start - _HEAD.size != end:
        raise DamagedError
