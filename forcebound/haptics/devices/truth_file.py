"""The ground truth of an emulated device, in a small file that two processes map.

The emulator writes, the driver and observers read: the truth travels beside the serial line,
which has no room for it. A reader never waits: a counter, odd while the emulator writes, says
whether what was read is whole. In the other direction the file carries when the force engages,
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

MAGIC = b"fbtruth2"
SUFFIX = ".truth"  # behind the path of the port

_ENGAGED, _COUNTER, _LENGTH = struct.Struct("<q"), struct.Struct("<Q"), struct.Struct("<H")
_ENGAGED_AT = len(MAGIC)
_COUNTER_AT = _ENGAGED_AT + _ENGAGED.size
_RECORD_AT = _COUNTER_AT + _COUNTER.size  # its length, and an EmulatedTruth in MessagePack
SIZE = 512  # bytes; a record has 5 numbers and at most 4 vectors, each entry of 9 bytes

NOBODY, NOT_YET = 0, -1  # engagement, in place of a time
ATTEMPTS = 100  # of a read beside a writer


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
            self._memory[:_ENGAGED_AT] = MAGIC
        elif self._memory[:_ENGAGED_AT] != MAGIC:
            self.close()
            raise DeviceError(f"{path} is no file of an emulator: give the port that it prints")
        self._counter = 0

    def write(self, time_ns: int, truth: Truth, torque: Vector, torque_ns: int) -> None:
        """Replace the truth; for the emulator alone."""
        record = msgspec.msgpack.encode(EmulatedTruth(time_ns, truth, torque, torque_ns))
        end = _RECORD_AT + _LENGTH.size + len(record)
        _COUNTER.pack_into(self._memory, _COUNTER_AT, self._counter + 1)
        self._memory[_RECORD_AT:end] = _LENGTH.pack(len(record)) + record
        self._counter += 2
        _COUNTER.pack_into(self._memory, _COUNTER_AT, self._counter)

    def look(self) -> EmulatedTruth | None:
        """Return all that the file holds; None before the first write."""
        for _ in range(ATTEMPTS):
            (before,) = _COUNTER.unpack_from(self._memory, _COUNTER_AT)
            record = self._memory[_RECORD_AT:]
            (after,) = _COUNTER.unpack_from(self._memory, _COUNTER_AT)
            if before == after and before % 2 == 0:
                break
        else:  # the emulator was stopped within a write
            return None
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
        _ENGAGED.pack_into(self._memory, _ENGAGED_AT, NOT_YET)

    def engage(self, time_ns: int) -> None:
        """Say that the force engages: the hand may move."""
        _ENGAGED.pack_into(self._memory, _ENGAGED_AT, time_ns)

    @property
    def engaged_ns(self) -> int:
        """When the force engaged, in ns.

        ``NOT_YET``: it will be announced; ``NOBODY``: no driver is attached.
        """
        engaged_ns: int = _ENGAGED.unpack_from(self._memory, _ENGAGED_AT)[0]
        return engaged_ns

    def forget(self) -> None:
        """Clear the engagement of the previous user of the port."""
        _ENGAGED.pack_into(self._memory, _ENGAGED_AT, NOBODY)

    def close(self) -> None:
        """Release the file."""
        self._memory.close()


def truth_beside(port: str) -> TruthFile | None:
    """Return the truth of the emulator at a port, as the user names it; None for a real one."""
    with suppress(DeviceError):
        return TruthFile(Path(port + SUFFIX))
    return None
