"""The ground truth of an emulated device, in a small file that two processes map.

The emulator writes, the driver and observers read: the truth travels beside the serial line,
which has no room for it. A reader never waits, not even for an emulator that gets no processor
within a write: the file has room for two records, and a counter says which one is whole. In the
other direction the file carries when the force engages,
because a simulated hand then begins to move.
"""

import mmap
import os
import struct
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

import msgspec

from forcebound.errors import DeviceError
from forcebound.haptics.devices import Truth
from forcebound.messages.packets import Vector

MAGIC = b"fbtruth3"
SUFFIX = ".truth"  # behind the path of the port

_LENGTH = struct.Struct("<H")
#: Numbers of 64 bits: the magic, when the force engaged, how many records were written so far. They
#: are stored through a memoryview, in one piece: pack_into writes zeros first, which a reader sees.
_ENGAGED, _COUNTER, _NUMBERS = 1, 2, 3
_RECORDS_AT = 8 * _NUMBERS  # each: its length, and an EmulatedTruth in MessagePack
_RECORD = 488  # bytes; a record has 5 numbers and at most 4 vectors, each entry of 9 bytes
SIZE = _RECORDS_AT + 2 * _RECORD

NOBODY, NOT_YET = 0, -1  # engagement, in place of a time


class EmulatedTruth(NamedTuple):
    """Content of the file."""

    time_ns: int
    truth: Truth
    torque: Vector  # N m, what the motors give, positive towards larger angles
    torque_ns: int  # when it changed last


_decode = msgspec.msgpack.Decoder(EmulatedTruth).decode


class TruthFile:
    """The file, mapped; the emulator ``creates`` it. DeviceError if it is another file, or none."""

    def __init__(self, path: Path, creates: bool = False) -> None:
        flags = os.O_RDWR | os.O_CLOEXEC | (os.O_CREAT | os.O_TRUNC if creates else 0)
        try:
            descriptor = os.open(path, flags, 0o600)
            try:
                if creates:
                    os.ftruncate(descriptor, SIZE)
                self._memory = mmap.mmap(descriptor, SIZE)
            finally:
                os.close(descriptor)
        except (OSError, ValueError) as error:
            raise DeviceError(f"cannot map the truth of the emulator, {path}: {error}") from error
        if creates:
            self._memory[: len(MAGIC)] = MAGIC
        elif self._memory[: len(MAGIC)] != MAGIC:
            self._memory.close()
            raise DeviceError(f"{path} is no file of an emulator: give the port that it prints")
        self._numbers = memoryview(self._memory)[:_RECORDS_AT].cast("q")

    def write(self, time_ns: int, truth: Truth, torque: Vector, torque_ns: int) -> None:
        """Replace the truth; for the emulator alone."""
        record = msgspec.msgpack.encode(EmulatedTruth(time_ns, truth, torque, torque_ns))
        counter = self._numbers[_COUNTER] + 1
        start = _record_at(counter)
        end = start + _LENGTH.size + len(record)
        self._memory[start:end] = _LENGTH.pack(len(record)) + record
        self._numbers[_COUNTER] = counter

    def look(self) -> EmulatedTruth | None:
        """Return all that the file holds; None before the first write."""
        before, after = -1, self._numbers[_COUNTER]
        while before != after:  # a further record came while this one was read
            before, start = after, _record_at(after)
            record = self._memory[start : start + _RECORD]
            after = self._numbers[_COUNTER]
        if before == 0:
            return None
        start, (length,) = _LENGTH.size, _LENGTH.unpack_from(record)
        return _decode(record[start : start + length])

    def read(self) -> Truth | None:
        """Return the newest ground truth; None before the first."""
        found = self.look()
        return None if found is None else found.truth

    def announce(self) -> None:
        """Say that :meth:`engage` will be called, so that the hand waits for it."""
        self._numbers[_ENGAGED] = NOT_YET

    def engage(self, time_ns: int) -> None:
        """Say that the force engages: the hand may move."""
        self._numbers[_ENGAGED] = time_ns

    @property
    def engaged_ns(self) -> int:
        """When the force engaged, in ns.

        ``NOT_YET``: it will be announced; ``NOBODY``: no driver is attached.
        """
        return self._numbers[_ENGAGED]

    def forget(self) -> None:
        """Clear the engagement of the previous user of the port."""
        self._numbers[_ENGAGED] = NOBODY

    def close(self) -> None:
        """Release the file."""
        self._numbers.release()
        self._memory.close()


def _record_at(counter: int) -> int:
    return _RECORDS_AT + counter % 2 * _RECORD


def truth_beside(port: str) -> TruthFile | None:
    """Return the truth of the emulator at a port, as the user names it; None for a real one."""
    with suppress(DeviceError):
        return TruthFile(Path(port + SUFFIX))
    return None
