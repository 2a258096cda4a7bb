"""A complete recording from one that was cut: its readable part, with index and footer.

Metadata, schemas, channels and messages are copied as they are, chunk by chunk, so a recording of
another version is recovered, too. A metadata record ``forcebound.recovered`` says what was lost.
"""

import struct
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, BinaryIO

from mcap.opcode import Opcode
from mcap.records import Channel, Metadata, Schema
from mcap.writer import Writer

from forcebound import mcap_file
from forcebound.errors import ConfigError
from forcebound.files import check_writable, reason
from forcebound.recording import read

RECOVERED_NAME = "forcebound.recovered"  # of the metadata record


@dataclass(frozen=True)
class Recovered:
    """What was recovered of a recording, and what was lost."""

    messages: int
    duration: float  # s, from the first of them to the last
    lost_bytes: int  # that could not be read, at the end of the file or from its damage on


def recover(cut: Path, output: Path) -> Recovered:
    """Write the readable part of a recording as a complete one.

    Args:
        cut: The recording; it stays as it is.
        output: Another file; replaced if it exists.

    Raises:
        ConfigError: If it is complete or no recording, or a file cannot be read or written.
    """
    if read(cut, ()).complete:
        raise ConfigError(f"{cut} is complete: there is nothing to recover, use it as it is")
    check_writable(output, "the recording")
    if output.exists() and output.samefile(cut):
        raise ConfigError(f"{output} is the recording itself: choose another name")
    try:
        with output.open("wb") as target:
            return _Copy(target).run(cut)
    except OSError as error:  # the disk is full
        raise ConfigError(f"cannot write the recording {output}: {reason(error)}") from error


class _Copy:
    """A recording that grows by what another holds."""

    def __init__(self, target: BinaryIO) -> None:
        self._writer: Any = Writer(target)  # mcap leaves most of its methods unannotated
        self._writer.start(profile="", library="forcebound")
        self._schemas: dict[int, int] = {0: 0}  # ids here by ids there; 0: none
        self._channels: dict[int, int] = {}
        self._messages = 0
        self._first_ns, self._last_ns = 0, 0

    def run(self, cut: Path) -> Recovered:
        """Copy what can be read of a file."""
        lost = 0
        source = mcap_file.parts(cut)
        try:
            for part in source:
                if isinstance(part, Metadata):
                    self._writer.add_metadata(part.name, part.metadata)
                    continue
                try:
                    for opcode, data in mcap_file.records(part):
                        self._take(opcode, data)
                except mcap_file.DamagedError as error:
                    source.throw(error)
                self._writer.flush()
        except mcap_file.DamagedError as error:
            lost = cut.stat().st_size - error.at
        result = Recovered(self._messages, (self._last_ns - self._first_ns) * 1e-9, lost)
        texts = {name: str(value) for name, value in asdict(result).items()}
        self._writer.add_metadata(RECOVERED_NAME, texts)
        self._writer.finish()
        return result

    def _take(self, opcode: int, data: bytes) -> None:
        if opcode == Opcode.SCHEMA:
            schema = mcap_file.parsed(Schema, data)
            self._schemas[schema.id] = self._writer.register_schema(
                schema.name, schema.encoding, schema.data
            )
        elif opcode == Opcode.CHANNEL:
            channel = mcap_file.parsed(Channel, data)
            self._channels[channel.id] = self._writer.register_channel(
                channel.topic,
                channel.message_encoding,
                self._schemas.get(channel.schema_id, 0),
                channel.metadata,
            )
        elif opcode == Opcode.MESSAGE:
            self._copy_message(data)

    def _copy_message(self, data: bytes) -> None:
        channel, sequence, log_time, publish_time = struct.unpack_from("<HIQQ", data)
        if channel not in self._channels:  # as the reader of recordings has it
            return
        self._first_ns = self._first_ns if self._messages else log_time
        self._last_ns = log_time
        self._messages += 1
        content = data[mcap_file.MESSAGE_HEAD :]
        self._writer.add_message(self._channels[channel], log_time, content, publish_time, sequence)
