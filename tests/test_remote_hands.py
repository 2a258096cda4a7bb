"""Hands on several machines in one environment: which nodes run where, and whom a link serves."""

from pathlib import Path

import pytest
from builders import query
from live_graph import PROCESSES_OF_THEIR_OWN, check_always, live_graph
from msgspec.structs import replace as with_fields
from remote_environment import key_folders, serving, write_hands
from remote_peers import Peer
from waiting import free_port, until

from forcebound.errors import ConfigError
from forcebound.graph.graph import GraphConfig
from forcebound.graph.loader import from_document, load
from forcebound.graph.model import restore
from forcebound.graph.resolved import to_document
from forcebound.messages.codec import decode, encode
from forcebound.messages.events import EventLog, is_of
from forcebound.messages.packets import EnvironmentReply, Packet
from forcebound.network.ends import RemoteEnd
from forcebound.network.keys import key_pair

OPEN = "address: 127.0.0.1"


def on_left(config: GraphConfig) -> GraphConfig:
    return from_document({**to_document(config), "here": ["left"]})


@pytest.fixture
def ports() -> tuple[int, int]:
    return free_port(), free_port()


def test_a_machine_has_the_nodes_and_streams_of_its_hand(
    tmp_path: Path, ports: tuple[int, int]
) -> None:
    left, right = (f"{OPEN}, port: {port}" for port in ports)
    config = on_left(load(write_hands(tmp_path, left=left, right=right)))
    graph = config.graph
    assert set(graph.loop) == {"environment", "left/controller", "left/device"}
    assert not any(name.startswith("right/") for name in graph.names)
    assert not config.has_environment  # it is elsewhere
    assert not config.served_elsewhere
    assert restore(to_document(config)).graph == graph


def test_the_machine_of_the_environment_has_the_queries_and_replies_of_the_others(
    tmp_path: Path, ports: tuple[int, int]
) -> None:
    right = f"{OPEN}, port: {ports[0]}"
    config = on_left(load(write_hands(tmp_path, left="", right=right)))
    assert config.has_environment
    assert config.served_elsewhere == {"right": config.hands["right"].remote}
    graph = config.graph
    assert graph.elsewhere == {"right/environment_query", "right/environment_reply"}
    assert {stream.name for stream in graph.received("environment")} == {
        "left/environment_query",
        "right/environment_query",
    }
    assert "right/device" not in graph.nodes


def test_a_hand_that_is_not_in_the_file_cannot_run_here(
    tmp_path: Path, ports: tuple[int, int]
) -> None:
    config = load(write_hands(tmp_path, left="", right=f"{OPEN}, port: {ports[0]}"))
    with pytest.raises(ConfigError, match="'middle'"):
        from_document({**to_document(config), "here": ["middle"]})


def test_two_hands_cannot_meet_the_environment_at_one_port(tmp_path: Path) -> None:
    same = "address: localhost, port: 7500"
    file = write_hands(tmp_path, left=same, right=f"{same}, listens: environment")
    with pytest.raises(ConfigError, match=r"right and left .* localhost port 7500"):
        load(file)


def test_hands_that_exchange_energy_need_one_machine(tmp_path: Path) -> None:
    document = to_document(load(write_hands(tmp_path, left="", right="")))
    document["hands"]["left"]["device"]["energy_partner"] = "right"
    document["hands"]["right"]["device"]["energy_partner"] = "left"
    assert from_document({**document, "here": ["left", "right"]}).hands_here.keys() == {
        "left",
        "right",
    }
    with pytest.raises(ConfigError, match="left exchanges energy with right"):
        from_document({**document, "here": ["left"]})


def test_what_happens_at_the_link_of_a_hand_is_of_this_hand_alone() -> None:
    event = EventLog("environment").emit(0, "serving", "", {"hand": "right"})
    assert is_of(event, "right")
    assert not is_of(event, "left")


LABS = ("left-lab", "right-lab", "world-lab")


def keyed(hand: str, address: str, port: int, listens: str = "graph") -> str:
    keys = f"graph_key: {hand}-lab, environment_keys: [world-lab]"
    return f"address: {address}, port: {port}, listens: {listens}, {keys}"


@pytest.mark.live
def test_a_peer_with_the_key_of_one_hand_cannot_speak_for_another(
    tmp_path: Path, ports: tuple[int, int]
) -> None:
    keys = key_folders(tmp_path, *LABS)
    left, right = (
        keyed(hand, "127.0.0.1", port, "environment")
        for hand, port in zip(("left", "right"), ports, strict=True)
    )
    file = write_hands(tmp_path, left=left, right=right)
    own = key_pair("right-lab", keys["right-lab"])
    world = key_pair("world-lab", keys["world-lab"]).public
    end = RemoteEnd("graph", False, "127.0.0.1", ports[1], own, {world: "world-lab"})
    replies: list[Packet] = []
    seq = 0
    with serving(file, keys=keys["world-lab"]) as environment:
        peer = Peer(end)

        def sent(hand: str) -> None:
            nonlocal seq
            seq += 1
            peer.link.send(encode(with_fields(query(seq), hand=hand)))
            peer.turn()
            replies.extend(decode(data, EnvironmentReply) for data in peer.got)
            peer.got.clear()

        def is_rejected() -> bool:
            sent("left")
            return "unexpected" in environment.log

        def is_answered() -> bool:
            sent("right")
            return bool(replies)

        try:
            until(is_rejected, "the environment to reject the other hand")
            assert not replies
            until(is_answered, "an answer to its own hand")
        finally:
            peer.close()
        environment.end()
    assert {reply.hand for reply in replies if isinstance(reply, EnvironmentReply)} == {"right"}


class TestThreeMachines:
    """The environment serves two hands, each launched by itself, with keys."""

    pytestmark = PROCESSES_OF_THEIR_OWN

    def test_a_hand_that_dies_and_returns_leaves_the_other_in_the_wall(
        self, tmp_path: Path, ports: tuple[int, int]
    ) -> None:
        keys = key_folders(tmp_path, *LABS)
        file = write_hands(
            tmp_path,
            left=keyed("left", "127.0.0.1", ports[0]),
            right=keyed("right", "127.0.0.1", ports[1], "environment"),
        )
        variables = {
            hand: {"FORCEBOUND_KEYS": str(keys[f"{hand}-lab"])} for hand in ("left", "right")
        }
        here = ("--hand", "left")
        there = ("--hand", "right")
        with (
            serving(file, keys=keys["world-lab"]) as environment,
            live_graph(str(file), *here, variables=variables["left"]) as left,
        ):
            assert set(left.status().nodes) == {"left/controller", "left/device", "recorder"}
            with live_graph(str(file), *there, variables=variables["right"]):
                pass  # it is in contact; then its launcher is killed
            left.wait_until_in_contact()
            with live_graph(str(file), *there, variables=variables["right"]) as again:
                ended_again = again.end()
            left.wait_until_in_contact()
            ended = left.end()
            environment.end()
        assert ended.exit_status == ended_again.exit_status == 0, ended.log + ended_again.log
        assert ended.recording.hands == ("left",)
        assert ended_again.recording.hands == ("right",)
        check_always(ended.columns)
        check_always(ended_again.columns)
        assert len(ended.served) == 1
        assert ended.served == ended_again.served
        assert not ended.events("process_ended")
