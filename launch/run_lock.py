"""The lock of a run directory: each of its owners holds it, shared with others, while it lives.

The kernel frees the lock with the process, however that ends; a process id would be given to others
after it. Owners are a launcher, and the nodes that were started by hand; they share the lock.
"""

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

LOCK_FILE = "lock"


@contextmanager
def shared(run_dir: Path) -> Iterator[None]:
    """Be an owner of a run directory within the block.

    Raises:
        OSError: If the lock's file cannot be made.
    """
    descriptor = os.open(run_dir / LOCK_FILE, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_SH)  # waits microseconds at most, for exclusive()
        yield
    finally:
        os.close(descriptor)


@contextmanager
def exclusive(run_dir: Path) -> Iterator[bool]:
    """Give whether a run directory has no owner; within the block none can come."""
    try:
        descriptor = os.open(run_dir / LOCK_FILE, os.O_RDWR | os.O_CLOEXEC)
    except OSError:
        yield False  # nobody knows
        return
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        is_ours = False
    else:
        is_ours = True
    try:
        yield is_ours
    finally:
        os.close(descriptor)


def is_held(run_dir: Path) -> bool:
    """Return whether a run directory has an owner that lives."""
    with exclusive(run_dir) as is_free:
        return not is_free and (run_dir / LOCK_FILE).exists()
