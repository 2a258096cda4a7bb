"""The link to another machine: sockets on loopback, both ways, restarts, addresses, notices."""

import re
import socket
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from remote_peers import GRAPH, SERVER, Peer, ends, meet, open_peers, run_for, run_until
from tcp_tap import TcpTap
from waiting import free_port

from forcebound.errors import ConfigError
from forcebound.network.ends import RemoteEnd, RemoteSection
from forcebound.network.keys import new_key
from forcebound.network.notices import BURST, PROBLEMS, WINDOW_NS, Notice, NoticeLimit
from forcebound.network.remote import RemoteLink
from forcebound.network.sockets import Network

BURST_SIZE = 30  # packets: below the send queue less the half of it that may be unacknowledged


@pytest.fixture
def start() -> Iterator[Callable[..., Peer]]:
    with open_peers() as start:
        yield start


@pytest.mark.parametrize(
    ("address", "listens", "secure"),
    [
        ("127.0.0.1", "graph", True),
        ("[::1]", "environment", True),
        ("localhost", "graph", False),
        ("127.0.0.1", "environment", False),
    ],
)
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


@pytest.mark.parametrize("restarted", [0, 1])
def test_either_end_may_restart(start: Callable[..., Peer], restarted: int) -> None:
    both = ends(free_port())
    peers = [start(end) for end in both]
    meet(*peers)
    stays = peers[1 - restarted]
    peers[restarted].close()
    run_until(lambda: "disconnected" in stays.kinds(), "the loss", stays)
    peers[restarted] = start(both[restarted])
    meet(*peers)


def test_every_packet_is_given_in_its_order(start: Callable[..., Peer]) -> None:
    graph, environment = (start(end) for end in ends(free_port()))
    meet(graph, environment)
    run_for(0.05, graph, environment)
    graph.got.clear()
    for number in range(BURST_SIZE):
        environment.link.send(b"%d" % number)
    run_until(lambda: b"%d" % (BURST_SIZE - 1) in graph.got, "the last", graph)
    assert graph.got == [b"%d" % number for number in range(BURST_SIZE)]


def test_a_peer_that_hangs_is_found(start: Callable[..., Peer]) -> None:
    graph_end, environment_end = ends(free_port())
    port = free_port()
    with TcpTap(port, graph_end.port) as tap:
        peers = start(graph_end), start(replace(environment_end, port=port))
        run_until(lambda: all(peer.link.connected for peer in peers), "a connection", *peers)
        tap.is_held = True  # a peer that hangs, or a network that is gone
        run_until(
            lambda: all("disconnected" in peer.kinds() for peer in peers), "heartbeats", *peers
        )
        for peer in peers:
            assert not peer.link.connected
            assert "silent" in peer.text("disconnected")


def test_what_is_sent_cannot_be_read_on_the_way(start: Callable[..., Peer]) -> None:
    graph_end, environment_end = ends(free_port())
    port = free_port()
    with TcpTap(port, graph_end.port) as tap:
        graph, environment = start(graph_end), start(replace(environment_end, port=port))

        def heard() -> bool:
            graph.link.send(b"position of the hand")
            environment.link.send(b"force of the wall")
            return bool(graph.got and environment.got)

        run_until(heard, "packets through the tap", graph, environment)
    assert b"CURVE" in tap.seen
    assert b"hand" not in tap.seen
    assert b"wall" not in tap.seen


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
        ("", "is not an address"),
        ("fd00::1::2", "is not an address"),
        ("1.2.3.4/24", "is not an address"),
    ],
)
def test_an_address_that_cannot_be_used_says_so(address: str, word: str) -> None:
    end = replace(ends(7410)[0], address=address)
    with Network() as network, pytest.raises(ConfigError, match=word):
        RemoteLink(network, end)


def test_a_port_in_use_is_said_and_leaves_nothing_open() -> None:
    port = free_port()
    with (
        Network() as network,
        socket.create_server(("127.0.0.1", port)),
        pytest.raises(ConfigError, match=rf":{port}: the address is in use"),
    ):
        RemoteLink(network, ends(port)[0])
    with Network() as network:
        RemoteLink(network, ends(port)[0])


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
    assert RemoteSection("127.0.0.1", insecure=True).end("graph").key is None


def test_a_flood_of_notices_is_counted_and_summed_up() -> None:
    limit = NoticeLimit()
    flood = [Notice("refused_here", f"refused stranger {number}") for number in range(1000)]
    assert limit.admit(0, flood) == flood[:BURST]
    friend = Notice("connected", "a friend")
    assert limit.admit(1, [friend]) == [friend]
    (summary,) = limit.admit(WINDOW_NS, [])
    assert "998 more like this within 10 s; the last: refused stranger 999" in summary.message
    assert summary.data["suppressed"] == "997"
    assert limit.admit(2 * WINDOW_NS, []) == []
    assert limit.counts == {"refused_here": 1000, "connected": 1}
    assert limit.admit(3 * WINDOW_NS, flood[:1]) == flood[:1]


def test_every_kind_of_notice_is_documented() -> None:
    page = (Path(__file__).parent.parent / "docs" / "remote.md").read_text()
    table = page.partition("## Notices")[2]
    kinds = {"opened", "connected", "disconnected", *PROBLEMS}
    assert set(re.findall(r"^\| `(\w+)`", table, re.MULTILINE)) == kinds
