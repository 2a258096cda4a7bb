"""Ends of the link to another machine, each in a network of its own, on loopback."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace

import zmq
from waiting import TIMEOUT

from forcebound.errors import ConfigError
from forcebound.network import sockets
from forcebound.network.ends import RemoteEnd
from forcebound.network.keys import KeyPair
from forcebound.network.notices import Notice
from forcebound.network.remote import RemoteLink
from forcebound.network.sockets import Network


def pair(name: str) -> KeyPair:
    public, secret = (key.decode() for key in zmq.curve_keypair())
    return KeyPair(name, public, secret)


GRAPH, SERVER, STRANGER = pair("device-lab"), pair("server-lab"), pair("stranger")


class Peer:
    """One end, in a network of its own, and what it has said."""

    def __init__(self, end: RemoteEnd) -> None:
        self.network = Network()
        try:
            self.link = RemoteLink(self.network, end)
        except ConfigError:
            self.network.close()
            raise
        self.first, *rest = self.link.watch(time.monotonic_ns())
        self.notices: list[Notice] = rest
        self.got: list[bytes] = []

    def turn(self) -> None:
        self.notices += self.link.watch(time.monotonic_ns())
        self.got += [data for _, data in self.link.channel.receive()]

    def kinds(self) -> set[str]:
        return {notice.kind for notice in self.notices}

    def text(self, kind: str) -> str:
        return "\n".join(notice.message for notice in self.notices if notice.kind == kind)

    def close(self) -> None:
        self.network.close()


@contextmanager
def open_peers() -> Iterator[Callable[..., Peer]]:
    """Give what starts an end; all are closed in the end."""
    peers: list[Peer] = []

    def start(end: RemoteEnd) -> Peer:
        peers.append(Peer(end))
        return peers[-1]

    yield start
    for peer in peers:
        peer.close()


def run_until(happened: Callable[[], bool], what: str, *peers: Peer) -> None:
    """Let some ends work until something has happened, in bounded time."""
    end = time.monotonic() + TIMEOUT
    while not happened():
        said = [notice.message for peer in peers for notice in peer.notices]
        assert time.monotonic() < end, f"waited {TIMEOUT} s for {what}; said: {said}"
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
