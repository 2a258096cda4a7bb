"""The link to another machine: sockets on loopback, permitted and other peers, invalid bytes."""

import os
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import closing, suppress
from dataclasses import replace
from pathlib import Path

import pytest
import zmq
from waiting import PATIENCE, free_port

from forcebound.errors import ConfigError
from forcebound.network import limits, sockets
from forcebound.network.ends import RemoteEnd, RemoteSection
from forcebound.network.keys import KeyPair, new_key
from forcebound.network.notices import (
    BURST,
    KINDS,
    SENTENCES,
    WINDOW_NS,
    Notice,
    NoticeLimit,
)
from forcebound.network.remote import RemoteLink
from forcebound.network.sockets import Network


def pair(name: str) -> KeyPair:
    public, secret = (key.decode() for key in zmq.curve_keypair())
    return KeyPair(name, public, secret)


BURST_SIZE = 30  # packets: below the send queue less the half of it that may be unacknowledged

GRAPH, SERVER, STRANGER = pair("device-lab"), pair("server-lab"), pair("stranger")


class Peer:
    """One end, in a network of its own, and what it has said."""

    def __init__(self, end: RemoteEnd, newest_only: bool = True) -> None:
        self.network = Network()
        try:
            self.link = RemoteLink(self.network, end, newest_only)
        except ConfigError:
            self.network.close()
            raise
        self.first, *rest = self.link.watch(time.monotonic_ns())
        self.notices: list[Notice] = rest
        self.got: list[bytes] = []

    def turn(self) -> None:
        self.notices += self.link.watch(time.monotonic_ns())
        self.got += self.link.subscriber.receive()

    def kinds(self) -> set[str]:
        return {notice.kind for notice in self.notices}

    def text(self, kind: str) -> str:
        return "\n".join(notice.message for notice in self.notices if notice.kind == kind)

    def close(self) -> None:
        self.network.close()


@pytest.fixture
def start() -> Iterator[Callable[..., Peer]]:
    peers: list[Peer] = []

    def start(end: RemoteEnd, newest_only: bool = True) -> Peer:
        peers.append(Peer(end, newest_only))
        return peers[-1]

    yield start
    for peer in peers:
        peer.close()


def run_until(happened: Callable[[], bool], what: str, *peers: Peer) -> None:
    """Let some ends work until something has happened, in bounded time."""
    end = time.monotonic() + PATIENCE
    while not happened():
        said = [notice.message for peer in peers for notice in peer.notices]
        assert time.monotonic() < end, f"waited {PATIENCE} s for {what}; said: {said}"
        for peer in peers:
            peer.turn()
        descriptors = [d for peer in peers for d in peer.link.descriptors]
        sockets.wait(descriptors, 1_000_000)


def run_for(seconds: float, *peers: Peer) -> None:
    end = time.monotonic() + seconds
    run_until(lambda: time.monotonic() >= end, "the end of a while", *peers)


def meet(one: Peer, other: Peer) -> None:
    """Wait until packets pass in both directions."""
    one.got.clear()
    other.got.clear()

    def both_heard() -> bool:
        one.link.send(b"one")
        other.link.send(b"other")
        return b"other" in one.got and b"one" in other.got

    run_until(both_heard, "packets in both directions", one, other)


def ends(
    port: int, listens: str = "graph", address: str = "127.0.0.1", secure: bool = True
) -> tuple[RemoteEnd, RemoteEnd]:
    """Return the ends of a graph and of an environment that belong together."""
    graph = RemoteEnd("graph", listens == "graph", address, port)
    environment = RemoteEnd("environment", listens == "environment", address, port)
    if secure:
        graph = replace(graph, key=GRAPH, peers={SERVER.public: SERVER.name})
        environment = replace(environment, key=SERVER, peers={GRAPH.public: GRAPH.name})
    return graph, environment


@pytest.mark.parametrize("secure", [True, False])
@pytest.mark.parametrize("listens", ["graph", "environment"])
@pytest.mark.parametrize("address", ["127.0.0.1", "[::1]", "localhost"])
def test_packets_pass_in_both_directions(
    start: Callable[..., Peer], address: str, listens: str, secure: bool
) -> None:
    port = free_port("::1" if address == "[::1]" else "127.0.0.1")
    graph, environment = (start(end) for end in ends(port, listens, address, secure))
    meet(graph, environment)
    run_until(lambda: bool(graph.notices and environment.notices), "both logs", graph, environment)
    assert graph.link.connected
    assert environment.link.connected
    assert graph.kinds() == environment.kinds() == {"connected"}
    if secure:
        assert f"server-lab (key {SERVER.public})" in graph.text("connected")
        assert f"device-lab (key {GRAPH.public})" in environment.text("connected")


def test_the_end_that_connects_may_start_first(start: Callable[..., Peer]) -> None:
    graph_end, environment_end = ends(free_port())
    environment = start(environment_end)
    run_until(lambda: "no_answer" in environment.kinds(), "a word about it", environment)
    meet(start(graph_end), environment)


def test_the_listener_may_restart(start: Callable[..., Peer]) -> None:
    graph_end, environment_end = ends(free_port())
    graph, environment = start(graph_end), start(environment_end)
    meet(graph, environment)
    graph.close()
    run_until(lambda: "disconnected" in environment.kinds(), "the loss", environment)
    meet(start(graph_end), environment)
    assert "has gone" in environment.text("disconnected")


def test_the_other_end_may_restart(start: Callable[..., Peer]) -> None:
    graph_end, environment_end = ends(free_port())
    graph, environment = start(graph_end), start(environment_end)
    meet(graph, environment)
    environment.close()
    run_until(lambda: "disconnected" in graph.kinds(), "the loss", graph)
    assert "server-lab" in graph.text("disconnected")
    meet(graph, start(environment_end))


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
    assert "not in its list of who may connect" in guest.text("refused_there")
    for _ in range(20):
        both_have_said_so()
        run_for(0.02, host, guest)
    assert host.got == guest.got == []
    assert host.link.status()["peers"] == []


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
        return "other_security" in guest.kinds() and bool(graph.notices)

    run_until(noticed, "both logs", graph, guest)
    run_for(0.2, graph, guest)
    assert "keys (CURVE), and we do not" in guest.text("other_security")
    assert graph.kinds() <= {"other_security", "handshake_failed"}
    assert guest.got == []


def test_keys_where_the_listener_has_none_are_said(start: Callable[..., Peer]) -> None:
    graph_end, environment_end = ends(free_port())
    graph = start(replace(graph_end, key=None, peers={}))
    guest = start(environment_end)
    wanted = {"other_security", "wrong_key_there"}
    run_until(lambda: bool(guest.kinds() & wanted), "the log", graph, guest)
    assert "no keys" in guest.text("other_security") + guest.text("wrong_key_there")
    assert not guest.link.connected


def test_a_wrong_key_of_the_listener_is_said_and_not_hammered(start: Callable[..., Peer]) -> None:
    graph_end, environment_end = ends(free_port())
    graph = start(graph_end)
    guest = start(replace(environment_end, peers={STRANGER.public: "device-lab"}))
    run_until(
        lambda: "wrong_key_of_ours" in graph.kinds() and "wrong_key_there" in guest.kinds(),
        "both logs",
        graph,
        guest,
    )
    assert STRANGER.public in guest.text("wrong_key_there")
    run_for(0.4, graph, guest)  # libzmq alone would have tried 20 times
    assert guest.link.status()["counts"]["wrong_key_there"] <= 6
    assert guest.got == []


def test_silence_ends_with_the_handshake_time(start: Callable[..., Peer]) -> None:
    port = free_port()
    graph = start(ends(port)[0])
    with closing(socket.create_connection(("127.0.0.1", port))) as silent:
        silent.settimeout(PATIENCE)
        run_until(lambda: "handshake_timeout" in graph.kinds(), "the time limit", graph)
        assert silent.recv(64)[:1] == b"\xff"  # the greeting, which is the same for everybody
        assert silent.recv(64) == b""


@pytest.mark.parametrize("rubbish", [b"GET / HTTP/1.0\r\n\r\n", b"\0" * 300, os.urandom(5000)])
def test_rubbish_is_said_and_harms_nobody(start: Callable[..., Peer], rubbish: bytes) -> None:
    graph_end, environment_end = ends(free_port())
    graph = start(graph_end)
    with closing(socket.create_connection(("127.0.0.1", graph_end.port))) as stranger:
        stranger.sendall(rubbish)
    run_until(lambda: bool(graph.notices), "the log", graph)
    assert graph.kinds() <= {"handshake_failed", "other_security"}
    meet(graph, start(environment_end))


@pytest.mark.parametrize("address", ["127.0.0.1", "[::1]"])
def test_hundreds_of_connections_are_cut_down_and_a_friend_still_comes(
    start: Callable[..., Peer], address: str
) -> None:
    host = address.strip("[]")
    graph_end, environment_end = ends(free_port(host), address=address)
    graph = start(graph_end)
    friend = start(environment_end)
    meet(graph, friend)
    crowd: list[socket.socket] = []
    try:
        for _ in range(300):
            crowd.append(socket.create_connection((host, graph_end.port), timeout=PATIENCE))
            graph.turn()
            friend.turn()
        run_for(0.1, graph, friend)
        assert graph.link.status()["counts"]["too_many_connections"] > BURST
        assert graph.link.status()["connections"] <= limits.MAX_CONNECTIONS
        assert len([n for n in graph.notices if n.kind == "too_many_connections"]) == BURST
        assert graph.link.connected
        assert friend.link.connected
        meet(graph, friend)
        assert "disconnected" not in graph.kinds() | friend.kinds()
        friend.close()
        meet(graph, start(environment_end))
    finally:
        for stranger in crowd:
            stranger.close()


def test_more_friends_than_a_port_takes_are_refused_with_a_word(
    start: Callable[..., Peer], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(limits, "MAX_PEERS", 1)
    graph_end, environment_end = ends(free_port())
    graph, first = start(graph_end), start(environment_end)
    meet(graph, first)
    second = start(environment_end)
    run_until(lambda: "refused_there" in second.kinds(), "the word", graph, first, second)
    assert "as many connections as it takes" in second.text("refused_there")
    assert "as many peers as it takes" in graph.text("too_many_connections")
    meet(graph, first)


def test_a_monitor_that_nobody_reads_stops_nothing(start: Callable[..., Peer]) -> None:
    graph_end, environment_end = ends(free_port())
    graph, friend = start(graph_end), start(environment_end)
    meet(graph, friend)
    for _ in range(1500):  # three events each; ZeroMQ's queue holds 2000 by default
        socket.create_connection(("127.0.0.1", graph_end.port), timeout=PATIENCE).close()
    graph.got.clear()

    def heard() -> bool:
        friend.link.send(b"still here")
        graph.got += graph.link.subscriber.receive()
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


@pytest.mark.parametrize("newest_only", [True, False])
def test_a_message_of_several_frames_is_one_malformed_packet(
    start: Callable[..., Peer], bad_peer: Callable[[RemoteEnd], BadPeer], newest_only: bool
) -> None:
    graph_end, environment_end = ends(free_port())
    graph = start(graph_end, newest_only)
    bad = bad_peer(environment_end)

    def heard() -> bool:
        bad.send(b"good")
        return b"good" in graph.got

    run_until(heard, "the peer", graph)
    run_for(0.05, graph)
    graph.got.clear()
    for _ in range(20_000):  # with CONFLATE this ends the process: Assertion failed: !_more
        bad.send(b"good", b"good", b"good")
        graph.got += graph.link.subscriber.receive()
    run_until(lambda: b"" in graph.got, "the bad messages", graph)
    assert set(graph.got) == {b""}


@pytest.mark.parametrize("listens", ["graph", "environment"])
def test_a_message_that_is_too_large_ends_the_connection_which_comes_back(
    start: Callable[..., Peer], bad_peer: Callable[[RemoteEnd], BadPeer], listens: str
) -> None:
    graph_end, environment_end = ends(free_port(), listens)
    graph = start(graph_end)
    bad = bad_peer(environment_end)

    def heard() -> bool:
        bad.send(b"good")
        return b"good" in graph.got

    run_until(lambda: heard() and graph.link.connected, "the peer", graph)
    bad.send(bytes(limits.MAX_FRAME + 1))
    word = "disconnected" if listens == "graph" else "protocol_error"
    run_until(lambda: word in graph.kinds(), "a word", graph)
    assert str(limits.MAX_FRAME) in graph.text(word)
    graph.got.clear()
    run_until(heard, "the peer again", graph)
    assert set(graph.got) == {b"good"}


def test_only_the_newest_packet_counts_and_the_others_are_counted(
    start: Callable[..., Peer],
) -> None:
    graph, environment = (start(end) for end in ends(free_port()))
    meet(graph, environment)
    run_for(0.05, graph, environment)
    before = graph.link.subscriber.superseded
    for number in range(BURST_SIZE):
        environment.link.send(b"%d" % number)
    graph.got.clear()
    run_until(lambda: b"%d" % (BURST_SIZE - 1) in graph.got, "the newest", graph)
    assert len(graph.got) + graph.link.subscriber.superseded - before == BURST_SIZE
    assert graph.link.subscriber.take() is None
    assert graph.link.subscriber.receive() == []


def test_all_packets_are_given_if_a_link_model_wants_them(start: Callable[..., Peer]) -> None:
    graph_end, environment_end = ends(free_port())
    graph, environment = start(graph_end, False), start(environment_end)
    meet(graph, environment)
    run_for(0.05, graph, environment)
    graph.got.clear()
    for number in range(BURST_SIZE):
        environment.link.send(b"%d" % number)
    run_until(lambda: b"%d" % (BURST_SIZE - 1) in graph.got, "the last", graph)
    assert graph.got == [b"%d" % number for number in range(BURST_SIZE)]


def test_a_peer_that_hangs_is_found(start: Callable[..., Peer]) -> None:
    # A proxy that stops passing bytes on is a peer that hangs, or a network that is gone.
    graph_end, environment_end = ends(free_port())
    graph = start(graph_end)
    port = free_port()
    proxy = Proxy(port, graph_end.port)
    try:
        environment = start(replace(environment_end, port=port))
        proxy.peers = (graph, environment)
        run_until(
            lambda: proxy.pump() and graph.link.connected,
            "a connection through the proxy",
            graph,
            environment,
        )
        run_until(
            lambda: all("disconnected" in peer.kinds() for peer in (graph, environment)),
            "heartbeats to find it",
            graph,
            environment,
        )
        assert not graph.link.connected
        assert not environment.link.connected
        assert "silent" in graph.text("disconnected")
        assert "silent" in environment.text("disconnected")
    finally:
        proxy.close()


class Proxy:
    """Passes bytes on while it is pumped."""

    def __init__(self, port: int, target: int) -> None:
        self._listener = socket.create_server(("127.0.0.1", port))
        self._listener.setblocking(False)
        self._target = target
        self._pairs: list[tuple[socket.socket, socket.socket]] = []
        self.seen = b""
        self.peers: tuple[Peer, ...] = ()

    def pump(self) -> bool:
        try:
            incoming, _ = self._listener.accept()
        except BlockingIOError:
            pass
        else:
            outgoing = socket.create_connection(("127.0.0.1", self._target))
            for one in (incoming, outgoing):
                one.setblocking(False)
            self._pairs += [(incoming, outgoing), (outgoing, incoming)]
        for source, sink in self._pairs:
            try:
                data = source.recv(65536)
                sink.sendall(data)
            except OSError:
                continue
            self.seen += data
        return True

    def close(self) -> None:
        self._listener.close()
        for source, _ in self._pairs:
            source.close()


def test_what_is_sent_cannot_be_read_on_the_way(start: Callable[..., Peer]) -> None:
    graph_end, environment_end = ends(free_port())
    graph = start(graph_end)
    port = free_port()
    proxy = Proxy(port, graph_end.port)
    try:
        environment = start(replace(environment_end, port=port))

        def heard() -> bool:
            proxy.pump()
            graph.link.send(b"position of the hand")
            environment.link.send(b"force of the wall")
            return bool(graph.got and environment.got)

        run_until(heard, "packets through the proxy", graph, environment)
        on_the_way = proxy.seen
        assert b"CURVE" in on_the_way
        assert b"hand" not in on_the_way
        assert b"wall" not in on_the_way
    finally:
        proxy.close()


def test_a_remote_link_leaves_ipc_in_the_same_process_alone(
    start: Callable[..., Peer], tmp_path: Path
) -> None:
    graph = start(ends(free_port())[0])
    publisher = graph.network.publisher(f"ipc://{tmp_path}/a")
    subscriber = graph.network.subscriber(f"ipc://{tmp_path}/a", newest_only=True)

    def heard() -> bool:
        publisher.send(b"local")
        return bool(subscriber.receive())

    run_until(heard, "a local packet", graph)


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


def test_insecure_listens_everywhere_without_keys(start: Callable[..., Peer]) -> None:
    port = free_port()
    graph = start(RemoteEnd("graph", True, "0.0.0.0", port, insecure=True))
    environment = start(RemoteEnd("environment", False, "127.0.0.1", port))
    meet(graph, environment)


@pytest.mark.parametrize(
    ("address", "word"),
    [
        ("192.0.2.77", "no network interface of this machine has this address"),
        ("no-such-host.invalid", "cannot find the address 'no-such-host.invalid'"),
        ("", "is no address"),
        ("fd00::1::2", "is no address"),
        ("1.2.3.4/24", "is no address"),
    ],
)
def test_an_address_that_cannot_be_used_says_so(address: str, word: str) -> None:
    end = replace(ends(7410)[0], address=address)
    with Network() as network, pytest.raises(ConfigError, match=word):
        RemoteLink(network, end)


def test_a_port_in_use_is_said_and_leaves_nothing_open() -> None:
    port = free_port()
    with Network() as network:
        with (
            socket.create_server(("127.0.0.1", port)),
            pytest.raises(ConfigError, match=rf":{port}: the address is in use"),
        ):
            RemoteLink(network, ends(port)[0])
        graph = ends(port)[0]
        end = time.monotonic() + PATIENCE
        while True:  # ZeroMQ gives the other port back when it finds the time
            try:
                RemoteLink(network, graph)
            except ConfigError:
                assert time.monotonic() < end
                sockets.wait((), 1_000_000)
            else:
                return


def test_an_end_that_does_not_fit_together_is_refused() -> None:
    graph, _ = ends(7410)
    with pytest.raises(ConfigError, match="keys are used by both ends or by none"):
        replace(graph, key=None)
    with pytest.raises(ConfigError, match="keys are used by both ends or by none"):
        replace(graph, peers={})
    section = RemoteSection("127.0.0.1", graph_key="lab", environment_keys=("server",))
    with pytest.raises(ConfigError, match="a graph that connects can expect only one"):
        replace(section, listens="environment", environment_keys=("a", "b"))
    with pytest.raises(ConfigError, match="insecure: true means no keys"):
        replace(section, insecure=True)
    with pytest.raises(ConfigError, match="port must be 1 to 65535"):
        replace(section, port=65536)


def test_the_same_section_gives_both_ends_their_keys(tmp_path: Path) -> None:
    for machine, own, other in (("a", "lab", "server"), ("b", "server", "lab")):
        (tmp_path / machine).mkdir(mode=0o700)
        new_key(own, tmp_path / machine)
        public = f"{own}.key"
        (tmp_path / f"of-{other}").mkdir(mode=0o700)
        (tmp_path / f"of-{other}" / public).write_text((tmp_path / machine / public).read_text())
    for machine, other in (("a", "server"), ("b", "lab")):
        own = "lab" if machine == "a" else "server"
        text = (tmp_path / f"of-{own}" / f"{other}.key").read_text()
        (tmp_path / machine / f"{other}.key").write_text(text)
    section = RemoteSection("127.0.0.1", graph_key="lab", environment_keys=("server",))
    graph = section.end("graph", tmp_path / "a")
    environment = section.end("environment", tmp_path / "b")
    assert graph.listens
    assert not environment.listens
    assert graph.key is not None
    assert environment.key is not None
    assert environment.peers == {graph.key.public: "lab"}
    assert graph.peers == {environment.key.public: "server"}
    by_key = replace(
        section, graph_key=graph.key.public, environment_keys=(environment.key.public,)
    )
    assert by_key.end("environment", tmp_path / "b").key == environment.key
    with pytest.raises(
        ConfigError, match=r"no secret key 'server': looked for .*server.key_secret"
    ):
        section.end("environment", tmp_path / "a")
    with pytest.raises(ConfigError, match="environment_keys is missing"):
        RemoteSection("127.0.0.1", graph_key="lab")
    twice = replace(section, environment_keys=("server", environment.key.public))
    with pytest.raises(ConfigError, match="a key is named twice"):
        twice.end("graph", tmp_path / "a")
    new_key("second", tmp_path / "b")
    several = replace(section, environment_keys=("server", "second"))
    with pytest.raises(ConfigError, match="secrets of several"):
        several.end("environment", tmp_path / "b")
    assert RemoteSection("127.0.0.1").end("graph").key is None


def test_a_flood_of_notices_is_counted_and_summed_up() -> None:
    limit = NoticeLimit()
    flood = [Notice("no_key", {"address": f"stranger {number}"}) for number in range(1000)]
    assert limit.admit(0, flood) == flood[:BURST]
    friend = Notice("came", {"address": "friend"})
    assert limit.admit(1, [friend]) == [friend]
    (summary,) = limit.admit(WINDOW_NS, [])
    assert summary.message.startswith("998 more like this within 10 s: refused stranger 999")
    assert limit.admit(2 * WINDOW_NS, []) == []
    assert limit.counts == {"refused_here": 1000, "connected": 1}
    assert limit.admit(3 * WINDOW_NS, flood[:1]) == flood[:1]


def test_each_end_says_at_first_where_it_is(start: Callable[..., Peer]) -> None:
    graph_end, environment_end = ends(free_port())
    where = f"127.0.0.1 port {graph_end.port}"
    graph, environment = start(graph_end).first, start(environment_end).first
    words = f"listening at {where}, with the key device-lab; no peer yet"
    assert (graph.kind, graph.message) == ("listening", words)
    assert environment.message == f"connecting to {where}, with the key server-lab"
    assert not graph.is_problem
    assert not environment.is_problem


def test_every_sentence_is_of_a_documented_kind() -> None:
    page = (Path(__file__).parent.parent / "docs" / "remote.md").read_text()
    assert {kind for kind, _ in SENTENCES.values()} == set(KINDS)
    for kind in KINDS:
        assert f"`{kind}`" in page
