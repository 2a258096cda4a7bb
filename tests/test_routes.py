"""Routes of a node: the streams that it sends or needs, by the class and hand of their packets."""

from collections.abc import Sequence

import pytest

from forcebound.graph.loader import load
from forcebound.messages.packets import (
    TOPICS,
    DeviceState,
    EnergyTransfer,
    EnvironmentQuery,
    EnvironmentReply,
    Event,
    ForceCommand,
    Scene,
    Telemetry,
)
from forcebound.messages.topology import ONE_HAND, Graph, graph_of

PAIR = ("left", "right")
TWO = graph_of(PAIR)
EXCHANGING = graph_of(PAIR, exchanges=[PAIR])
LEFT_ALONE = graph_of(PAIR, here=["left"], serves=False)
LEFT_SERVES = graph_of(PAIR, here=["left"])  # the environment here serves both
LEFT_GIVES = graph_of(PAIR, here=["left"], exchanges=[PAIR], linked=["right"])
RIGHT_GIVES = graph_of(PAIR, here=["right"], serves=False, exchanges=[PAIR], linked=["right"])
GRAPHS = {
    "one hand": ONE_HAND,
    "two hands": TWO,
    "energy exchange": EXCHANGING,
    "one of two here": LEFT_ALONE,
    "the environment of both here": LEFT_SERVES,
    "energy exchange, one and the environment here": LEFT_GIVES,
    "energy exchange, one here": RIGHT_GIVES,
}


@pytest.mark.parametrize("graph", GRAPHS.values(), ids=GRAPHS)
def test_the_routes_of_a_node_are_all_its_streams_each_once(graph: Graph) -> None:
    for name in graph.nodes:
        routes = graph.routes(name)
        own = [s for s in graph.streams if name in (s.sender, s.receiver) and not s.is_forwarded]
        assert [*routes.values()] == own  # no route hides another one
        for (packet, hand), stream in routes.items():
            assert (packet, hand) == (TOPICS[stream.topic], stream.hand or "hand")


@pytest.mark.parametrize("graph", GRAPHS.values(), ids=GRAPHS)
def test_each_link_is_a_route_of_both_its_ends(graph: Graph) -> None:
    for stream in graph.links:
        ends = [name for name in graph.nodes if stream in graph.routes(name).values()]
        here = [name for name in (stream.sender, stream.receiver) if name in graph.nodes]
        assert sorted(ends) == sorted(here)


def sent_and_received(graph: Graph, node: str) -> tuple[set[str], set[str]]:
    """Names of the streams of a node's routes."""
    streams = graph.routes(node).values()
    return {s.name for s in streams if s.sender == node}, {
        s.name for s in streams if s.receiver == node
    }


@pytest.mark.parametrize(
    ("node", "sent", "received"),
    [
        ("device", ["device_state", "telemetry", "event"], ["force_command"]),
        (
            "controller",
            ["environment_query", "force_command", "event"],
            ["device_state", "environment_reply"],
        ),
        ("environment", ["environment_reply", "scene", "event"], ["environment_query"]),
        ("recorder", ["event"], []),
        ("launcher", ["event"], []),
    ],
)
def test_routes_of_one_hand(node: str, sent: Sequence[str], received: Sequence[str]) -> None:
    assert sent_and_received(ONE_HAND, node) == (set(sent), set(received))


def test_an_environment_has_the_routes_of_all_hands_and_a_controller_those_of_its_own() -> None:
    asked, answered = (EnvironmentQuery, EnvironmentReply)
    assert {*TWO.routes("environment")} == {
        *((packet, hand) for packet in (asked, answered) for hand in PAIR),
        (Scene, "hand"),
        (Event, "hand"),
    }
    assert {hand for packet, hand in TWO.routes("left/controller") if packet is not Event} == {
        "left"
    }
    assert {*LEFT_SERVES.routes("environment")} == {*TWO.routes("environment")}
    assert {hand for _, hand in LEFT_ALONE.routes("environment")} == {"left", "hand"}


def test_energy_of_two_machines_goes_through_what_is_at_the_link() -> None:
    def ways(graph: Graph) -> dict[str, tuple[str, str | None]]:
        transfers = [one for one in graph.streams if one.topic == "energy_transfer"]
        return {str(one.hand): (one.sender, one.receiver) for one in transfers}

    assert ways(LEFT_GIVES) == {
        "left": ("left/device", "environment"),
        "right": ("environment", "left/device"),
    }
    assert ways(RIGHT_GIVES) == {
        "left": ("right/controller", "right/device"),
        "right": ("right/device", "right/controller"),
    }


def test_devices_that_exchange_energy_have_the_transfers_of_both() -> None:
    routes = EXCHANGING.routes("left/device")
    assert {*routes} == {
        (DeviceState, "left"),
        (ForceCommand, "left"),
        (Telemetry, "left"),
        (Event, "hand"),
        (EnergyTransfer, "left"),
        (EnergyTransfer, "right"),
    }
    assert routes[EnergyTransfer, "left"].sender == "left/device"
    assert routes[EnergyTransfer, "right"].receiver == "left/device"
    assert (EnergyTransfer, "left") not in TWO.routes("left/device")
    graph = load("leader_follower_transfer").graph
    assert (EnergyTransfer, "leader") in graph.routes("follower/device")
