"""A serial port in a servo loop: whole messages out, bytes in until a deadline.

pyserial opens and sets up the port (raw, without flow control). Reading and writing go to its
descriptor: a reader that waits for a share of a millisecond needs ``select`` and ``read``, no more.

A port belongs to one process. The lock on the file keeps other programs out that ask for one, the
exclusive mode of the terminal those that do not.
"""

import errno
import fcntl
import os
import select
import termios
import time
from collections.abc import Callable
from contextlib import suppress

import serial

from forcebound.errors import DeviceError

CHUNK = 4096  # bytes; more than a terminal keeps


class Port:
    """An open serial port, such as ``/dev/ttyACM0``; USB and pseudo-terminals ignore ``baud``.

    Attributes:
        path: Of the port.
        descriptor: Open and not blocking; of this object.
        is_over: The far end has confirmed that this was the last message; no serial port does.
        zero: Message of zero force, if the far end decides what it is.

    Raises:
        DeviceError: If it cannot be opened, with what to try.
    """

    is_over = False
    zero = b""

    def __init__(self, path: str, baud: int = 115_200) -> None:
        self.path = path
        try:
            self._serial = serial.Serial(path, baud, timeout=0, write_timeout=0, exclusive=True)
        except (OSError, ValueError) as error:  # SerialException is an OSError
            raise DeviceError(_describe_opening(path, error)) from error
        self.descriptor: int = self._serial.fileno()
        with suppress(ValueError, OSError):  # USB-CDC and pseudo-terminals have no such mode
            self._serial.set_low_latency_mode(True)
        fcntl.ioctl(self.descriptor, termios.TIOCEXCL)

    def write(self, message: bytes) -> None:
        """Write a whole message, in one piece, without waiting; DeviceError if it fails."""
        try:
            count = os.write(self.descriptor, message)
        except BlockingIOError:
            count = 0
        except OSError as error:
            raise self._lost(error) from error
        if count != len(message):
            raise DeviceError(
                f"{self.path} took {count} of {len(message)} bytes: the device does not read;"
                " unplug it, plug it in, and start again"
            )

    def read(self, count: int, deadline_ns: int) -> bytes:
        """Return ``count`` bytes, or fewer: what has come by the deadline, monotonic, in ns.

        What is there is read even after it. DeviceError if the device is unplugged, as of
        :meth:`read_lines` and :meth:`drain`.
        """
        return self.read_until(lambda data: count - len(data), deadline_ns)

    def read_lines(self, count: int, deadline_ns: int) -> bytes:
        """Return what has come when ``count`` lines have, or what there is by the deadline."""
        return self.read_until(lambda data: CHUNK if data.count(b"\n") < count else 0, deadline_ns)

    def read_until(self, missing: Callable[[bytes], int], deadline_ns: int) -> bytes:
        """Return what has come when it misses no bytes, or what there is by the deadline."""
        data = b""
        wait_ns = 1
        while wait_ns > 0 and (count := missing(data)):
            wait_ns = max(deadline_ns - time.monotonic_ns(), 0)
            if not select.select((self.descriptor,), (), (), wait_ns * 1e-9)[0]:
                break
            data += self._take(count)
        return data

    def drain(self, quiet: float = 0.0) -> bytes:
        """Return the bytes that nobody has read, once nothing has come for ``quiet`` s.

        Of a device that is never quiet, no more than ``CHUNK`` bytes or those of 20 ``quiet``.
        """
        data, until_ns = b"", time.monotonic_ns() + round(20e9 * quiet)
        while select.select((self.descriptor,), (), (), quiet)[0]:
            data += self._take(CHUNK)
            if len(data) >= CHUNK or time.monotonic_ns() > until_ns:
                break
        return data

    def close(self) -> None:
        """Close the port."""
        self._serial.close()

    def _take(self, count: int) -> bytes:
        try:
            data = os.read(self.descriptor, count)
        except OSError as error:
            raise self._lost(error) from error
        if not data:  # it was readable: this is the end of the stream
            raise self._lost(OSError(errno.EIO, os.strerror(errno.EIO)))
        return data

    def _lost(self, error: OSError) -> DeviceError:
        return DeviceError(
            f"{self.path} is gone ({error.strerror}): the device is unplugged, or has no power"
        )


def _describe_opening(path: str, error: Exception) -> str:
    """Return why a port cannot be opened, and what to try."""
    number = error.errno if isinstance(error, OSError) else None
    if number == errno.ENOENT and os.path.islink(path):
        return (
            f"{path} leads to {os.readlink(path)}, which is not there: plug the device in, or start"
            " its emulator again"
        )
    if number == errno.ENOENT:
        return f"there is no port {path}; `forcebound device list` says which there are"
    if number in (errno.EACCES, errno.EPERM):
        return f"{path} may not be opened by this user; `forcebound doctor` says how to permit it"
    if number in (errno.EBUSY, errno.EAGAIN):
        return f"{path} is in use by another program; end it (`fuser -v {path}` names it)"
    if number == errno.EISDIR or isinstance(error.__context__, termios.error):
        return (
            f"expected a serial port, got {path}, which is none; `forcebound device list` says"
            " which ports there are"
        )
    return f"{path} cannot be opened: {error}"
