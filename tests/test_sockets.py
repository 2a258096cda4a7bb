"""Sockets: one test for each trap of ZeroMQ that is handled. Only ipc and loopback."""

import os
import socket
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TypeAlias

import msgpack
import pytest
import zmq
from waiting import TIMEOUT, until

from forcebound.errors import ConfigError
from forcebound.messages.control import Accepted, GetStatus, Refused, StopNode
from forcebound.network import sockets
from forcebound.network.control import SERVE_LIMIT, ControlClient
from forcebound.network.limits import MAX_FRAME
from forcebound.network.sockets import Network
from forcebound.network.streams import Channel, Publisher, Subscriber

Raw: TypeAlias = Callable[[int], "zmq.Socket[bytes]"]


@pytest.fixture
def raw() -> Iterator[Raw]:
    """Opens a socket of another program."""
    context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
    opened: list[zmq.Socket[bytes]] = []

    def open_socket(kind: int) -> "zmq.Socket[bytes]":
        opened.append(context.socket(kind, socket_class=zmq.Socket))
        opened[-1].linger = 0
        return opened[-1]

    yield open_socket
    context.destroy(0)


def meet(publisher: Publisher, *subscribers: Subscriber) -> None:
    """Send until all have heard something; what was sent until then comes no more."""
    heard: set[Subscriber] = set()

    def all_heard() -> bool:
        publisher.send(b"hello")
        heard.update(s for s in subscribers if s.receive())
        return len(heard) == len(subscribers)

    until(all_heard, "a subscription")
    publisher.send(b"over")
    for subscriber in subscribers:
        take(subscriber, b"over")


def take(subscriber: Subscriber, last: bytes) -> list[bytes]:
    """Return everything up to the message ``last``."""
    got: list[bytes] = []

    def has_come() -> bool:
        got.extend(subscriber.receive())
        return last in got

    until(has_come, str(last))
    return got


def test_every_packet_arrives_in_its_order(network: Network, run_dir: Path) -> None:
    endpoint = f"ipc://{run_dir}/a"
    publisher = network.publisher(endpoint)
    subscriber = network.subscriber(endpoint)
    meet(publisher, subscriber)
    for number in range(100):
        publisher.send(b"%d" % number)
    assert take(subscriber, b"99") == [b"%d" % number for number in range(100)]


def test_a_message_of_several_frames_is_one_malformed_packet(
    network: Network, run_dir: Path, raw: Raw
) -> None:
    endpoint = f"ipc://{run_dir}/a"
    publisher = raw(zmq.PUB)
    publisher.bind(endpoint)
    subscriber = network.subscriber(endpoint)
    meet(Publisher(publisher), subscriber)
    got: list[bytes] = []
    for _ in range(20_000):  # with CONFLATE this ends the process: Assertion failed: !_more
        publisher.send_multipart([b"good", b"good", b"good"])
        got += subscriber.receive()

    def heard_bad() -> bool:
        got.extend(subscriber.receive())
        return b"" in got

    until(heard_bad, "the bad messages")
    assert set(got) == {b""}


def test_what_has_arrived_outlives_its_sender(network: Network, run_dir: Path) -> None:
    endpoint = f"ipc://{run_dir}/a"
    with Network() as leaving:
        publisher = leaving.publisher(endpoint)
        subscriber = network.subscriber(endpoint)
        meet(publisher, subscriber)
        for number in range(50):
            publisher.send(b"%d" % number)
    assert len(take(subscriber, b"49")) == 50


def test_the_descriptor_speaks_for_every_packet(network: Network, run_dir: Path) -> None:
    endpoint = f"ipc://{run_dir}/a"
    publisher = network.publisher(endpoint)
    subscriber = network.subscriber(endpoint)
    meet(publisher, subscriber)
    for number in range(200):
        publisher.send(b"%d" % number)
        got: list[bytes] = []
        while not got:
            readable = sockets.wait([subscriber.descriptor], round(TIMEOUT * 1e9))
            assert readable, f"packet {number} came without a word of the descriptor"
            got = subscriber.receive()
        assert got == [b"%d" % number]


def test_an_ipc_endpoint_in_use_is_refused_and_not_stolen(network: Network, run_dir: Path) -> None:
    endpoint = f"ipc://{run_dir}/a"
    publisher = network.publisher(endpoint)
    with pytest.raises(ConfigError, match=r"cannot bind to ipc://.*/a: the address is in use"):
        network.publisher(endpoint)
    meet(publisher, network.subscriber(endpoint))


def test_an_ipc_file_that_a_killed_process_left_is_taken_over(
    network: Network, run_dir: Path
) -> None:
    with socket.socket(socket.AF_UNIX) as dead:
        dead.bind(str(run_dir / "a"))
    publisher = network.publisher(f"ipc://{run_dir}/a")
    meet(publisher, network.subscriber(f"ipc://{run_dir}/a"))


def test_a_port_in_use_is_refused(network: Network) -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        with pytest.raises(ConfigError, match="in use: stop the other run, or choose another"):
            network.publisher(f"tcp://127.0.0.1:{port}")


@pytest.mark.parametrize(
    ("endpoint", "advice"),
    [
        ("tcp://127.0.0.1", "write it like"),
        ("nonsense", "write it like"),
        ("pigeon://roof", "use tcp:// or ipc://"),
        ("tcp://192.0.2.1:5000", "no network interface"),
        ("ipc:///no/such/run_dir/a", "directory does not exist"),
        (f"ipc:///tmp/{'a' * 120}", "at most 107 characters"),
    ],
)
def test_an_endpoint_that_cannot_be_bound_says_what_to_do(
    network: Network, endpoint: str, advice: str
) -> None:
    with pytest.raises(ConfigError, match=advice):
        network.publisher(endpoint)


@pytest.mark.parametrize("host", ["127.0.0.1", "[::1]"])
def test_tcp_works_with_both_families(network: Network, host: str) -> None:
    family = socket.AF_INET6 if host == "[::1]" else socket.AF_INET
    try:
        with socket.create_server((host.strip("[]"), 0), family=family) as free:
            port = free.getsockname()[1]
    except OSError:
        pytest.skip(f"no {host} on this machine")
    publisher = network.publisher(f"tcp://{host}:{port}")
    subscriber = network.subscriber(f"tcp://{host}:{port}")
    meet(publisher, subscriber)
    for number in range(2000):  # what a bridge sends after it was late
        publisher.send(b"%d" % number)
    assert len(take(subscriber, b"1999")) == 2000


def test_a_frame_that_is_too_large_does_not_arrive(
    network: Network, run_dir: Path, raw: Raw
) -> None:
    server = network.control_server(f"ipc://{run_dir}/control", (GetStatus, StopNode))
    peer = raw(zmq.DEALER)
    peer.connect(f"ipc://{run_dir}/control")
    peer.send_multipart([b"", bytes(MAX_FRAME + 1)])
    heard: list[GetStatus | StopNode] = []

    def answer(request: GetStatus | StopNode) -> Accepted:
        heard.append(request)
        return Accepted()

    def heard_again() -> bool:  # libzmq has ended the connection, and the peer tries again
        peer.send_multipart([b"", msgpack.packb({"request": "status"})])
        server.serve(answer)
        return bool(heard)

    until(heard_again, "the peers to meet again")
    assert set(heard) == {GetStatus()}


def test_a_request_is_answered(network: Network, run_dir: Path) -> None:
    server = network.control_server(f"ipc://{run_dir}/control", (GetStatus, StopNode))
    client = network.control_client(f"ipc://{run_dir}/control")
    until(lambda: client.ask(GetStatus()), "a connection")
    assert client.answer() is None
    until(server.pending, "the request")
    server.serve(lambda request: Refused(type(request).__name__))
    until(client.pending, "the answer")
    assert client.answer() == Refused("GetStatus")


def test_a_flood_of_requests_does_not_hold_a_turn(
    network: Network, run_dir: Path, raw: Raw
) -> None:
    server = network.control_server(f"ipc://{run_dir}/control", (GetStatus, StopNode))
    flood = raw(zmq.DEALER)
    flood.linger = 0
    flood.connect(f"ipc://{run_dir}/control")
    for _ in range(500):
        flood.send_multipart([b"", msgpack.packb({"request": "status"})])
    until(server.pending, "the requests")
    answered: list[object] = []

    def answer(request: GetStatus) -> Accepted:
        answered.append(request)
        sockets.wait((), 1_000_000)  # so that more are there by then
        return Accepted()

    until(lambda: server.serve(answer), "more requests than one turn serves")
    turns = 1
    while len(answered) < 500:
        before = len(answered)
        server.serve(answer)
        assert len(answered) - before <= SERVE_LIMIT
        turns += 1
    assert turns >= 500 // SERVE_LIMIT


def test_a_slow_process_is_heard_however_often_it_is_polled(
    network: Network, run_dir: Path
) -> None:
    server = network.control_server(f"ipc://{run_dir}/control", (GetStatus,))
    client = network.control_client(f"ipc://{run_dir}/control")

    def has_asked() -> bool:
        client.poll(GetStatus())
        return server.pending()

    until(has_asked, "the request")
    for _ in range(2 * SERVE_LIMIT):
        client.poll(GetStatus())
    server.serve(lambda request: Accepted())
    until(client.pending, "the answer")
    assert client.answer() == Accepted()


def test_a_request_may_follow_one_without_an_answer(network: Network, run_dir: Path) -> None:
    server = network.control_server(f"ipc://{run_dir}/control", (GetStatus, StopNode))
    client = network.control_client(f"ipc://{run_dir}/control")
    until(lambda: client.ask(StopNode("1")), "a connection")
    assert client.ask(StopNode("2"))
    answers: list[object] = []

    def answered() -> bool:
        server.serve(lambda request: Refused(request.node))
        answer = client.answer()
        if answer is not None:
            answers.append(answer)
        return bool(answers)

    until(answered, "the answer")
    assert answers == [Refused("2")]


JUNK = [
    b"",
    b"\xc1",
    b"\x81" * 500,
    msgpack.packb([1, 2]),
    msgpack.packb({}),
    msgpack.packb({"request": "dance"}),
    msgpack.packb({"request": "stop_node"}),
    msgpack.packb({"request": "stop_node", "node": 3}),
    msgpack.packb({"request": "status", "quickly": True}),
]


@pytest.mark.parametrize("junk", JUNK)
def test_a_request_that_the_process_does_not_take_gets_an_error(
    network: Network, run_dir: Path, raw: Raw, junk: bytes
) -> None:
    server = network.control_server(f"ipc://{run_dir}/control", (GetStatus, StopNode))
    request = raw(zmq.REQ)
    request.linger = 0
    request.connect(f"ipc://{run_dir}/control")
    request.send(junk)
    until(server.pending, "the request")
    server.serve(lambda request: pytest.fail("asked the node"))
    assert request.poll(round(TIMEOUT * 1000))
    answer = msgpack.unpackb(request.recv())
    assert answer["answer"] == "error"
    assert "status, stop_node" in answer["error"]


def test_an_answer_that_cannot_be_read_is_an_error(
    network: Network, run_dir: Path, raw: Raw
) -> None:
    reply = raw(zmq.REP)
    reply.linger = 0
    reply.bind(f"ipc://{run_dir}/control")
    client: ControlClient = network.control_client(f"ipc://{run_dir}/control")
    until(lambda: client.ask(GetStatus()), "a connection")
    assert reply.poll(round(TIMEOUT * 1000))
    reply.recv()
    reply.send(b"\xc1")
    until(client.pending, "the answer")
    assert isinstance(client.answer(), Refused)


def test_closing_does_not_hang_on_a_peer_that_never_came(run_dir: Path) -> None:
    network = Network(linger_ms=50)
    client = network.control_client(f"ipc://{run_dir}/nobody")
    client.ask(GetStatus())
    network.close()  # hangs for ever with ZeroMQ's defaults


def test_a_wait_ends_with_any_descriptor() -> None:
    reading, writing = os.pipe()
    try:
        os.write(writing, b"x")
        assert sockets.wait((reading,), round(TIMEOUT * 1e9)) == [reading]
    finally:
        os.close(reading)
        os.close(writing)


@pytest.mark.parametrize("kind", [zmq.DEALER, zmq.ROUTER])
def test_a_message_that_is_gone_when_it_is_read_is_none(
    network: Network, kind: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    socket, _ = network.monitored(kind, "tcp://127.0.0.1:9", bind=False, security={})
    channel = Channel(socket)
    monkeypatch.setattr(channel, "pending", lambda: True)
    assert channel.receive() == []


@pytest.mark.parametrize("key", ["#" * 40, "ä" * 40])
def test_a_socket_that_fails_in_its_making_does_not_hang_the_end(key: str) -> None:
    """In a thread, which a hang would keep; the endpoint is in nobody's way."""
    public, secret = zmq.CURVE_PUBLICKEY, zmq.CURVE_SECRETKEY
    ended: list[str] = []

    def make_and_close() -> None:
        with Network() as made:
            for option in (public, secret):
                wrong: dict[int, bytes | int] = {option: key.encode()}
                with pytest.raises((ConfigError, ValueError)):
                    made.monitored(zmq.SUB, "tcp://127.0.0.1:9", bind=False, security=wrong)
        ended.append("closed")

    thread = threading.Thread(target=make_and_close, daemon=True)
    thread.start()
    thread.join(TIMEOUT)
    assert ended == ["closed"]
