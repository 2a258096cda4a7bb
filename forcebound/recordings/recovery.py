"""A complete recording from one that was cut: its readable part, with index and footer.

Metadata, schemas, channels and messages are copied as they are, so a recording of another version
is recovered, too. A metadata record ``forcebound.recovered`` says what was lost.
"""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, BinaryIO

from mcap.records import Channel, Message, Metadata, Schema
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
            return _copy(cut, target)
    except OSError as error:  # the disk is full
        raise ConfigError(f"cannot write the recording {output}: {reason(error)}") from error


def _copy(cut: Path, target: BinaryIO) -> Recovered:
    """Copy what can be read of a file."""
    writer: Any = Writer(target)  # mcap leaves most of its methods unannotated
    writer.start(profile="", library="forcebound")
    schemas, channels = {0: 0}, dict[int, int]()  # ids here by ids there; 0: none
    times: list[int] = []  # of the first and the last message, in ns
    messages = lost = 0
    try:
        for one in mcap_file.records(cut):
            if isinstance(one, Metadata):
                writer.add_metadata(one.name, one.metadata)
            elif isinstance(one, Schema):
                schemas[one.id] = writer.register_schema(one.name, one.encoding, one.data)
            elif isinstance(one, Channel):
                schema = schemas.get(one.schema_id, 0)
                channels[one.id] = writer.register_channel(
                    one.topic, one.message_encoding, schema, one.metadata
                )
            elif isinstance(one, Message) and one.channel_id in channels:
                times = [*times[:1], one.log_time]
                messages += 1
                writer.add_message(
                    channels[one.channel_id], one.log_time, one.data, one.publish_time, one.sequence
                )
    except mcap_file.DamagedError as error:
        lost = cut.stat().st_size - error.at
    result = Recovered(messages, (times[-1] - times[0]) * 1e-9 if times else 0.0, lost)
    texts = {name: str(value) for name, value in asdict(result).items()}
    writer.add_metadata(RECOVERED_NAME, texts)
    writer.finish()
    return result
