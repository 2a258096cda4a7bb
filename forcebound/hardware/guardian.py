"""A guardian: a process that writes zero force when the process of the device no longer can.

Many boards hold their last force for ever. The guardian holds a second descriptor of the port and
one message, that of zero force. It writes it

* at once when the process of the device ends, however it does (``kill -9`` included): the kernel
  then gives a lock free that the thread holds which made the :class:`Guardian`;
* when a force is on and that process has not written for a time-out: it hangs, is stopped, or gets
  no processor. It says so in shared memory, and the driver, if it runs on, raises DeviceError.

A guardian says there, too, that it looks, every 20 ms at least. When it has been silent for 100 ms,
the driver writes zero force and raises GuardianError.

:mod:`forcebound.hardware.guardian_process` is what runs; it ends with :meth:`Guardian.close`.
A process that is stopped between its look at the shared memory and its write may still write one
force when it runs on: it looks again after the write and takes that force back.
"""

import ctypes
import mmap
import os
import subprocess
import sys
import time
from contextlib import ExitStack
from pathlib import Path

from forcebound.errors import DeviceError, GuardianError
from forcebound.hardware.guardian_process import (
    ALIVE,
    BEAT,
    FIRED,
    NUMBERS_SIZE,
    ORDERLY,
    SIZE,
    libc,
    lock_address,
)

TIMEOUT = 0.015  # s; with what waking takes, zero force is written within 20 ms
SILENCE = 0.1  # s; a guardian that is silent for longer, and for longer than its time-out, hangs
GRACE = 1.0  # s, for its orderly end
ATTRIBUTES_SIZE = 64  # bytes, more than any C library needs for those of a lock
SHARED = ROBUST = 1  # PTHREAD_PROCESS_SHARED, PTHREAD_MUTEX_ROBUST


class Guardian:
    """The guardian of an open port. The thread that makes it has to live as long.

    ``zero`` is the message of zero force, ``timeout`` the longest time between two beats while a
    force is on, in s. DeviceError if the process (``process_id``) cannot be started.
    """

    def __init__(self, descriptor: int, zero: bytes, timeout: float = TIMEOUT) -> None:
        self._timeout = timeout
        self._silence_ns = round(max(SILENCE, timeout) * 1e9)
        memory = os.memfd_create("forcebound-guardian")
        own = os.pidfd_open(os.getpid())
        try:
            os.ftruncate(memory, SIZE)
            self._memory = mmap.mmap(memory, SIZE)
            with ExitStack() as undone:
                _take_lock(lock_address(self._memory))
                undone.callback(libc.pthread_mutex_unlock, lock_address(self._memory))
                self._process = _start(descriptor, memory, own, zero, timeout)
                undone.pop_all()
        except OSError as error:
            raise DeviceError(f"the guardian of the port cannot be started: {error}") from error
        finally:
            os.close(memory)
            os.close(own)
        self._view = memoryview(self._memory)[:NUMBERS_SIZE].cast("q")
        self.process_id = self._process.pid
        assert self._process.stdout is not None
        if not self._process.stdout.read(1):
            self.close()
            raise DeviceError("the guardian of the port ended at its start: no force without it")

    def beat(self, time_ns: int) -> None:
        """Say that a force is on, or about to be, at ``time_ns``, monotonic; 0: none is on."""
        self._view[BEAT] = time_ns

    def check(self) -> None:
        """Check that the guardian watches and has had nothing to do; before and after a write.

        DeviceError if it has written zero force; GuardianError if it is gone, or has been silent
        for too long.
        """
        if self._view[FIRED]:
            raise DeviceError(
                f"this process did not write for {1e3 * self._timeout:g} ms with a force on, so the"
                " guardian of the port has written zero force; `forcebound doctor` says how to make"
                " ticks punctual"
            )
        is_silent = time.monotonic_ns() - self._view[ALIVE] > self._silence_ns
        if is_silent or self._process.poll() is not None:
            fate = "is silent: it is stopped, or gets no processor" if is_silent else "is gone"
            raise GuardianError(f"the guardian of the port {fate}; no force without it")

    def close(self) -> None:
        """End the guardian, also one that is stopped; it writes nothing more."""
        try:
            self._process.communicate(ORDERLY, GRACE)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.communicate()
        libc.pthread_mutex_unlock(lock_address(self._memory))
        self._view.release()
        self._memory.close()


def _take_lock(lock: ctypes.c_void_p) -> None:
    """Make a lock that processes share and that outlives its holder, and take it."""
    attributes = ctypes.create_string_buffer(ATTRIBUTES_SIZE)
    libc.pthread_mutexattr_init(attributes)
    libc.pthread_mutexattr_setpshared(attributes, SHARED)
    libc.pthread_mutexattr_setrobust(attributes, ROBUST)
    libc.pthread_mutex_init(lock, attributes)
    libc.pthread_mutex_lock(lock)


def _start(
    descriptor: int, memory: int, own: int, zero: bytes, timeout: float
) -> "subprocess.Popen[bytes]":
    program = str(Path(__file__).with_name("guardian_process.py"))
    numbers = (descriptor, memory, own, round(timeout * 1e9))
    # Isolated and without site packages: it starts within some 10 ms.
    command = [sys.executable, "-I", "-S", program, *map(str, numbers), zero.hex()]
    return subprocess.Popen(
        command,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        pass_fds=(descriptor, memory, own),
        # Signals of a terminal are not for it; a launcher ends the group of a node.
        start_new_session=os.getsid(0) != os.getpid(),
    )
