"""Who uses a run directory? Each of its owners holds a lock on a file in it while it lives.

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
def hold(run_dir: Path) -> Iterator[None]:
    """Be an owner of a run directory meanwhile.

    Raises:
        OSError: If the lock's file cannot be made.
    """
    descriptor = os.open(run_dir / LOCK_FILE, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_SH)  # it waits only for a look of seize, microseconds
        yield
    finally:
        os.close(descriptor)


@contextmanager
def seize(run_dir: Path) -> Iterator[bool]:
    """Let nobody become an owner meanwhile; give whether that is so: False if there is one."""
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
    with seize(run_dir) as is_free:
        return not is_free and (run_dir / LOCK_FILE).exists()
