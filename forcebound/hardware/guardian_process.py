"""The program of a guardian: a few system calls, and nothing but the standard library.

Arguments: the descriptors of the port, of the shared memory and of the process it watches; the
time-out in ns; the message of zero force, in hexadecimal digits. See
:mod:`forcebound.hardware.guardian`.
"""

import ctypes
import errno
import mmap
import os
import select
import signal
import sys
import threading
import time
from contextlib import suppress

#: Numbers in the shared memory, 64 bits each: when the process last wrote while a force was on (0:
#: none is on), when the guardian wrote zero because it did not (0: never), when it last looked.
BEAT, FIRED, ALIVE = 0, 1, 2
NUMBERS_SIZE = 24  # bytes of all three
LOOK_NS = 20_000_000  # longest time between two looks
LOCK_AT = NUMBERS_SIZE  # byte at which the lock of the watched process begins
SIZE = 128  # bytes of all; a lock has 40 to 64

ORDERLY = b"q"  # on standard input: end, and write nothing
PRIORITY = 60  # of SCHED_FIFO: above the device's, which may be what hogs the processor

libc = ctypes.CDLL(None)


def guard(port: int, shared: mmap.mmap, watched: int, timeout_ns: int, zero: bytes) -> None:
    """Write ``zero`` to the port when the watched process has ended, or is late with a force on."""
    view = memoryview(shared)[:NUMBERS_SIZE].cast("q")
    orders, ends = sys.stdin.fileno(), (_end_of_holder(lock_address(shared)), watched)
    answered = 0  # the beat after which zero was written
    view[ALIVE] = time.monotonic_ns()
    os.write(sys.stdout.fileno(), b"r")
    while True:
        beat, view[ALIVE] = view[BEAT], time.monotonic_ns()
        is_watched = beat not in (0, answered)
        wait_ns = beat + timeout_ns - view[ALIVE] if is_watched else timeout_ns
        longest_ns = min(max(wait_ns, 0), LOOK_NS)
        ready = select.select((orders, *ends), (), (), longest_ns * 1e-9)[0]
        if orders in ready and os.read(orders, 1) == ORDERLY:
            return
        if ready:  # the process ends, and its end of standard input with it
            write(port, zero)
            return
        if is_watched and wait_ns <= 0:
            view[FIRED], answered = time.monotonic_ns(), beat
            write(port, zero)


def lock_address(shared: mmap.mmap) -> ctypes.c_void_p:
    """Return where the lock of the watched process is in this process."""
    return ctypes.c_void_p(ctypes.addressof(ctypes.c_char.from_buffer(shared, LOCK_AT)))


def _end_of_holder(lock: ctypes.c_void_p) -> int:
    """Return a descriptor that becomes readable when the thread that holds a robust lock ends.

    The kernel gives the lock free first of all. A process counts as ended, and its descriptors
    are closed, only when its memory is returned: up to 50 ms later, for some 500 MB.
    """
    noticed, notice = os.pipe()

    def wait() -> None:
        if libc.pthread_mutex_lock(lock) == errno.EOWNERDEAD:
            os.write(notice, b"e")

    threading.Thread(target=wait, daemon=True).start()
    return noticed


def write(port: int, message: bytes) -> None:
    """Write a message as soon as the port takes it; say so if the device is unplugged."""
    while True:
        try:
            os.write(port, message)
            return
        except BlockingIOError:
            select.select((), (port,), ())
        except OSError as error:
            sys.stderr.write(f"a force may still be on, no zero can be written: {error}\n")
            return


def main() -> None:
    """Guard until the process ends, or says that all is in order."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    with suppress(OSError):  # without the right to it, the guardian is as punctual as others
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    *numbers, zero = sys.argv[1:]
    port, memory, watched, timeout_ns = map(int, numbers)
    guard(port, mmap.mmap(memory, SIZE), watched, timeout_ns, bytes.fromhex(zero))


if __name__ == "__main__":
    main()
