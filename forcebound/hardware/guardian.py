"""A guardian: a process that writes zero force when the process of the device no longer can.

Many boards hold their last force for ever. The guardian holds a second descriptor of the port and
one message, that of zero force. It writes it

* at once when the process of the device has ended, however it did (``kill -9`` included);
* when a force is on and that process has not written for a time-out: it hangs, is stopped, or gets
  no processor. It says so in shared memory, and the driver, if it runs on, raises DeviceError.

:mod:`forcebound.hardware.guardian_process` is what runs; it ends with :meth:`Guardian.close`.
A process that is stopped between its look at the shared memory and its write may still write one
force when it runs on: it looks again after the write and takes that force back.
"""

import mmap
import os
import subprocess
import sys
from pathlib import Path

from forcebound.errors import DeviceError
from forcebound.hardware.guardian_process import BEAT, FIRED, ORDERLY, SIZE

TIMEOUT = 0.015  # s; with what waking takes, zero force is written within 20 ms


class Guardian:
    """The guardian of an open port.

    Args:
        descriptor: Of the port.
        zero: The message of zero force.
        timeout: Longest time between two beats while a force is on, in s.

    Attributes:
        process_id: Of the guardian.

    Raises:
        DeviceError: If the process cannot be started.
    """

    def __init__(self, descriptor: int, zero: bytes, timeout: float = TIMEOUT) -> None:
        self._timeout = timeout
        memory = os.memfd_create("forcebound-guardian")
        own = os.pidfd_open(os.getpid())
        try:
            os.ftruncate(memory, SIZE)
            self._memory = mmap.mmap(memory, SIZE)
            self._process = _start(descriptor, memory, own, zero, timeout)
        except OSError as error:
            raise DeviceError(f"the guardian of the port cannot be started: {error}") from error
        finally:
            os.close(memory)
            os.close(own)
        self._view = memoryview(self._memory).cast("q")
        self.process_id = self._process.pid
        assert self._process.stdout is not None
        if not self._process.stdout.read(1):
            self.close()
            raise DeviceError("the guardian of the port ended at its start: no force without it")

    def beat(self, time_ns: int) -> None:
        """Say that a force is on, or about to be, at ``time_ns`` of the monotonic clock.

        Args:
            time_ns: Now, in ns; 0: no force is on, and none need be watched.
        """
        self._view[BEAT] = time_ns

    def check(self) -> None:
        """Check that the guardian watches and has had nothing to do; before and after a write.

        Raises:
            DeviceError: If it has written zero force, or is gone.
        """
        if self._view[FIRED]:
            raise DeviceError(
                f"this process did not write for {1e3 * self._timeout:g} ms with a force on, so the"
                " guardian of the port has written zero force; `forcebound doctor` says how to make"
                " ticks punctual"
            )
        if self._process.poll() is not None:
            raise DeviceError("the guardian of the port is gone: no force without it")

    def close(self) -> None:
        """End the guardian; it writes nothing more."""
        self._process.communicate(ORDERLY)
        self._view.release()
        self._memory.close()


def _start(
    descriptor: int, memory: int, own: int, zero: bytes, timeout: float
) -> "subprocess.Popen[bytes]":
    program = str(Path(__file__).with_name("guardian_process.py"))
    numbers = (descriptor, memory, own, round(timeout * 1e9))
    # Isolated and without site packages: it starts within some 10 ms and imports four modules.
    command = [sys.executable, "-I", "-S", program, *map(str, numbers), zero.hex()]
    return subprocess.Popen(
        command,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        pass_fds=(descriptor, memory, own),
        start_new_session=True,  # a signal to the terminal's processes is not for it
    )
