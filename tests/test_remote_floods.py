"""The link to another machine under floods: messages without an end, no descriptors left."""

import os
import resource
import socket
import struct
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing, contextmanager, suppress
from pathlib import Path

import pytest
from remote_peers import Peer, ends, meet, open_peers, run_for, run_until
from waiting import PATIENCE, free_port

from forcebound.network.limits import MAX_UNFINISHED
from forcebound.network.remote import RemoteLink
from forcebound.network.sockets import Network

ENOUGH = 60 * MAX_UNFINISHED  # bytes; what one would send within a second if nobody ended it
FRAME = 60_000  # bytes, fewer than the limit of a frame


@pytest.fixture
def start() -> Iterator[Callable[..., Peer]]:
    with open_peers() as peers:
        yield peers


class Raw:
    """A ZMTP peer without keys, made by hand: what no library would send."""

    MORE_LONG = b"\x03"
    GREETING = b"\xff" + bytes(8) + b"\x7f\x03\x00" + b"NULL".ljust(20, b"\0") + bytes(32)

    def __init__(self, connection: socket.socket, kind: bytes) -> None:
        self.connection = connection
        connection.setblocking(False)
        ready = b"\x05READY\x0bSocket-Type" + struct.pack(">I", len(kind)) + kind
        ready += b"\x08Identity" + bytes(4)
        self.unsent = self.GREETING + b"\x04" + bytes([len(ready)]) + ready
        self.greeting = b""  # first message, whole
        self.came = b""
        self.sent = 0
        self.is_alive = True

    def turn(self) -> None:
        """Send what the kernel takes of frames that belong to one message, for ever."""
        try:
            with suppress(BlockingIOError):
                data = self.connection.recv(65_536)
                self.is_alive = self.is_alive and data != b""
                self.came = (self.came + data)[:200]
            for _ in range(200):
                if not self.unsent:
                    if b"READY" not in self.came:
                        return
                    self.unsent, self.greeting = self.greeting, b""
                if not self.unsent:
                    self.unsent = self.MORE_LONG + struct.pack(">Q", FRAME) + bytes(FRAME)
                count = self.connection.send(self.unsent)
                self.unsent = self.unsent[count:]
                self.sent += count
        except BlockingIOError:
            pass
        except OSError:
            self.is_alive = False


def flood_until_ended(raw: Raw, peer: Peer) -> None:
    def ended() -> bool:
        raw.turn()
        assert raw.sent < ENOUGH
        return not raw.is_alive

    run_until(ended, "the end of the connection", peer)


@pytest.mark.parametrize("greets", [True, False])
def test_a_peer_that_never_ends_a_message_is_shut(start: Callable[..., Peer], greets: bool) -> None:
    port = free_port()
    graph_end, environment_end = ends(port, secure=False)
    graph, friend = start(graph_end), start(environment_end)
    meet(graph, friend)
    with closing(socket.create_connection(("127.0.0.1", port))) as connection:
        raw = Raw(connection, b"DEALER")
        if greets:
            raw.greeting = b"\x00\x00"  # an empty message
        flood_until_ended(raw, graph)
    assert "without the end of a message" in graph.text("protocol_error")
    meet(graph, friend)


def test_a_listener_that_never_ends_a_message_is_left(start: Callable[..., Peer]) -> None:
    with closing(socket.create_server(("127.0.0.1", 0))) as server:
        _, environment_end = ends(server.getsockname()[1], secure=False)
        environment = start(environment_end)
        with closing(server.accept()[0]) as connection:
            flood_until_ended(Raw(connection, b"ROUTER"), environment)
    run_until(lambda: "protocol_error" in environment.kinds(), "a word", environment)


def test_whole_messages_are_no_such_flood(start: Callable[..., Peer]) -> None:
    graph, environment = (start(end) for end in ends(free_port()))
    meet(graph, environment)
    sent = 0
    while sent < 3 * MAX_UNFINISHED:
        for _ in range(10):
            environment.link.send(bytes(FRAME))
            sent += FRAME
        run_for(0.005, graph, environment)
    assert not {"protocol_error", "disconnected"} & graph.kinds()


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
    """Leave this process only a few more descriptors."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    in_use = len(list(Path("/proc/self/fd").iterdir()))
    resource.setrlimit(resource.RLIMIT_NOFILE, (in_use + left, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))


def test_the_limit_is_not_that_of_a_time_without_descriptors() -> None:
    port = free_port()
    with few_descriptors(60), Network() as network, ExitStack() as opened:
        link = RemoteLink(network, ends(port)[0])
        with ExitStack() as taken:  # before the first look
            with suppress(OSError):
                while True:
                    taken.callback(os.close, os.open(os.devnull, os.O_RDONLY))
            notices = link.watch(time.monotonic_ns())
        for _ in range(5):
            opened.enter_context(closing(socket.create_connection(("127.0.0.1", port))))
        end = time.monotonic() + PATIENCE
        while link.status()["connections"] < 5:
            assert time.monotonic() < end, notices
            notices += link.watch(time.monotonic_ns())
            time.sleep(1e-3)
        assert not {"too_many_connections", "socket_error"} & {notice.kind for notice in notices}


def test_connections_that_use_up_the_descriptors_are_shut(start: Callable[..., Peer]) -> None:
    port = free_port()
    graph_end, environment_end = ends(port)
    with few_descriptors(60):
        graph, environment = start(graph_end), start(environment_end)
        meet(graph, environment)
        idle = subprocess.Popen(
            [sys.executable, "-c", IDLE, str(port), "200"], stdin=subprocess.PIPE
        )
        try:
            run_until(lambda: "too_many_connections" in graph.kinds(), "a word", graph, environment)
            before = graph.link.status()["counts"]["too_many_connections"]
            run_until(
                lambda: graph.link.status()["counts"]["too_many_connections"] > before + 20,
                "more of them to be shut",
                graph,
                environment,
            )
            meet(graph, environment)
            assert graph.link.status()["connections"] < 60
        finally:
            idle.kill()
            idle.communicate()
