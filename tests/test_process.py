"""The live runner, one turn at a time in this process."""

import os
import signal
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import ClassVar

import pytest
from addresses import control_endpoint, topic_endpoint
from builders import MS, query
from fakes import Sender, device_node
from waiting import TIMEOUT, until

from forcebound.haptics.controllers.direct import DirectController
from forcebound.messages.codec import decode, encode
from forcebound.messages.control import (
    Accepted,
    Engage,
    Engaged,
    GetStatus,
    NodeStatus,
    Refused,
    Request,
    StopProcess,
)
from forcebound.messages.events import EventLog
from forcebound.messages.packets import (
    DeviceState,
    EnvironmentReply,
    ForceCommand,
    Packet,
)
from forcebound.network import sockets
from forcebound.network.impairment import Impairment
from forcebound.network.link import Link
from forcebound.network.sockets import Network
from forcebound.network.streams import Subscriber
from forcebound.nodes import Node
from forcebound.nodes.controller import ControllerNode
from forcebound.run.process.runner import Runner
from forcebound.stop import Stop, ending_signals


class ListeningNode(Node):
    """Keeps what it hears; answers nothing."""

    wakes_on_arrival: ClassVar[bool] = True
    wake_ns: int | None = None

    def __init__(self) -> None:
        self.events = EventLog("environment")
        self.heard: list[Packet] = []
        self.steps: list[int] = []

    def step(self, time_ns: int, received: Sequence[Packet]) -> list[Packet]:
        self.heard += received
        self.steps.append(time_ns)
        return []


class BrokenServo(Node):
    """A servo with a programming mistake."""

    wakes_on_arrival: ClassVar[bool] = False
    wake_ns: int | None = 0

    def __init__(self) -> None:
        self.events = EventLog("device")
        self.stopped_ns: int | None = None

    def step(self, time_ns: int, received: Sequence[Packet]) -> list[Packet]:
        raise ZeroDivisionError("a bug")

    def stop(self, time_ns: int) -> None:
        self.stopped_ns = time_ns


@pytest.fixture
def stop() -> Iterator[Stop]:
    with Stop() as stop:
        yield stop


def runner(
    node: Node,
    name: str,
    run_dir: Path,
    network: Network,
    links: Mapping[str, Link[Packet]] | None = None,
) -> Runner:
    return Runner(node, name, run_dir, links or {}, network)


def test_a_packet_reaches_the_node(network: Network, run_dir: Path) -> None:
    node = ListeningNode()
    listening = runner(node, "environment", run_dir, network)
    sender = Sender(network, run_dir, "environment_query")
    assert listening.status().waiting_for == ("environment_query",)

    def heard() -> bool:
        sender.send(query(7))
        listening.turn(time.monotonic_ns())
        return bool(node.heard)

    until(heard, "a query")
    assert node.heard[0] == query(7)
    status = listening.status()
    assert not status.waiting_for
    assert status.received["environment_query"] >= 1


def test_a_node_with_nothing_to_do_is_not_stepped(network: Network, run_dir: Path) -> None:
    node = ListeningNode()
    listening = runner(node, "environment", run_dir, network)
    listening.turn(5)
    node.wake_ns = 10
    listening.turn(9)
    assert node.steps == []
    listening.turn(10)
    assert node.steps == [10]


def test_rejected_bytes_are_counted_by_reason_in_the_node(
    network: Network, run_dir: Path, caplog: pytest.LogCaptureFixture
) -> None:
    node, _ = device_node()
    device = runner(node, "device", run_dir, network)
    sender = Sender(network, run_dir, "force_command")
    old = encode(ForceCommand(0, 0, 0, 0, (0.0,))).replace(b"\xa7version\x05", b"\xa7version\x03")
    for junk, reason in ((old, "version"), (b"junk", "malformed"), (encode(query(1)), "value")):

        def counted(junk: bytes = junk, reason: str = reason) -> bool:
            sender.send(junk)
            device.turn(0)
            return reason in device.status().rejected

        until(counted, reason)
    assert node.status().rejected.keys() == {"malformed", "version", "value"}
    assert "expected version 5" in caplog.text
    assert device.status().waiting_for


def test_an_impaired_link_delays_by_its_model(network: Network, run_dir: Path) -> None:
    node = ListeningNode()
    link: Link[Packet] = Link(Impairment(delay=0.005), 1)
    listening = runner(node, "environment", run_dir, network, {"environment_query": link})
    sender = Sender(network, run_dir, "environment_query")

    def arrived() -> bool:
        sender.send(query(1))
        listening.turn(100 * MS)
        return link.next_due_ns is not None

    until(arrived, "a query")
    assert node.heard == []
    listening.turn(105 * MS - 1)
    assert node.heard == []
    listening.turn(105 * MS)
    assert node.heard == [query(1)]


@pytest.mark.parametrize("delay", [0.0, 0.001])
def test_after_a_pause_only_the_newest_packet_counts(
    network: Network, run_dir: Path, delay: float
) -> None:
    node = ListeningNode()
    links: dict[str, Link[Packet]] = {}
    if delay:
        links["environment_query"] = Link(Impairment(delay=delay), 1)
    listening = runner(node, "environment", run_dir, network, links)
    sender = Sender(network, run_dir, "environment_query")
    witness = network.subscriber(topic_endpoint(run_dir, "environment_query"))
    heard: list[bytes] = []

    def connected() -> bool:
        sender.send(query(0))
        listening.turn(MS)
        heard.extend(witness.receive())
        return bool(not listening.status().waiting_for and heard)

    until(connected, "a subscription")
    for seq in range(1, 101):
        sender.send(query(seq))
    node.heard.clear()

    def has_it_all() -> bool:
        heard.extend(witness.receive())
        return heard[-1] == encode(query(100))

    until(has_it_all, "100 queries")
    until(lambda: _newest(listening, node) == 100, "the newest")
    assert len(node.heard) < 50  # a socket or a link that queued would have brought 100


def _newest(listening: Runner, node: ListeningNode) -> int:
    now_ns = time.monotonic_ns()
    listening.turn(now_ns)
    listening.turn(now_ns + 10 * MS)
    return node.heard[-1].seq if node.heard else -1


def test_the_status_and_the_force_are_asked_for_on_the_control_socket(
    network: Network, run_dir: Path
) -> None:
    node, device = device_node()
    servo = runner(node, "device", run_dir, network)
    assert servo.answer(GetStatus()) == servo.status()
    assert isinstance(servo.answer(Engage()), Engaged)
    servo.turn(0)
    assert device.engaged_ns == 0
    assert isinstance(servo.answer(StopProcess()), Accepted)


@pytest.mark.parametrize(("request_", "kind"), [(GetStatus(), NodeStatus), (Engage(), Refused)])
def test_a_wait_answers_the_control_socket(
    network: Network, run_dir: Path, stop: Stop, request_: Request, kind: type[object]
) -> None:
    listening = runner(ListeningNode(), "environment", run_dir, network)
    client = network.control_client(control_endpoint(run_dir, "environment"))
    until(lambda: client.ask(request_), "a connection")

    def answered() -> bool:
        listening.wait(stop.descriptor)
        return client.pending()

    until(answered, "the answer")
    assert isinstance(client.answer(), kind)


def test_a_stopped_servo_writes_zero_and_says_so(
    network: Network, run_dir: Path, stop: Stop
) -> None:
    node, device = device_node()
    witness = network.subscriber(topic_endpoint(run_dir, "telemetry"))
    servo = runner(node, "device", run_dir, network)
    until(lambda: _spoken(servo, witness), "a witness")
    stop.request()
    servo.run(stop)
    assert device.written[-1][1] == (0.0,)
    assert not node.status().engaged
    heard: list[bytes] = []

    def heard_the_last() -> bool:
        heard.extend(witness.receive())
        return bool(heard) and decode(heard[-1]).time_ns == device.written[-1][0]

    until(heard_the_last, "the last telemetry")


def _spoken(servo: Runner, witness: Subscriber) -> bool:
    servo.turn(time.monotonic_ns())
    return bool(witness.receive())


def test_a_bug_ends_in_zero_force_and_is_not_hidden(
    network: Network, run_dir: Path, stop: Stop
) -> None:
    node = BrokenServo()
    with pytest.raises(ZeroDivisionError):
        runner(node, "device", run_dir, network).run(stop)
    assert node.stopped_ns is not None


def test_a_request_to_stop_ends_a_node_that_sleeps(
    network: Network, run_dir: Path, stop: Stop
) -> None:
    stop.request()
    runner(ListeningNode(), "environment", run_dir, network).run(stop)


def test_the_controller_connects_device_and_environment(network: Network, run_dir: Path) -> None:
    controller = runner(ControllerNode(DirectController()), "controller", run_dir, network)
    states = Sender(network, run_dir, "device_state")
    replies = Sender(network, run_dir, "environment_reply")
    queries = network.subscriber(topic_endpoint(run_dir, "environment_query"))
    commands = network.subscriber(topic_endpoint(run_dir, "force_command"))
    heard: dict[str, list[bytes]] = {"query": [], "command": []}

    def both() -> bool:
        states.send(DeviceState(3, 3, 0.0, (0.1,), (0.0,), (0.0,)))
        replies.send(EnvironmentReply(0, 4, 3, 3, 0, 4, (1.0,), "e"))
        controller.turn(5)
        heard["query"] += queries.receive()
        heard["command"] += commands.receive()
        return all(heard.values())

    until(both, "query and command")


def test_a_closed_terminal_ends_a_command_unless_nohup_started_it() -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_DFL)
    try:
        assert signal.SIGHUP in ending_signals()
        signal.signal(signal.SIGHUP, signal.SIG_IGN)
        assert ending_signals() == (signal.SIGINT, signal.SIGTERM)
    finally:
        signal.signal(signal.SIGHUP, before)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_asks_for_the_end_and_wakes_a_sleeping_process(number: int) -> None:
    before = signal.getsignal(number)
    with Stop() as stop:
        assert not stop.requested
        os.kill(os.getpid(), number)
        assert sockets.wait((stop.descriptor,), round(TIMEOUT * 1e9)) == [stop.descriptor]
        assert stop.requested
    assert signal.getsignal(number) is before
