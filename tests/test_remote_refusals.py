"""The link to another machine: peers that are refused, and invalid bytes."""

import os
import random
import resource
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import closing, suppress
from dataclasses import replace

import pytest
import zmq
from remote_peers import GRAPH, SERVER, STRANGER, Peer, ends, meet, open_peers, run_for, run_until
from waiting import TIMEOUT, free_port

from forcebound.errors import ConfigError
from forcebound.network import limits
from forcebound.network.ends import RemoteEnd
from forcebound.network.notices import BURST
from forcebound.network.remote import RemoteLink
from forcebound.network.sockets import Network


@pytest.fixture
def start() -> Iterator[Callable[..., Peer]]:
    with open_peers() as start:
        yield start


@pytest.mark.parametrize("listens", ["graph", "environment"])
def test_an_unknown_key_gets_no_byte_and_both_ends_say_why(
    start: Callable[..., Peer], listens: str
) -> None:
    graph_end, environment_end = ends(free_port(), listens)
    if listens == "graph":
        host, guest = start(graph_end), start(replace(environment_end, key=STRANGER))
    else:
        host, guest = start(environment_end), start(replace(graph_end, key=STRANGER))

    def both_have_said_so() -> bool:
        host.link.send(b"secret")
        guest.link.send(b"forged")
        return "refused_here" in host.kinds() and "refused_there" in guest.kinds()

    run_until(both_have_said_so, "both logs", host, guest)
    assert STRANGER.public in host.text("refused_here")
    assert "127.0.0.1" in host.text("refused_here")
    assert STRANGER.public in guest.text("refused_there")
    for _ in range(20):
        both_have_said_so()
        run_for(0.02, host, guest)
    assert host.got == guest.got == []
    assert host.link.status().peers == []


def test_a_refused_peer_comes_in_once_it_is_allowed(start: Callable[..., Peer]) -> None:
    graph_end, environment_end = ends(free_port())
    graph = start(replace(graph_end, peers={STRANGER.public: "another"}))
    environment = start(environment_end)
    run_until(lambda: "refused_there" in environment.kinds(), "the refusal", graph, environment)
    graph.close()
    meet(start(graph_end), environment)


def test_a_peer_without_keys_gets_no_byte(start: Callable[..., Peer]) -> None:
    graph_end, environment_end = ends(free_port())
    graph = start(graph_end)
    guest = start(replace(environment_end, key=None, peers={}))

    def noticed() -> bool:
        graph.link.send(b"secret")
        return "handshake_failed" in graph.kinds() & guest.kinds()

    run_until(noticed, "both logs", graph, guest)
    run_for(0.2, graph, guest)
    assert "uses keys (CURVE)" in guest.text("handshake_failed")
    assert guest.got == []


def test_keys_where_the_listener_has_none_are_said(start: Callable[..., Peer]) -> None:
    graph_end, environment_end = ends(free_port())
    graph = start(replace(graph_end, key=None, peers={}))
    guest = start(environment_end)
    run_until(lambda: "handshake_failed" in guest.kinds(), "the log", graph, guest)
    assert "no keys" in guest.text("handshake_failed")
    assert not guest.link.connected


def test_a_wrong_key_of_the_listener_is_said_and_not_hammered(start: Callable[..., Peer]) -> None:
    graph_end, environment_end = ends(free_port())
    graph = start(graph_end)
    guest = start(replace(environment_end, peers={STRANGER.public: "device-lab"}))
    run_until(
        lambda: "handshake_failed" in graph.kinds() & guest.kinds(),
        "both logs",
        graph,
        guest,
    )
    assert STRANGER.public in guest.text("handshake_failed")
    run_for(0.4, graph, guest)  # libzmq alone would have tried 20 times
    assert guest.link.status().counts["handshake_failed"] <= 6
    assert guest.got == []


def test_silence_ends_with_the_handshake_time(start: Callable[..., Peer]) -> None:
    port = free_port()
    graph = start(ends(port)[0])
    with closing(socket.create_connection(("127.0.0.1", port))) as silent:
        silent.settimeout(TIMEOUT)
        run_until(lambda: "handshake_failed" in graph.kinds(), "the time limit", graph)
        assert silent.recv(64)[:1] == b"\xff"  # the greeting, which is the same for everybody
        assert silent.recv(64) == b""


@pytest.mark.parametrize(
    "rubbish",
    [b"GET / HTTP/1.0\r\n\r\n", random.Random(1).randbytes(5000)],
    ids=["http", "noise"],
)
def test_rubbish_is_said_and_harms_nobody(start: Callable[..., Peer], rubbish: bytes) -> None:
    graph_end, environment_end = ends(free_port())
    graph = start(graph_end)
    with closing(socket.create_connection(("127.0.0.1", graph_end.port))) as stranger:
        stranger.sendall(rubbish)
    run_until(lambda: bool(graph.notices), "the log", graph)
    assert graph.kinds() == {"handshake_failed"}
    meet(graph, start(environment_end))


FLOOD = """
import socket, sys
strangers = [socket.socket() for _ in range(500)]
for stranger in strangers:
    stranger.setblocking(False)
    stranger.connect_ex(("127.0.0.1", int(sys.argv[1])))
print(flush=True)
sys.stdin.read()
"""


@pytest.fixture
def few_descriptors() -> Iterator[Callable[[], None]]:
    """Give what lets this process open only some 30 descriptors more."""
    limits_before = resource.getrlimit(resource.RLIMIT_NOFILE)
    highest = max(map(int, os.listdir("/proc/self/fd")))

    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_NOFILE, (highest + 30, limits_before[1]))

    yield limit
    resource.setrlimit(resource.RLIMIT_NOFILE, limits_before)


def test_a_flood_that_takes_all_descriptors_harms_no_peer_and_leaves_the_port_open(
    start: Callable[..., Peer], few_descriptors: Callable[[], None]
) -> None:
    graph_end, environment_end = ends(free_port())
    graph, friend = start(graph_end), start(environment_end)
    meet(graph, friend)
    command = [sys.executable, "-c", FLOOD, str(graph_end.port)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as flood:
        assert flood.stdin is not None
        assert flood.stdout is not None
        few_descriptors()
        flood.stdout.readline()
        # No byte of the flood has come; each connection ends with its handshake time.
        run_until(lambda: graph.kinds() >= {"handshake_failed"}, "the first end", graph, friend)
        meet(graph, friend)
        assert "disconnected" not in graph.kinds() | friend.kinds()
        flood.stdin.close()
    friend.close()
    run_until(lambda: not graph.link.connected, "the friend's leaving", graph)
    meet(graph, start(environment_end))


def test_a_monitor_that_nobody_reads_stops_nothing(start: Callable[..., Peer]) -> None:
    graph_end, environment_end = ends(free_port())
    graph, friend = start(graph_end), start(environment_end)
    meet(graph, friend)
    for _ in range(1500):  # three events each; ZeroMQ's queue holds 2000 by default
        socket.create_connection(("127.0.0.1", graph_end.port), timeout=TIMEOUT).close()
    graph.got.clear()

    def heard() -> bool:
        friend.link.send(b"still here")
        graph.got += [data for _, data in graph.link.channel.receive()]
        return b"still here" in graph.got

    run_until(heard, "a packet while the monitor is full", friend)
    run_until(lambda: graph.link.due_ns > time.monotonic_ns(), "the events", graph)
    assert sum(n.kind == "handshake_failed" for n in graph.notices) <= 2 * BURST + 2
    meet(graph, friend)


class BadPeer:
    """A socket that holds the environment's key, sends replies and behaves badly."""

    def __init__(self, context: "zmq.Context[zmq.Socket[bytes]]", end: RemoteEnd) -> None:
        self._end = end
        self._route: list[bytes] = []
        kind = zmq.ROUTER if end.listens else zmq.DEALER
        self._socket = context.socket(kind, socket_class=zmq.Socket)
        self._socket.set(zmq.LINGER, 0)
        self._socket.set(zmq.CURVE_PUBLICKEY, SERVER.public.encode())
        self._socket.set(zmq.CURVE_SECRETKEY, SERVER.secret.encode())
        address = f"tcp://{end.address}:{end.port}"
        if end.listens:
            self._socket.set(zmq.CURVE_SERVER, 1)
            self._socket.bind(address)
        else:
            self._socket.set(zmq.CURVE_SERVERKEY, GRAPH.public.encode())
            self._socket.connect(address)

    def send(self, *frames: bytes) -> None:
        while self._end.listens and self._socket.poll(0):
            self._route = self._socket.recv_multipart()[:1]
        with suppress(zmq.Again):
            if self._route or not self._end.listens:
                self._socket.send_multipart([*self._route, *frames], zmq.DONTWAIT)

    def close(self) -> None:
        self._socket.close()


@pytest.fixture
def bad_peer() -> Iterator[Callable[[RemoteEnd], BadPeer]]:
    context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
    made: list[BadPeer] = []

    def make(end: RemoteEnd) -> BadPeer:
        made.append(BadPeer(context, end))
        return made[-1]

    yield make
    for one in made:
        one.close()
    context.term()


@pytest.mark.parametrize("listens", ["graph", "environment"])
def test_a_message_that_is_too_large_ends_the_connection_which_comes_back(
    start: Callable[..., Peer], bad_peer: Callable[[RemoteEnd], BadPeer], listens: str
) -> None:
    graph_end, environment_end = ends(free_port(), listens)
    graph = start(graph_end)
    bad = bad_peer(environment_end)

    def heard() -> bool:
        bad.send(b"good")
        return b"good" in graph.got and graph.link.connected

    run_until(heard, "the peer", graph)
    bad.send(bytes(limits.MAX_FRAME + 1))
    run_until(lambda: "disconnected" in graph.kinds(), "a notice", graph)
    assert str(limits.MAX_FRAME) in graph.text("disconnected")
    graph.got.clear()
    run_until(heard, "the peer again", graph)
    assert set(graph.got) == {b"good"}


@pytest.mark.parametrize("listens", [True, False])
@pytest.mark.parametrize("address", ["192.0.2.1", "0.0.0.0", "[2001:db8::1]"])
def test_without_keys_no_other_machine_is_reached(address: str, listens: bool) -> None:
    with Network() as network, pytest.raises(ConfigError) as caught:
        RemoteLink(network, RemoteEnd("graph", listens, address, 7410))
    if listens or address != "0.0.0.0":
        assert "forcebound keys new" in str(caught.value)
        assert "insecure: true" in str(caught.value)
    else:
        assert "address of the other machine" in str(caught.value)
