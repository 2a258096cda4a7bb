"""Hands on several machines in one environment: which nodes run where, and whom a link serves."""

from pathlib import Path

import numpy as np
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
from forcebound.haptics.laws import ENERGY_TOLERANCE
from forcebound.messages.codec import decode, encode
from forcebound.messages.events import EventLog, is_of
from forcebound.messages.packets import EnvironmentReply, Packet
from forcebound.messages.topology import Document
from forcebound.network.ends import RemoteEnd
from forcebound.network.keys import key_pair
from forcebound.recordings.telemetry import TelemetryColumns

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


def partners(file: Path) -> Document:
    """Return the document of a launch file whose hands exchange energy."""
    document = to_document(load(file))
    document["hands"]["left"]["device"]["energy_partner"] = "right"
    document["hands"]["right"]["device"]["energy_partner"] = "left"
    return document


@pytest.mark.parametrize("right", ["", f"{OPEN}, local: true"])
def test_hands_that_exchange_energy_need_one_machine_or_a_link(tmp_path: Path, right: str) -> None:
    document = partners(write_hands(tmp_path, left="", right=right))
    assert from_document({**document, "here": ["left", "right"]}).hands_here.keys() == {
        "left",
        "right",
    }
    for here in ("left", "right"):
        with pytest.raises(ConfigError, match=f"{here} exchanges energy with") as caught:
            from_document({**document, "here": [here]})
        assert caught.value.field == "here"


def test_energy_goes_over_the_link_of_the_hand_that_has_one(tmp_path: Path) -> None:
    document = partners(write_hands(tmp_path, left="", right=OPEN))

    def others(here: str) -> set[str | None]:
        streams = from_document({**document, "here": [here]}).graph.streams
        ends = [(one.sender, one.receiver) for one in streams if one.topic == "energy_transfer"]
        return {end for each in ends for end in each} - {f"{here}/device"}

    assert others("left") == {"environment"}
    assert others("right") == {"right/controller"}


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


def check_claim(columns: TelemetryColumns) -> None:
    """Check the energy of a hand with what its bounder has given and got over the link."""
    given, received = (
        np.nan_to_num(one) for one in (columns.given_energy, columns.received_energy)
    )
    assert (columns.true_energy + received - given).min() >= -ENERGY_TOLERANCE
    assert received[-1] > 0.0


@pytest.mark.parametrize("listens", ["graph", "environment"])
class TestEnergyBetweenMachines:
    """Two launchers with keys, and a link over loopback."""

    pytestmark = PROCESSES_OF_THEIR_OWN

    def test_each_hand_keeps_its_claim_and_a_device_that_returns_is_not_credited_twice(
        self, tmp_path: Path, ports: tuple[int, int], listens: str
    ) -> None:
        keys = key_folders(tmp_path, "right-lab", "world-lab")
        remote = keyed("right", "127.0.0.1", ports[0], listens)
        file = tmp_path / "partners.yaml"
        file.write_text(
            from_document(partners(write_hands(tmp_path, left="", right=remote))).yaml()
        )
        left_keys, right_keys = (
            {"FORCEBOUND_KEYS": str(keys[name])} for name in ("world-lab", "right-lab")
        )
        with live_graph(str(file), "--hand", "left", variables=left_keys) as left:
            for _ in range(2):  # the right one ends, and starts again
                with live_graph(str(file), "--hand", "right", variables=right_keys) as right:
                    right.wait_for_telemetry(
                        lambda one: bool(one.received_energy and one.given_energy), "energy"
                    )
                    rights = right.end()
                assert rights.exit_status == 0, rights.log
                check_claim(rights.columns)
            lefts = left.end()
        assert lefts.exit_status == 0, lefts.log
        check_claim(lefts.columns)


class TestEnergyThroughAThirdMachine:
    """The environment, by itself, passes it on from one link to the other."""

    pytestmark = PROCESSES_OF_THEIR_OWN

    def test_each_hand_keeps_its_claim(self, tmp_path: Path, ports: tuple[int, int]) -> None:
        keys = key_folders(tmp_path, *LABS)
        sections = {
            hand: keyed(hand, "127.0.0.1", port)
            for hand, port in zip(("left", "right"), ports, strict=True)
        }
        file = tmp_path / "partners.yaml"
        file.write_text(from_document(partners(write_hands(tmp_path, **sections))).yaml())
        left_keys, right_keys = (
            {"FORCEBOUND_KEYS": str(keys[f"{hand}-lab"])} for hand in ("left", "right")
        )
        with (
            serving(file, keys=keys["world-lab"]),
            live_graph(str(file), "--hand", "left", variables=left_keys) as left,
            live_graph(str(file), "--hand", "right", variables=right_keys) as right,
        ):
            for one in (left, right):
                one.wait_for_telemetry(lambda got: bool(got.received_energy), "energy")
            ends = left.end(), right.end()
        for ended in ends:
            assert ended.exit_status == 0, ended.log
            check_claim(ended.columns)
