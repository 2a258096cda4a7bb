"""The leak check finds what a test leaves, also of a process whose parent has died."""

import os
import signal
import socket
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

import leaks
import pytest

pytestmark = pytest.mark.live  # so that the fork server of the session is there before


def process(stack: ExitStack) -> None:
    child = subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE)
    stack.callback(child.communicate)


def orphan(stack: ExitStack) -> None:
    """A process whose parent ends at once; it ends when its pipe is closed."""
    there, here = os.pipe()
    start = "import subprocess, sys; subprocess.Popen([sys.executable, '-c', 'input()'])"
    subprocess.run([sys.executable, "-c", start], stdin=there, check=True)
    os.close(there)
    stack.callback(os.close, here)


def descriptor(stack: ExitStack) -> None:
    stack.enter_context(socket.socket())


def file(stack: ExitStack) -> None:
    Path(tempfile.gettempdir(), "forgotten").touch()


def thread(stack: ExitStack) -> None:
    end = threading.Event()
    one = threading.Thread(target=end.wait)
    one.start()
    stack.callback(one.join)
    stack.callback(end.set)


LEFT: dict[str, Callable[[ExitStack], None]] = {
    "processes": process,
    "processes: .*input": orphan,
    "descriptors": descriptor,
    "temporary files": file,
    "threads": thread,
}


@pytest.mark.parametrize("what", LEFT)
def test_what_is_left_is_found(what: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(leaks, "GRACE", 0.0)
    with (
        ExitStack() as stack,
        pytest.raises(AssertionError, match=f"the test has left {what}"),
        leaks.no_leaks(),
    ):
        LEFT[what](stack)


def test_a_process_that_is_left_is_killed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(leaks, "GRACE", 0.0)
    with pytest.raises(AssertionError, match="the test has left processes"), leaks.no_processes():
        child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(1e6)"])
    assert child.wait() == -signal.SIGKILL


def test_a_process_that_ends_is_not_left() -> None:
    with leaks.no_leaks():
        subprocess.run([sys.executable, "-c", ""], check=True)
