"""Runners with a link to another machine, and runners whose parameters change."""

import socket
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from addresses import event_endpoint, remote_endpoint, topic_endpoint
from builders import query, state
from waiting import free_port, until

from forcebound.errors import ConfigError
from forcebound.haptics.controllers.direct import DirectController
from forcebound.haptics.environments.membrane import Membrane
from forcebound.haptics.environments.walls import Wall
from forcebound.messages.codec import decode, encode
from forcebound.messages.control import (
    Accepted,
    Configure,
    ControllerStatus,
    EnvironmentDied,
    Parameters,
    Refused,
)
from forcebound.messages.packets import EnvironmentReply, Event, ForceCommand, Packet, Scene
from forcebound.messages.topology import HAND, endpoint, graph_of
from forcebound.network.ends import RemoteEnd
from forcebound.network.impairment import Impairment
from forcebound.network.link import Link
from forcebound.network.remote import RemoteLink
from forcebound.network.sockets import Network
from forcebound.network.streams import Publisher
from forcebound.nodes.controller import ControllerNode
from forcebound.nodes.environment import EnvironmentNode
from forcebound.run.process.runner import Runner


class Pair:
    """A controller and an environment that meet over TCP, each with a run directory of its own."""

    def __init__(self, folder: Path, listens: str) -> None:
        port = free_port()
        self.folders = {name: folder / name for name in ("here", "there")}
        for one in self.folders.values():
            one.mkdir()
        self.here, self.there = Network(), Network()
        graph = RemoteLink(self.here, RemoteEnd("graph", listens == "graph", "127.0.0.1", port))
        environment = RemoteLink(
            self.there, RemoteEnd("environment", listens != "graph", "127.0.0.1", port)
        )
        self.far = environment
        node, folder = ControllerNode(DirectController()), self.folders["here"]
        nodes = graph_of(linked=[HAND])
        self.controller = Runner(
            node, "controller", folder, {}, self.here, remotes={HAND: graph}, graph=nodes
        )
        far, folder = EnvironmentNode(Membrane(stiffness=1000.0), name="far"), self.folders["there"]
        self.environment = Runner(
            far, "environment", folder, {}, self.there, remotes={HAND: environment}, graph=nodes
        )
        self.device = self.here.publisher(topic_endpoint(self.folders["here"], "device_state"))
        self._at_once, other = socket.socketpair()  # readable: it ends a wait at once
        other.close()
        self.seq = 0

    def turn(self) -> None:
        self.seq += 1
        self.device.send(encode(state(self.seq, 0.011)))
        for runner in (self.controller, self.environment):
            runner.wait(self._at_once.fileno())

    def close(self) -> None:
        self.here.close()
        self.there.close()
        self._at_once.close()


@pytest.fixture(params=["graph", "environment"])
def pair(request: pytest.FixtureRequest, run_dir: Path) -> Iterator[Pair]:
    pair = Pair(run_dir, request.param)
    yield pair
    pair.close()


def test_an_environment_on_another_machine_answers_a_device_that_listens(pair: Pair) -> None:
    here = pair.folders["here"]
    commands = pair.here.subscriber(topic_endpoint(here, "force_command"))
    replies = pair.here.subscriber(remote_endpoint(here, "environment_reply"))
    queries = pair.here.subscriber(topic_endpoint(here, "environment_query"))
    events = pair.here.subscriber(event_endpoint(here, "controller"))
    heard: dict[str, list[bytes]] = {"commands": [], "replies": [], "queries": []}

    def all_came() -> bool:
        pair.turn()
        heard["commands"] += commands.receive()
        heard["replies"] += replies.receive()
        heard["queries"] += queries.receive()
        return all(heard.values())

    until(all_came, "a force from far away, and what a recorder here listens to")
    command = decode(heard["commands"][0], ForceCommand)
    assert isinstance(command, ForceCommand)
    assert command.force == pytest.approx((1.0,))
    answer = decode(heard["replies"][0], EnvironmentReply)
    assert isinstance(answer, EnvironmentReply)
    assert answer.signals == pytest.approx({"damage": 0.5})
    status = pair.controller.status()
    assert isinstance(status, ControllerStatus)
    assert status.environment == "far"

    told: set[str] = set()

    def is_connected() -> bool:
        pair.turn()
        packets = [decode(data, Event) for data in events.receive()]
        told.update(packet.event for packet in packets if isinstance(packet, Event))
        remote = pair.controller.status().remotes[HAND]
        is_told = told >= {"environment_serves", "remote_connected"}
        return is_told and remote.connected

    until(is_connected, "the state of the link")
    assert pair.controller.status().received["environment_reply"] >= 1


def test_the_scene_of_another_machine_is_shown_and_recorded_here(pair: Pair) -> None:
    forwarded = [each for each in pair.controller.graph.named("scene") if each.is_forwarded]
    scenes = pair.here.subscriber(*(endpoint(pair.folders["here"], each) for each in forwarded))
    heard: list[bytes] = []

    def came() -> bool:
        pair.turn()
        heard.extend(scenes.receive())
        return bool(heard)

    until(came, "a scene from far away")
    scene = decode(heard[0], Scene)
    assert isinstance(scene, Scene)
    assert scene.objects


def test_another_machine_cannot_play_the_device(pair: Pair) -> None:
    def rejected() -> bool:
        pair.turn()
        pair.far.send(encode(state(1_000_000, 0.011)))
        return bool(pair.controller.status().rejected.get("unexpected"))

    until(rejected, "a rejected device state from the other machine")
    received = pair.controller.status().received["device_state"]
    assert received <= pair.seq


def perfect(
    run_dir: Path,
    network: Network,
    configure: "Callable[[Runner, Configure], Parameters] | None" = None,
) -> tuple[Runner, Publisher]:
    node = EnvironmentNode(Wall())
    runner = Runner(node, "environment", run_dir, {}, network, configure=configure)
    return runner, network.publisher(topic_endpoint(run_dir, "environment_query"))


def test_a_link_that_was_perfect_can_be_impaired_while_the_process_runs(
    network: Network, run_dir: Path
) -> None:
    runner, publisher = perfect(run_dir, network)
    assert runner.link("environment_query") is None
    link: Link[Packet] = Link(Impairment(loss=1.0), 1)
    runner.set_link("environment_query", link)
    seq = 0

    def lost() -> bool:
        nonlocal seq
        seq += 1
        publisher.send(encode(query(seq)))
        runner.turn(time.monotonic_ns())
        return link.lost >= 3

    until(lost, "three queries that are lost")
    assert runner.steps == 0
    assert runner.status().links["environment_query"]["lost"] == link.lost


def test_a_request_to_configure_is_told_as_an_event_with_what_changed(
    network: Network, run_dir: Path
) -> None:
    def configure(runner: Runner, request: Configure) -> Parameters:
        if not request.time_ns:
            raise ConfigError("no such file")
        return {"environment.stiffness": 5.0}

    runner, _ = perfect(run_dir, network, configure)
    assert runner.answer(Configure(0, {})) == Refused("no such file")  # and the process goes on
    events = network.subscriber(event_endpoint(run_dir, "environment"))
    told: list[Packet] = []

    def came() -> bool:
        assert isinstance(runner.answer(Configure(1, {})), Accepted)
        told.extend(decode(data, Event) for data in events.receive())
        return bool(told)

    until(came, "an event")
    event = told[0]
    assert isinstance(event, Event)
    assert event.event == "parameter_set"
    assert event.data == {"environment.stiffness": "5.0"}


def test_a_controller_is_told_that_the_environment_that_served_is_gone(
    network: Network, run_dir: Path
) -> None:
    node = ControllerNode(DirectController(), dead_lease_ns=1)
    node.step(1, [EnvironmentReply(0, 0, 0, 0, 0, 0, (0.0,), "host/1/a")])
    runner = Runner(node, "controller", run_dir, {}, network)
    assert isinstance(runner.answer(EnvironmentDied("host/2/")), Accepted)
    node.step(5, [])
    assert node.status().environment == "host/1/a"
    assert isinstance(runner.answer(EnvironmentDied("host/1/")), Accepted)
    node.step(5, [])
    assert node.status().environment is None
