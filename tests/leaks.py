"""The leak check: what a test with processes and sockets may not leave behind.

Each test has a mark in its environment. Every process that it starts inherits the mark, and keeps
it if its parent dies. Afterwards there must be no process with the mark; it is killed. What the
fork server has forked has the mark of that: such a process must have been there before the test.
A test with sockets also gets a folder of its own for temporary files: afterwards there must be no
file in it, no further descriptor or thread in this process, and no further shared memory.
"""

import gc
import os
import signal
import tempfile
import threading
import time
import uuid
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from multiprocessing import resource_tracker
from pathlib import Path

import pytest

from forcebound.interface import live
from forcebound.network import sockets

MARK = "FORCEBOUND_TEST"
FORKED = uuid.uuid4().hex  # mark of the fork server of this session, and of all that it forks
GRACE = 20.0  # s for a killed process to end; only a test that fails waits as long
SHARED_MEMORY = Path("/dev/shm")


@contextmanager
def no_processes() -> Iterator[None]:
    """Fail if what runs inside leaves a process behind; kill it."""
    mark = uuid.uuid4().hex
    resource_tracker.ensure_running()  # multiprocessing's, which stays until this process ends
    before = _processes(FORKED) if live._servers else set()
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(MARK, mark)
        yield
    try:
        _expect_none("processes", lambda: _processes(mark, FORKED) - before)
    finally:
        for left in _processes(mark, FORKED) - before:
            with suppress(ProcessLookupError):
                os.kill(int(left.partition(" ")[0]), signal.SIGKILL)


@contextmanager
def no_leaks() -> Iterator[None]:
    """Fail if what runs inside leaves anything behind."""
    resource_tracker.ensure_running()  # as below
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(MARK, FORKED)
        live.server()
    threads, descriptors, memory = _threads(), _descriptors(), _shared_memory()
    with tempfile.TemporaryDirectory(prefix="fb-") as folder, pytest.MonkeyPatch.context() as patch:
        patch.setenv("TMPDIR", folder)
        patch.setenv("XDG_RUNTIME_DIR", folder)
        patch.setattr(tempfile, "tempdir", None)  # so that TMPDIR is read again
        gc.freeze()  # what was there before takes long to look through
        with no_processes():
            yield
        gc.collect()  # what only a reference cycle holds is no leak
        gc.unfreeze()
        _expect_none("descriptors", lambda: _descriptors() - descriptors)
        _expect_none("threads", lambda: _threads() - threads)
        _expect_none("temporary files", lambda: _files(Path(folder)))
        _expect_none("shared memory", lambda: _shared_memory() - memory)


def _expect_none(what: str, find: Callable[[], set[str]]) -> None:
    end = time.monotonic() + GRACE
    while found := find():
        assert time.monotonic() < end, f"the test has left {what}: {sorted(found)}"
        sockets.wait((), 10_000_000)


def _processes(*marks: str) -> set[str]:
    """The command lines of all processes with one of these marks in their environment."""
    variables = {f"{MARK}={mark}".encode() for mark in marks}
    found = set()
    for process in Path("/proc").iterdir():
        if process.name.isdigit() and process.name != str(os.getpid()):
            with suppress(OSError):  # it is another user's, or has ended meanwhile
                if not variables.isdisjoint((process / "environ").read_bytes().split(b"\0")):
                    command = (process / "cmdline").read_bytes().replace(b"\0", b" ")
                    found.add(f"{process.name} {command.decode(errors='replace')}".strip())
    return found


def _files(folder: Path) -> set[str]:
    """Everything in a folder but the keys of loopback, which last as long as a session."""
    keys = folder / "forcebound"
    return {str(path) for path in folder.rglob("*") if path != keys and keys not in path.parents}


def _descriptors() -> set[str]:
    found = set()
    for descriptor in Path("/proc/self/fd").iterdir():
        with suppress(OSError):  # that of this very listing
            found.add(f"{descriptor.name} {descriptor.readlink()}")
    return found


def _threads() -> set[str]:
    return {f"{thread.ident} {thread.name}" for thread in threading.enumerate()}


def _shared_memory() -> set[str]:
    """Names of shared memory, and of semaphores, that no running process has mapped."""
    names = {entry.name for entry in SHARED_MEMORY.iterdir()} if SHARED_MEMORY.is_dir() else set()
    if names:
        for process in Path("/proc").glob("[0-9]*/maps"):
            with suppress(OSError):
                text = process.read_text(errors="replace")
                names -= {name for name in names if f"{SHARED_MEMORY}/{name}" in text}
    return names
