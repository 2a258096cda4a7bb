"""MCAP files from outside: their metadata and messages, in bounded memory.

The records are walked here and not by ``mcap.stream_reader``, which believes what a record says of
its length and what a chunk says of its size. Here a record is read whole, once it is known to fit
into the file, so nothing inside can claim more; and a chunk unpacks to no more than it says, all
chunks to no more than :func:`most_of`. Records that nobody asks for are skipped.

Source: the MCAP specification, mcap.dev/spec.
"""

import io
import os
import struct
import zlib
from collections.abc import Collection, Iterator
from contextlib import contextmanager, suppress
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
RECORD_HEAD = _HEAD.size
MESSAGE_HEAD = 22  # bytes before the data of a message: channel, sequence, two times
MAX_RECORD = 32 << 20  # bytes; a recorder's chunk has 1 MiB and its last message
MAX_MESSAGES = 32 << 30  # bytes of the wanted messages of one file; 12 h of a run's result at 1 kHz
MAX_EXPANSION = 100  # of a file as a whole, beyond its first chunks; real ones have some 7


class DamagedError(Exception):
    """The rest of the file cannot be read."""


class TooLargeError(Exception):
    """The file holds more than any recording does."""


def most_of(size: int) -> int:
    """Return how many bytes the chunks of a file of ``size`` bytes may unpack to."""
    return MAX_RECORD + MAX_EXPANSION * size


@contextmanager
def opened(path: Path) -> Iterator[BinaryIO]:
    """Open a file for :func:`contents` or :func:`parts`.

    Raises:
        ConfigError: If it cannot be read, is not MCAP, or unpacks to more than a recording does.
    """
    try:
        file = open_file(path)
    except OSError as error:
        raise ConfigError(f"cannot read the recording {path}: {reason(error)}") from error
    with file:
        if file.read(len(MAGIC)) != MAGIC:
            raise ConfigError(f"{path} is not an MCAP file")
        try:
            yield file
        except TooLargeError as error:
            raise ConfigError(f"{path}: {error}") from None


def contents(file: BinaryIO, topics: Collection[str]) -> Iterator[Metadata | tuple[str, bytes]]:
    """Yield the metadata of a file and its messages, each as topic and data.

    Args:
        file: As :func:`opened` gives it.
        topics: Of the messages that are wanted.

    Raises:
        DamagedError: If the file is cut or damaged here; what came before is good.
        TooLargeError: If it unpacks to more than any recording does.
    """
    channels: dict[int, str] = {}
    kept = 0
    for part in parts(file):
        if isinstance(part, Metadata):
            yield part
            continue
        for topic, message in _messages(part, channels, topics):
            kept += len(message) + MESSAGE_HEAD
            yield topic, message
        if kept > MAX_MESSAGES:
            raise TooLargeError(f"its messages have more than {MAX_MESSAGES >> 20} MiB")


def readable(path: Path, topics: Collection[str]) -> Iterator[Metadata | tuple[str, bytes]]:
    """Yield as :func:`contents` what can be read of a file, complete or not.

    Raises:
        ConfigError: As :func:`opened`.
    """
    with opened(path) as file, suppress(DamagedError):
        yield from contents(file, topics)


def parts(file: BinaryIO) -> Iterator[Metadata | bytes]:
    """Yield the metadata of a file and the records in each chunk, unpacked.

    Args:
        file: As :func:`opened` gives it.

    Raises:
        DamagedError: If the file is cut or damaged here, at the place in the file where it is now;
            what came before is good.
        TooLargeError: If it unpacks to more than any recording does.
    """
    left = most_of(os.fstat(file.fileno()).st_size)
    for opcode, data in _records(file):
        try:
            is_chunk = opcode == Opcode.CHUNK
            part = _unpacked(parsed(Chunk, data)) if is_chunk else parsed(Metadata, data)
        except DamagedError:
            file.seek(-RECORD_HEAD - len(data), io.SEEK_CUR)
            raise
        if isinstance(part, bytes):
            left -= len(part)
            if left < 0:
                raise TooLargeError("it unpacks to far more than a recording does")
        yield part


def _records(file: BinaryIO) -> Iterator[tuple[int, bytes]]:
    """Yield metadata and chunks, until the end of a complete file."""
    size = os.fstat(file.fileno()).st_size
    while True:
        head = file.read(RECORD_HEAD)
        opcode, length = _HEAD.unpack(head) if len(head) == RECORD_HEAD else (0, size)
        if length > size - file.tell():
            file.seek(-len(head), io.SEEK_CUR)
            raise DamagedError
        if opcode not in (Opcode.METADATA, Opcode.CHUNK):
            file.seek(length, io.SEEK_CUR)
        elif length > MAX_RECORD:
            raise TooLargeError(f"a record has {length} bytes; at most {MAX_RECORD} are read")
        else:
            yield opcode, file.read(length)
        if opcode == Opcode.FOOTER:
            if file.read(len(MAGIC)) != MAGIC:
                raise DamagedError
            return


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
    if size > MAX_RECORD:
        raise TooLargeError(f"a chunk unpacks to {size} bytes; at most {MAX_RECORD} are read")
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


def _messages(
    unpacked: bytes, channels: dict[int, str], topics: Collection[str]
) -> Iterator[tuple[str, bytes]]:
    """Yield topic and data of the wanted messages in a chunk; notes the channels it declares."""
    for opcode, start, end in _places(unpacked):
        if opcode == Opcode.MESSAGE:
            topic = channels.get(unpacked[start] | unpacked[start + 1] << 8, "")
            if topic in topics:
                yield topic, unpacked[start + MESSAGE_HEAD : end]
        elif opcode == Opcode.CHANNEL:
            channel = parsed(Channel, unpacked[start:end])
            channels[channel.id] = channel.topic.removeprefix("/")


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
    start = RECORD_HEAD
    while start <= end:
        opcode, length = head(unpacked, start - RECORD_HEAD)
        following = start + length
        is_short = opcode == message and length < MESSAGE_HEAD
        if following > end or is_short or opcode == 0:  # zeros are no records
            raise DamagedError
        yield opcode, start, following
        start = following + RECORD_HEAD
    if start - RECORD_HEAD != end:
        raise DamagedError
