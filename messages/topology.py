"""The graph of a run: its nodes and the streams between them, made once from the launch file.

A node has a role (:mod:`forcebound.roles`), which says how its process is scheduled, started, ended
and shown. A stream is the packets of one topic from one sender. Whatever asks which processes there
are, which packets they exchange, or where their sockets are, asks the :class:`Graph`; it is a part
of ``run.json``.

To add a hand is to name it: its nodes and streams then carry the name, ``left/device`` and
``left/device_state``. The only hand of a graph is called ``hand``, and its nodes and streams are
``device`` and ``device_state``.

The hands of a graph may be on several machines (docs/remote.md). The graph of a machine has the
nodes of the hands there; and where the environment serves hands of other machines, the streams
between it and these.
"""

from collections.abc import Collection, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeAlias, TypeVar

from msgspec import Struct

from forcebound.messages.packets import (
    TOPIC_OF,
    TOPICS,
    DeviceState,
    EnergyTransfer,
    EnvironmentQuery,
    EnvironmentReply,
    Event,
    ForceCommand,
    Packet,
    Scene,
    Telemetry,
)
from forcebound.roles import CONTROLLER, DEVICE, ENVIRONMENT, LAUNCHER, RECORDER, ROLES

T = TypeVar("T")

#: Class of a stream's packets, and the hand that they name.
Route: TypeAlias = tuple[type[Packet], str]

#: A launch file as resolved for a run, or a section of it: plain JSON values, numbers in SI units.
Document: TypeAlias = dict[str, Any]

HAND = "hand"  # name of the only hand of a graph, which the names of its nodes leave out
MOST_HANDS = 8  # of a graph
HANDS = "hands"  # key of a document: what belongs to each hand, by its name
#: Sections of a launch file that belong to a hand.
HAND_SECTIONS = ("device", "operator", "controller", "links", "remote", "axes")
HERE = "here"  # key of a document: names of the hands on this machine; without it, all

# What each role sends, and which role needs it; None: only observers do. The first four are the
# hops of the loop, in order.
_SENT: dict[type[Packet], tuple[str, str | None]] = {
    DeviceState: (DEVICE, CONTROLLER),
    EnvironmentQuery: (CONTROLLER, ENVIRONMENT),
    EnvironmentReply: (ENVIRONMENT, CONTROLLER),
    ForceCommand: (CONTROLLER, DEVICE),
    Telemetry: (DEVICE, None),
    Scene: (ENVIRONMENT, None),
}

#: Topics of the four hops of the loop, in order.
LINKS = tuple(TOPIC_OF[packet] for packet, (_, receiver) in _SENT.items() if receiver is not None)

#: Topics of the links that can be impaired.
TRANSFER = TOPIC_OF[EnergyTransfer]
IMPAIRABLE = (*LINKS, TRANSFER)

#: Topics whose packets carry the signals of a part, by the role of its node.
SIGNAL_TOPICS = {
    role: TOPIC_OF[packet]
    for packet, (role, _) in _SENT.items()
    if "signals" in packet.__struct_fields__
}


class NodeSpec(Struct, frozen=True):
    """One process of a graph."""

    role: str  # one of ROLES, or LAUNCHER
    hand: str | None  # that it belongs to; None: to all
    socket: str  # its control socket, in the run directory

    @property
    def is_node(self) -> bool:
        """True if it is in the loop."""
        return self.role in ROLES and ROLES[self.role].priority > 0


class Stream(Struct, frozen=True):
    """The packets of one topic from one sender."""

    name: str  # "left/device_state"; streams of one name share a channel of a recording
    topic: str  # name of the packet's class on the wire
    hand: str | None  # None: of all
    sender: str  # name of a process
    receiver: str | None  # name of the process that needs it; None: only observers
    socket: str  # in the run directory
    is_forwarded: bool = False  # whether the packets come from another machine
    partner: str | None = None  # hand that gets the energy of these packets; None: no such packets


class Graph(Struct, frozen=True):
    """Nodes and streams of a run."""

    nodes: dict[str, NodeSpec]  # in the order in which they start; the launcher is the last
    streams: tuple[Stream, ...]

    def of_role(self, role: str, hand: str = HAND) -> str:
        """Return the name of the process with a role for a hand; KeyError if there is none."""
        for name, node in self.nodes.items():
            if node.role == role and node.hand in (hand, None):
                return name
        raise KeyError(role)

    @property
    def hands(self) -> tuple[str, ...]:
        """Names of its hands."""
        return tuple(node.hand or HAND for node in self.nodes.values() if node.role == DEVICE)

    def of(self, hand: str) -> "Graph":
        """Return the nodes and streams that belong to a hand or to all."""
        nodes = {name: node for name, node in self.nodes.items() if node.hand in (hand, None)}
        return Graph(nodes, tuple(one for one in self.streams if one.hand in (hand, None)))

    @property
    def elsewhere(self) -> frozenset[str]:
        """Names of the streams of hands on other machines, which may come and go at any time."""
        here = (None, *self.hands)
        return frozenset(stream.name for stream in self.streams if stream.hand not in here)

    @property
    def loop(self) -> tuple[str, ...]:
        """Names of the nodes, without recorder and launcher."""
        return tuple(name for name, node in self.nodes.items() if node.is_node)

    @property
    def links(self) -> tuple[Stream, ...]:
        """Streams that a node needs, hop by hop: these can be impaired."""
        return tuple(s for s in self.streams if s.receiver is not None and not s.is_forwarded)

    def sent(self, sender: str, packet: type[Packet]) -> Stream:
        """Return the stream of a process with these packets; KeyError if it sends none."""
        topic = TOPIC_OF[packet]
        for stream in self.streams:
            if stream.sender == sender and stream.topic == topic and not stream.is_forwarded:
                return stream
        raise KeyError(topic)

    def forwarded(self, topic: str, hand: str = HAND) -> Stream:
        """Return the stream with a hand's packets of a topic that come from another machine."""
        streams = (s for s in self.streams if s.topic == topic and s.hand == hand)
        return next(stream for stream in streams if stream.is_forwarded)

    def routes(self, node: str) -> "dict[Route, Stream]":
        """Return the streams that a node sends or needs, by the class and hand of their packets."""
        return {
            (TOPICS[stream.topic], stream.hand or HAND): stream
            for stream in self.streams
            if node in (stream.sender, stream.receiver) and not stream.is_forwarded
        }

    def received(self, receiver: str) -> tuple[Stream, ...]:
        """Return the streams that a process needs."""
        return tuple(stream for stream in self.links if stream.receiver == receiver)

    def named(self, *names: str) -> tuple[Stream, ...]:
        """Return the streams with one of these names, of all senders."""
        return tuple(stream for stream in self.streams if stream.name in names)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the streams, each once."""
        return tuple(dict.fromkeys(stream.name for stream in self.streams))


def node_name(hand: str | None, role: str) -> str:
    """Return the name of a hand's node with a role, or of its stream with a topic; None: of all."""
    return role if hand in (None, HAND) else f"{hand}/{role}"


def graph_of(
    hands: Sequence[str] = (HAND,),
    here: Sequence[str] | None = None,
    serves: bool = True,
    exchanges: Iterable[tuple[str, str]] = (),
    linked: Collection[str] = (),
) -> Graph:
    """Return the graph of some hands in one environment, as far as it is on this machine.

    Args:
        hands: All of them.
        here: Those on this machine; None: all.
        serves: Whether the environment on this machine also serves the other hands.
        exchanges: Pairs of hands whose bounders exchange energy, each once.
        linked: Hands with a link of their own to the environment, which is on another machine.
    """
    here = hands if here is None else here
    nodes: dict[str, NodeSpec] = {}
    for role in (*ROLES, LAUNCHER):
        for hand in (None,) if role in (ENVIRONMENT, RECORDER, LAUNCHER) else here:
            nodes[node_name(hand, role)] = NodeSpec(role, hand, f"c{len(nodes)}")
    streams: list[Stream] = []

    def add(packet: type[Packet], hand: str | None, sender: str, receiver: str | None = None,
            is_forwarded: bool = False, partner: str | None = None) -> None:  # fmt: skip
        is_here = hand in (None, *here) or partner in here
        if not (is_here or (serves and ENVIRONMENT in (sender, receiver))):
            return
        topic, socket = TOPIC_OF[packet], f"s{len(streams)}"
        name = node_name(hand, topic)
        streams.append(Stream(name, topic, hand, sender, receiver, socket, is_forwarded, partner))

    def name_of(role: str, hand: str | None) -> str:
        return role if role in nodes else node_name(hand, role)

    for packet, (sender, receiver) in _SENT.items():
        for hand in (None,) if packet is Scene else hands:
            add(packet, hand, name_of(sender, hand), receiver and name_of(receiver, hand))
    for hand in hands:  # what comes from, or goes to, another machine: for observers on this one
        add(EnvironmentReply, hand, name_of(CONTROLLER, hand), is_forwarded=True)
        add(EnvironmentQuery, hand, name_of(ENVIRONMENT, hand), is_forwarded=True)
    for name in nodes:
        add(Event, None, name)

    def end_of(hand: str, partner: str) -> str:
        """Return who has the packets of a hand's device here: it, or what is on the link to it."""
        if hand in here or partner not in here:
            return node_name(hand, DEVICE)
        return node_name(partner, CONTROLLER) if partner in linked else ENVIRONMENT

    for pair in exchanges:
        for one, other in (pair, pair[::-1]):
            add(EnergyTransfer, one, end_of(one, other), end_of(other, one), partner=other)
    for hand in [one for one in here if one in linked][:1]:  # all see the same world
        add(Scene, None, name_of(CONTROLLER, hand), is_forwarded=True)
    return Graph(nodes, tuple(streams))


ONE_HAND = graph_of()


def nested(document: Document) -> Document:
    """Return a resolved launch file with its hands by name; one of before may have them flat."""
    if HANDS in document:
        return dict(document)
    of_all = {name: value for name, value in document.items() if name not in HAND_SECTIONS}
    return {**of_all, HANDS: {HAND: {n: document[n] for n in HAND_SECTIONS if n in document}}}


def flat(document: Document, hand: str = HAND) -> Document:
    """Return a resolved launch file as that of one of its hands alone, with its sections on top.

    One that has no such hand stays as it is. Names of parameters in it are as of an only hand.
    """
    hands = document.get(HANDS)
    if not isinstance(hands, Mapping) or hand not in hands:
        return dict(document)
    of_all = {name: value for name, value in document.items() if name not in (HANDS, HERE)}
    found = {**of_all, **hands[hand]}
    if hand == HAND:
        return found
    if "phases" in found:
        found["phases"] = [
            {**p, "set": hand_values(p["set"], hand, hands)} for p in found["phases"]
        ]
    if "units" in found:
        found["units"] = hand_values(found["units"], hand, hands)
    return found


def hand_values(values: Mapping[str, T], hand: str, hands: Iterable[str]) -> dict[str, T]:
    """Return values by the names of parameters, as in a document that has this hand alone."""
    others = tuple(f"{other}." for other in hands if other != hand)
    return {
        name.removeprefix(f"{hand}."): value
        for name, value in values.items()
        if not name.startswith(others)
    }


def endpoint(run_dir: Path, of: NodeSpec | Stream) -> str:
    """Return the address of a stream, or of the control socket of a process, on this machine."""
    return f"ipc://{run_dir}/{of.socket}"


def is_bound(run_dir: Path, of: NodeSpec | Stream) -> bool:
    """Return whether a process of the run has bound that address."""
    return (run_dir / of.socket).exists()
