"""The link to another machine when a flood of connections leaves the process few descriptors."""

import os
import resource
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest
from remote_peers import Peer, ends, meet, open_peers, run_for, run_until
from waiting import free_port

from forcebound.network import limits
from forcebound.network.listener import Listener
from forcebound.network.monitor import Monitor

DESCRIPTORS = 512  # of this process, in the tests: select takes none above 1023


@pytest.fixture
def start(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., Peer]]:
    monkeypatch.setattr(limits, "DESCRIPTORS", DESCRIPTORS)
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (DESCRIPTORS, hard))
    try:
        with open_peers() as peers:
            yield peers
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))


IDLE = """
import socket, sys
connections = []
for _ in range(int(sys.argv[2])):
    try:
        connections.append(socket.create_connection(("127.0.0.1", int(sys.argv[1])), timeout=1))
    except OSError:
        pass
sys.stdin.read()
"""


@contextmanager
def few_descriptors(left: int) -> Iterator[None]:
    """Use up the descriptors of this process but for a few, as files that it opens later would."""
    used: list[int] = []
    try:
        while not used or used[-1] < DESCRIPTORS - left:
            used.append(os.dup(0))
        yield
    finally:
        for descriptor in used:
            os.close(descriptor)


def has_descriptors() -> bool:
    opened: list[int] = []
    try:
        while len(opened) < limits.DESCRIPTOR_RESERVE // 2:
            opened.append(os.dup(0))
    except OSError:
        return False
    finally:
        for descriptor in opened:
            os.close(descriptor)
    return True


@contextmanager
def idle_connections(port: int, count: int) -> Iterator[None]:
    process = subprocess.Popen(
        [sys.executable, "-c", IDLE, str(port), str(count)], stdin=subprocess.PIPE
    )
    try:
        yield
    finally:
        process.kill()
        process.communicate()


def test_connections_leave_the_process_some_descriptors(
    start: Callable[..., Peer], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(limits, "MAX_CONNECTIONS", 10**6)  # so that the descriptors decide
    port = free_port()
    graph_end, environment_end = ends(port)
    graph, environment, friend = start(graph_end), start(environment_end), start(environment_end)
    meet(graph, environment)
    meet(graph, friend)
    with few_descriptors(limits.DESCRIPTOR_RESERVE + 10), idle_connections(port, 200):
        run_until(
            lambda: graph.link.status()["counts"].get("too_many_connections", 0) > 50,
            "connections to be shut",
            graph,
            environment,
            friend,
        )
        run_until(has_descriptors, "the process to have descriptors", graph, environment, friend)
        assert "disconnected" not in environment.kinds()


def test_a_peer_can_connect_while_the_process_itself_uses_up_the_descriptors(
    start: Callable[..., Peer],
) -> None:
    graph_end, environment_end = ends(free_port())
    environment = start(environment_end)  # nothing listens yet
    graph = start(graph_end)
    with few_descriptors(limits.FEW_CONNECTIONS):
        meet(graph, environment)
        run_for(0.05, graph, environment)
    assert graph.kinds() == {"connected"}


def test_a_descriptor_that_is_no_connection_of_the_port_any_more_has_no_address(
    start: Callable[..., Peer],
) -> None:
    # libzmq may close a connection before its event is read, and its number has a new holder then.
    listener = Listener(Monitor(start(ends(free_port())[0]).network.reply_socket("inproc://a")), {})
    one, other = socket.socketpair()
    with one, other, open(os.devnull) as file:
        numbers = (one.fileno(), file.fileno(), DESCRIPTORS - 1)
        assert {listener._address_of(number) for number in numbers} == {"unknown address"}


def test_a_time_without_descriptors_leaves_no_lower_limit(start: Callable[..., Peer]) -> None:
    graph_end, environment_end = ends(free_port())
    graph = start(graph_end)
    with few_descriptors(1):
        run_for(0.05, graph)
    meet(graph, start(environment_end))
    assert graph.kinds() == {"connected"}
