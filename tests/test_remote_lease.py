"""Which peer of a remote link may answer: the lease and what attackers with a key try."""

import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial

import pytest
from builders import MS
from remote_peers import SERVER, STRANGER, Peer, ends, meet, open_peers, run_until
from waiting import free_port

from forcebound.haptics.controllers.direct import DirectController
from forcebound.messages.codec import encode
from forcebound.messages.packets import (
    EnergyTransfer,
    EnvironmentReply,
    Event,
    ForceCommand,
    Packet,
)
from forcebound.messages.topology import HAND, ONE_HAND
from forcebound.network.impairment import Impairment
from forcebound.network.link import Link
from forcebound.nodes.controller import ControllerNode
from forcebound.nodes.lease import LEASE_NS
from forcebound.run.process.inbox import Inbox

TRUE, FALSE = 1.0, -1.0  # N, forces of the environment that serves and of the other one


@pytest.fixture
def start() -> Iterator[Callable[..., Peer]]:
    with open_peers() as peers:
        yield peers


def reply(seq: int, environment: str, force: float) -> EnvironmentReply:
    return EnvironmentReply(seq, seq * MS, seq, seq * MS, seq, seq * MS, (force,), environment)


RECEIVED = {
    route: one
    for route, one in ONE_HAND.routes("controller").items()
    if one.receiver == "controller"
}


class Graph:
    """A controller behind a peer that listens; its time passes with its turns."""

    def __init__(self, peer: Peer, links: dict[str, Link[Packet]]) -> None:
        self.node = ControllerNode(DirectController())
        self.node.events.is_logged = False
        self.inbox = Inbox(RECEIVED, links, self._reject, self.node.admit)
        self.forwarded: list[bytes] = []
        self.inbox.listen_remotely(EnvironmentReply, HAND, peer.link.channel, self.forwarded.append)
        self.peer = peer
        self.time_ns = 0
        self.forces: list[float] = []
        self.events: list[Event] = []

    def _reject(self, reason: str, why: str) -> None:
        self.node.reject(reason)

    def turn(self) -> None:
        self.time_ns += MS
        self.peer.notices += self.peer.link.watch(time.monotonic_ns())
        for packet in self.node.step(self.time_ns, self.inbox.take(self.time_ns)):
            if isinstance(packet, ForceCommand):
                self.forces += packet.force
            elif isinstance(packet, Event):
                self.events.append(packet)

    def until(self, happened: Callable[[], bool], what: str, *peers: Peer) -> None:
        """Take turns until something has happened."""

        def turned() -> bool:
            self.turn()
            return happened()

        run_until(turned, what, *peers)

    def has_received(self, count: int) -> bool:
        return sum(self.inbox.received.values()) >= count

    @property
    def holder(self) -> object:
        return self.node.status().environment


@pytest.fixture
def three(start: Callable[..., Peer]) -> tuple[Peer, Peer, Peer]:
    """A graph, the environment that will serve, and another one whose key is admitted, too."""
    graph_end, end = ends(free_port())
    graph = start(replace(graph_end, peers={**graph_end.peers, STRANGER.public: STRANGER.name}))
    first, second = start(end), start(replace(end, key=STRANGER))
    meet(graph, first)
    meet(graph, second)
    graph.link.channel.receive()
    return graph, first, second


def attack(graph: Graph, first: Peer, second: Peer, name: str) -> None:
    """Let the second peer answer with newer echoes than the first, a hundred times."""
    first.link.send(encode(reply(1, "wall-1", TRUE)))
    graph.until(lambda: graph.holder == "wall-1", "the lease", first, second)
    for seq in range(2, 102):
        second.link.send(encode(reply(seq + 500, name, FALSE)))
        first.link.send(encode(reply(seq, "wall-1", TRUE)))
        graph.until(partial(graph.has_received, 2 * seq - 1), "both answers", first, second)
    for _ in range(20):
        graph.turn()


@pytest.mark.parametrize("impairment", [None, Impairment(delay=0.005, jitter=0.004)])
@pytest.mark.parametrize("name", ["wall-1", "wall-2"])
def test_a_second_admitted_peer_neither_displaces_nor_impersonates_the_one_that_serves(
    three: tuple[Peer, Peer, Peer], impairment: Impairment | None, name: str
) -> None:
    peer, first, second = three
    links: dict[str, Link[Packet]] = {}
    if impairment is not None:
        links["environment_reply"] = Link(impairment, 1)
    graph = Graph(peer, links)
    attack(graph, first, second, name)
    assert set(graph.forces) == {TRUE}
    assert len(graph.forces) > 20  # jitter reorders the others
    assert graph.holder == "wall-1"
    assert graph.node.status().rejected["second_environment"] == 100
    assert len(graph.forwarded) == 101
    refused = [event.message for event in graph.events if event.event == "environment_refused"]
    expected = "in the name of wall-1" if name == "wall-1" else "rejected environment wall-2"
    assert refused
    assert all(expected in message for message in refused)


def test_an_environment_with_a_key_keeps_the_lease_over_a_new_connection(
    three: tuple[Peer, Peer, Peer], start: Callable[..., Peer]
) -> None:
    peer, first, second = three
    graph = Graph(peer, {})
    first.link.send(encode(reply(1, "wall-1", TRUE)))
    graph.until(lambda: graph.holder == "wall-1", "the lease", first)
    first.close()
    again = start(first.link.end)

    def heard() -> bool:
        again.link.send(encode(reply(9, "wall-1", TRUE)))
        graph.turn()
        return len(graph.forces) > 1

    run_until(heard, "an answer over the new connection", again, second)
    assert "second_environment" not in graph.node.status().rejected


def test_a_silent_environment_leaves_the_lease_to_the_next_one() -> None:
    node = ControllerNode(DirectController())
    one, other = reply(1, "wall-1", TRUE), reply(2, "wall-1", TRUE)
    assert node.admit(one, SERVER.public, 0)
    assert not node.admit(other, STRANGER.public, MS)
    node.step(MS, [one])
    assert not node.admit(other, STRANGER.public, LEASE_NS)
    node.step(2 * LEASE_NS, [])
    assert node.admit(other, STRANGER.public, 2 * LEASE_NS)
    assert not node.admit(one, SERVER.public, 2 * LEASE_NS)


def test_one_whose_answers_never_get_through_does_not_block_the_graph_when_it_leaves() -> None:
    node = ControllerNode(DirectController())
    assert node.admit(reply(1, "wall-1", TRUE), SERVER.public, 0)
    assert not node.admit(reply(1, "wall-2", TRUE), STRANGER.public, LEASE_NS)
    assert node.admit(reply(1, "wall-2", TRUE), STRANGER.public, LEASE_NS + 1)


def test_energy_of_the_partner_is_admitted_from_who_serves_alone() -> None:
    node = ControllerNode(DirectController(), hand="left")
    own = EnergyTransfer(0, 0, 1, 0.0, 0.0, 0, None, hand="left")
    others = EnergyTransfer(0, 0, 1, 0.0, 0.0, 0, None, hand="right")
    assert node.admit(own, "", 0)  # of this machine
    assert not node.admit(others, "key of one", 0)
    assert not node.rejected  # nobody serves yet
    answer = reply(1, "one", TRUE)
    assert node.admit(answer, "key of one", 0)
    node.step(0, [answer])
    assert node.admit(others, "key of one", 1)
    assert not node.admit(others, "key of another", 1)
    assert node.rejected == {"second_environment": 1}
