"""Lock of a run directory: its owner keeps a lock on a file in it while it lives.

The kernel frees the lock with the process, however that ends; a process id could be reused. The
owner is a launcher, or an environment for a graph on another machine.
"""

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

LOCK_FILE = "lock"


@contextmanager
def shared(run_dir: Path) -> Iterator[None]:
    """Own a run directory during the body.

    Raises:
        OSError: If the lock's file cannot be made.
    """
    descriptor = os.open(run_dir / LOCK_FILE, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_SH)  # waits only microseconds, for `exclusive`
        yield
    finally:
        os.close(descriptor)


@contextmanager
def exclusive(run_dir: Path) -> Iterator[bool]:
    """Keep a run directory without owner during the body; yield False if it has one."""
    try:
        descriptor = os.open(run_dir / LOCK_FILE, os.O_RDWR | os.O_CLOEXEC)
    except OSError:
        yield False  # unknown
        return
    try:
        yield try_lock(descriptor)
    finally:
        os.close(descriptor)


def try_lock(descriptor: int) -> bool:
    """Lock an open file for this process alone; return whether that was possible."""
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    return True


def is_held(run_dir: Path) -> bool:
    """Return whether a run directory has a living owner."""
    with exclusive(run_dir) as is_free:
        return not is_free and (run_dir / LOCK_FILE).exists()
