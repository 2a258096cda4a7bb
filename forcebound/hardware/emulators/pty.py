"""A port for an emulator: a pseudo-terminal, a link to it, and the real time.

The link is made last, when all is ready, so that a program that waits for it may begin at once.
Beside it is the ground truth (:mod:`forcebound.haptics.devices.truth_file`), locked for as long as
the emulator runs: so a link that a killed emulator has left differs from one that is in use.
"""

import errno
import fcntl
import os
import select
import termios
import time
import tty
from contextlib import suppress
from pathlib import Path
from typing import Self

from forcebound.errors import ConfigError
from forcebound.files import check_writable, reason
from forcebound.haptics.devices.truth_file import SUFFIX, TruthFile
from forcebound.hardware.emulators.emulation import Emulation
from forcebound.stop import Stop

STEP = 1e-3  # s, longest time between two looks at the mechanism
UNUSED_TIMEOUT_NS = 60_000_000_000  # of an emulator that is to end when nobody uses it
CHUNK = 4096  # bytes; more than a pseudo-terminal keeps
TARGETS = ("/dev/pts/", "ws://")  # of the links of emulators


class Place:
    """The link of an emulator, and the file of the ground truth beside it, mapped.

    ConfigError if the link cannot be made, or an emulator runs there.
    """

    def __init__(self, link: Path) -> None:
        self.link, truth = link, Path(f"{link}{SUFFIX}")
        self._lock = _claim(link, truth)
        self.truth = TruthFile(truth)
        self._is_there = False

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.unplug()
        Path(f"{self.link}{SUFFIX}").unlink(missing_ok=True)
        self.truth.close()
        os.close(self._lock)

    def show(self, target: str) -> None:
        """Make the link."""
        self.link.symlink_to(target)
        self._is_there = True

    def unplug(self) -> None:
        """Let the link go away."""
        if self._is_there:
            self.link.unlink(missing_ok=True)
            self._is_there = False


class PseudoPort(Place):
    """A port that a program plays at its place.

    ``is_open``: somebody had it open at the last read.
    """

    def __init__(self, link: Path) -> None:
        super().__init__(link)
        self.descriptor, port = os.openpty()
        self.name = os.ttyname(port)
        tty.setraw(self.descriptor, termios.TCSANOW)
        os.close(port)  # opened again by its user, so that the end of its use is seen
        os.set_blocking(self.descriptor, False)
        self.is_open = True

    def read(self) -> bytes:
        """Return what has come; nothing if nothing has."""
        try:
            data = os.read(self.descriptor, CHUNK)
        except OSError as error:
            self.is_open = error.errno != errno.EIO
            return b""
        self.is_open = True
        return data

    def write(self, data: bytes) -> None:
        """Send bytes; what nobody takes is lost."""
        with suppress(OSError):
            os.write(self.descriptor, data)

    def unplug(self) -> None:
        """Let the port go away, and the link."""
        super().unplug()
        if self.descriptor >= 0:
            os.close(self.descriptor)
            self.descriptor = -1


def serve(emulation: Emulation, port: PseudoPort, stop: Stop, until_unused: bool) -> None:
    """Let an emulation go on in real time at a port, until a stop or the port's end.

    With ``until_unused`` it ends, too, when its user has closed the port, or none has come.
    """
    start_ns = time.monotonic_ns()
    while not stop.requested:
        _wait(emulation, port, stop)
        data = port.read()
        time_ns = time.monotonic_ns()
        reply = emulation.step(data, time_ns)
        if emulation.is_unplugged(time_ns):
            return
        if reply:
            port.write(reply)
        emulation.settle(time_ns)
        if not port.is_open:
            emulation.release(time_ns)
        was_used = emulation.replies > 0
        is_unused = not port.is_open and (was_used or time_ns - start_ns > UNUSED_TIMEOUT_NS)
        # An order that is still on the wire, such as a guardian's zero, acts first.
        if until_unused and is_unused and emulation.wake_ns is None:
            return


def _wait(emulation: Emulation, port: PseudoPort, stop: Stop) -> None:
    """Wait for bytes, for the board or for a step of the mechanism."""
    wait = STEP
    if emulation.wake_ns is not None:
        wait = min(max((emulation.wake_ns - time.monotonic_ns()) * 1e-9, 0.0), STEP)
    # The end of a port that nobody has open is always readable.
    watched = (port.descriptor, stop.descriptor) if port.is_open else (stop.descriptor,)
    select.select(watched, (), (), wait)


def _claim(link: Path, truth: Path) -> int:
    """Make the file of the truth, locked, and remove what a killed emulator has left."""
    check_writable(truth, "the truth of the emulator")
    try:
        with suppress(FileNotFoundError):
            left = os.open(truth, os.O_RDWR | os.O_CLOEXEC | os.O_NOFOLLOW)
            try:
                fcntl.flock(left, fcntl.LOCK_EX | fcntl.LOCK_NB)
                truth.unlink()
            finally:
                os.close(left)
        if link.is_symlink() and os.readlink(link).startswith(TARGETS):
            link.unlink()
        elif os.path.lexists(link):
            raise ConfigError(f"{link} is there, and no link of an emulator: choose another --link")
        TruthFile(truth, creates=True).close()
        lock = os.open(truth, os.O_RDWR | os.O_CLOEXEC)
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise ConfigError(f"an emulator runs at {link}: end it, or choose another --link") from None
    except OSError as error:
        raise ConfigError(f"cannot make the link {link}: {reason(error)}") from error
    return lock
