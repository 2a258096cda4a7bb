"""Helpers of tests with sockets and processes: waiting in bounded time, free ports."""

import random
import socket
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from forcebound.network import sockets

TIMEOUT = 120.0  # s; a cold start on a busy machine takes its time; a test that waits longer fails


def until(happened: Callable[[], object], what: str) -> None:
    """Wait for something, in bounded time."""
    end = time.monotonic() + TIMEOUT
    while not happened():
        assert time.monotonic() < end, f"waited {TIMEOUT} s for {what}"
        sockets.wait((), 1_000_000)


def free_port(host: str = "127.0.0.1") -> int:
    """Return a port that is free.

    Below those that the kernel gives to connections, such as those of a test beside this one.
    """
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    if family == socket.AF_INET6 and not Path("/proc/net/if_inet6").exists():
        pytest.skip("this machine has no IPv6")
    for _ in range(100):
        port = random.SystemRandom().randrange(10_000, 30_000)
        try:
            with socket.create_server((host, port), family=family):
                return port
        except OSError:
            continue
    raise AssertionError(f"no free port at {host}")
