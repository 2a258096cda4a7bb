"""Attackers in place of a node, against live processes in hard contact, judged by ground truth.

An attacker takes the place of the controller on the run's own ipc endpoint, or that of the
environment over TCP on loopback. The launcher makes room: ``forcebound stop NODE``.
"""

import math
import random
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import msgpack
import numpy as np
import zmq
from addresses import topic_endpoint
from live_graph import (
    AGE_LIMIT,
    PROCESSES_OF_THEIR_OWN,
    SATURATION,
    Ended,
    LiveGraph,
    check_always,
    live_graph,
)
from remote_environment import key_folders, serving, write_launch_file
from tcp_tap import TcpTap
from waiting import TIMEOUT, free_port

from forcebound.messages.codec import decode, encode
from forcebound.messages.control import ControllerStatus, GetStatus
from forcebound.messages.packets import (
    DeviceState,
    EnvironmentQuery,
    EnvironmentReply,
    ForceCommand,
    Packet,
    Telemetry,
)
from forcebound.observe.control import ask

pytestmark = PROCESSES_OF_THEIR_OWN

FLOOD = 50  # times the rate of the loop
MALFORMED = 4_000
NAN = math.nan
FRAGMENT = bytes.fromhex("dfffffffff")  # a map that claims 4 294 967 295 pairs


class Attacker:
    """A sender and receiver that takes every freedom; see :func:`attacker`.

    Attributes:
        rejected: What the device has refused so far, by reason.
    """

    def __init__(self, graph: LiveGraph, out: str, come: str) -> None:
        self._graph = graph
        self._context = zmq.Context()
        self._telemetry = self._context.socket(zmq.SUB)
        if come:
            self._out, self._in = self._context.socket(zmq.PUB), self._context.socket(zmq.SUB)
            self._out.bind(out)
            self._in.connect(come)
            self._in.subscribe(b"")
        else:
            self._out = self._in = self._context.socket(zmq.DEALER)
            self._out.connect(out)
            self._out.send(b"")
        for socket in (self._out, self._in, self._telemetry):
            socket.linger = 0
        self._telemetry.subscribe(b"")
        self._telemetry.connect(topic_endpoint(graph.run_dir, "telemetry"))
        self.rejected: dict[str, int] = {}
        self._newest: Packet | None = None

    def close(self) -> None:
        self._context.destroy(0)

    def send(self, *frames: bytes) -> None:
        self._out.send_multipart(frames)

    def newest(self) -> Packet:
        """Return the newest of what the graph asks, waiting for the first."""
        while self._in.poll(0):
            self._newest = decode(self._in.recv())
        while self._telemetry.poll(0):
            packet = decode(self._telemetry.recv())
            assert isinstance(packet, Telemetry)
            self.rejected = dict(packet.rejected)
        if self._newest is None:
            assert self._in.poll(round(TIMEOUT * 1e3)), "the graph asks nothing"
            return self.newest()
        return self._newest

    def next(self) -> Packet:
        """Wait for something that the graph has not asked before."""
        assert self._in.poll(round(TIMEOUT * 1e3)), "the graph asks nothing"
        return self.newest()

    def until_rejected(self, reason: str, make: Callable[[Packet], bytes]) -> None:
        """Answer with one kind of packet until the device has refused one for this reason."""
        before = self.rejected.get(reason, 0)

        def is_rejected() -> bool:
            self.send(make(self.newest()))
            return self.rejected.get(reason, 0) > before

        self._graph.until(is_rejected, f"a packet to be refused: {reason}")


@contextmanager
def attacker(graph: LiveGraph, out: str, come: str = "") -> Iterator[Attacker]:
    """Open an attacker.

    Args:
        graph: What it attacks.
        out: Where it publishes, or meets a graph that listens.
        come: Where the graph publishes; empty: it comes from ``out``.
    """
    one = Attacker(graph, out, come)
    try:
        yield one
    finally:
        one.close()


@contextmanager
def in_place_of_the_controller(graph: LiveGraph) -> Iterator[Attacker]:
    """Attack the device where it takes force commands; afterwards the controller is back."""
    graph.do("stop", "controller")
    graph.wait_until_released()
    out = topic_endpoint(graph.run_dir, "force_command")
    with attacker(graph, out, topic_endpoint(graph.run_dir, "device_state")) as one:
        yield one
    graph.wait_until_released()
    graph.do("start", "controller")
    graph.wait_until_in_contact()


@contextmanager
def in_place_of_the_environment(graph: LiveGraph, port: int) -> Iterator[Attacker]:
    """Attack the controller over TCP; afterwards the local environment is back."""
    graph.do("stop", "environment")
    with attacker(graph, f"tcp://127.0.0.1:{port}") as one:
        yield one
    graph.wait_until_released()
    graph.do("start", "environment")
    graph.wait_until_in_contact()


def command(state: Packet, force: tuple[float, ...], seq: int = 0, **changed: int) -> bytes:
    """Return a command that answers a state, but for what is changed."""
    assert isinstance(state, DeviceState)
    tick, tick_ns = changed.get("device_seq"), changed.get("device_time_ns")
    return encode(
        ForceCommand(
            seq=seq,
            time_ns=seq,
            device_seq=state.seq if tick is None else tick,
            device_time_ns=state.time_ns if tick_ns is None else tick_ns,
            force=force,
        )
    )


def reply(query: Packet, force: tuple[float, ...], seq: int = 0) -> bytes:
    """Return an environment's answer to a query."""
    assert isinstance(query, EnvironmentQuery)
    return encode(
        EnvironmentReply(
            seq=seq,
            time_ns=query.time_ns,
            device_seq=query.device_seq,
            device_time_ns=query.device_time_ns,
            query_seq=query.seq,
            query_time_ns=query.time_ns,
            force=force,
            environment="attacker",
        )
    )


def always(data: bytes) -> Callable[[Packet], bytes]:
    """Return what answers everything with the same bytes."""
    return lambda _: data


def malformed(good: bytes, random_: random.Random) -> list[bytes]:
    """Return one message, by its frames, that no receiver may accept."""
    fields = msgpack.unpackb(good)
    kinds: list[Callable[[], list[bytes]]] = [
        lambda: [random_.randbytes(random_.randrange(200))],
        lambda: [good[: random_.randrange(len(good))]],
        lambda: [good + b"\0"],
        lambda: [msgpack.packb({**fields, "version": random_.choice([0, 3, 4, 6, "5", None])})],
        lambda: [msgpack.packb({**fields, "force": [1.0] * 7})],
        lambda: [msgpack.packb({**fields, "force": [1.0] * 500})],
        lambda: [msgpack.packb({**fields, "force": [True]})],
        lambda: [msgpack.packb({**fields, "seq": -1})],
        lambda: [msgpack.packb({k: v for k, v in fields.items() if k != "force"})],
        lambda: [FRAGMENT + good],
        lambda: [b"\x91" * 60_000],
        lambda: [bytes(60_000)],
        lambda: [good, good],
        lambda: [good, b"", good],
        lambda: [b""],
    ]
    return random_.choice(kinds)()


def answered_between(ended: Ended, begin_ns: int, end_ns: int) -> int:
    """Return in how many samples there was an answer, the last ones before it aside."""
    columns = ended.columns
    since = columns.time_ns > begin_ns + round((AGE_LIMIT + 0.05) * 1e9)
    return int(((columns.device_seq >= 0) & since & (columns.time_ns < end_ns)).sum())


def flood(graph: LiveGraph, random_: random.Random) -> tuple[int, int]:
    """Flood the device, with rubbish at first; return when it had only that, in ns."""
    with in_place_of_the_controller(graph) as one:
        begin_ns = time.monotonic_ns()
        for number in range(MALFORMED):
            if number % FLOOD == 0:
                good = command(one.next(), (3.0,))
            one.send(*malformed(good, random_))
        fields = msgpack.unpackb(good)
        one.until_rejected("malformed", always(b"\xc1"))
        one.until_rejected("version", always(msgpack.packb({**fields, "version": 2})))
        one.until_rejected("value", always(msgpack.packb({**fields, "force": ["1"]})))
        malformed_ns = time.monotonic_ns()
        for tick in range(300):  # well-formed, at 50 times the rate, of any force
            state = one.next()
            for number in range(FLOOD):
                one.send(command(state, (random_.uniform(-30.0, 30.0),), tick * FLOOD + number))
    return begin_ns, malformed_ns


def deceive_device(graph: LiveGraph) -> tuple[int, int]:
    """Command forces that are none and answer states that never were; return as :func:`flood`."""
    with in_place_of_the_controller(graph) as one:
        begin_ns = time.monotonic_ns()
        first = one.newest()
        assert isinstance(first, DeviceState)
        for number in (NAN, math.inf, -math.inf):
            one.until_rejected("not_finite", partial(command, force=(number,)))
        one.until_rejected("wrong_length", partial(command, force=(1.0, 1.0)))
        far = 2**62
        jumps: dict[str, Callable[[DeviceState], dict[str, int]]] = {
            "from_the_future": lambda s: {"device_seq": s.seq + far},
            "wrong_echo": lambda s: {"device_time_ns": s.time_ns + 1},
            "too_old": lambda s: {"device_seq": 0, "device_time_ns": first.time_ns},
        }
        for reason, jump in jumps.items():

            def make(state: Packet, jump: Callable[..., dict[str, int]] = jump) -> bytes:
                return command(state, (5.0,), seq=far, **jump(state))

            one.until_rejected(reason, make)
        replayed = command(first, (5.0,))  # a packet that was good once
        graph.wait(2 * AGE_LIMIT)
        one.until_rejected("too_old", always(replayed))
        false_ns = time.monotonic_ns()
        seq = iter(range(10**9))
        held: list[bytes] = []

        def doubled(state: Packet) -> bytes:  # each packet again and again: a duplicate
            held.append(held[-1] if len(held) % 8 else command(state, (1e30,), next(seq)))
            return held[-1]

        one.until_rejected("not_newer", doubled)
    return begin_ns, false_ns


def deceive_controller(graph: LiveGraph, port: int, random_: random.Random) -> tuple[int, int]:
    """Answer with rubbish and false forces, at any rate; return as :func:`flood`."""
    with in_place_of_the_environment(graph, port) as one:
        seq = iter(range(10**9))
        one.until_rejected("not_finite", lambda q: reply(q, (NAN,), next(seq)))
        begin_ns = time.monotonic_ns()
        one.until_rejected("wrong_length", lambda q: reply(q, (1.0, 2.0), next(seq)))
        for number in range(MALFORMED):
            if number % FLOOD == 0:
                good = reply(one.next(), (3.0,), next(seq))
            one.send(*malformed(good, random_))
        refused: dict[str, int] = {}

        def counted() -> bool:
            one.send(*malformed(good, random_))
            status = ask(graph.run_dir, "controller", GetStatus())
            if isinstance(status, ControllerStatus):
                refused.update(status.rejected)
            return {"malformed", "version", "value"} <= set(refused)

        graph.until(counted, "the controller to count every reason")
        malformed_ns = time.monotonic_ns()
        for _ in range(300):
            query = one.next()
            for _ in range(FLOOD):
                force = random_.choice([1e30, -1e30, 30.0, -30.0, 0.0])
                one.send(reply(query, (force,), next(seq)))
    return begin_ns, malformed_ns


def test_attackers_in_place_of_the_controller_and_of_the_environment(tmp_path: Path) -> None:
    random_, port = random.Random(1), free_port()
    remote = f"address: 127.0.0.1, port: {port}, local: true, insecure: true"
    with live_graph(str(write_launch_file(tmp_path, "a.yaml", remote, rate="1 kHz"))) as graph:
        device = graph.pid("device")
        without_answers = [
            flood(graph, random_),
            deceive_device(graph),
            deceive_controller(graph, port, random_),
        ]
        assert graph.pid("device") == device
        assert graph.node("controller").restarts == 0
        ended = graph.end()
    assert ended.exit_status == 0, ended.log
    check_always(ended.columns, is_attacked=True)
    assert "process_ended" not in ended.faults, ended.log
    assert ended.faults["force_released"] >= 3
    assert ended.faults["packets_refused"] >= 1
    assert ", by reason: " in ended.log
    for begin_ns, end_ns in without_answers:
        assert answered_between(ended, begin_ns, end_ns) == 0
    assert answered_between(ended, without_answers[0][1], without_answers[1][0]) > 0
    assert np.abs(ended.columns.commanded_force).max() > SATURATION
    assert np.abs(ended.columns.applied_force).max() <= SATURATION + 1e-9
    reasons = {"malformed", "version", "value", "not_finite", "wrong_length", "from_the_future"}
    assert reasons | {"wrong_echo", "not_newer"} <= set(ended.summary["rejected_packets"])


def test_a_wrong_key_gets_no_data_and_the_graph_does_not_feel_it(tmp_path: Path) -> None:
    keys = key_folders(tmp_path, "device-lab", "server-lab", "stranger")
    port, friend, foe = free_port(), TcpTap.free_port(), TcpTap.free_port()
    safe = "graph_key: device-lab, environment_keys: [{}]"
    files = {
        name: write_launch_file(
            tmp_path, f"{name}.yaml", f"address: 127.0.0.1, port: {at}, {safe.format(key)}"
        )
        for name, at, key in (
            ("graph", port, "server-lab"),
            ("friend", friend, "server-lab"),
            ("foe", foe, "stranger"),
        )
    }
    with (
        TcpTap(friend, port) as friendly,
        TcpTap(foe, port) as hostile,
        serving(files["friend"], keys=keys["server-lab"]),
        live_graph(
            str(files["graph"]), variables={"FORCEBOUND_KEYS": str(keys["device-lab"])}
        ) as graph,
    ):
        begin_ns = time.monotonic_ns()
        with serving(files["foe"], keys=keys["stranger"]) as stranger:
            graph.until(lambda: "we were refused" in stranger.log, "the stranger to say so")
            graph.until(lambda: "a peer was refused" in graph.log, "the graph")
            graph.wait(1.0)
        graph.wait_until_in_contact()
        ended = graph.end()
    assert ended.exit_status == 0, ended.log
    check_always(ended.columns)
    # A packet travels as the CURVE command MESSAGE, whose name is not encrypted.
    assert b"MESSAGE" in friendly.seen
    assert b"CURVE" in hostile.seen
    assert b"MESSAGE" not in hostile.seen
    assert b"READY" not in hostile.seen
    assert ended.faults["remote_refused_here"] >= 1
    assert len(ended.served) == 1
    assert answered_between(ended, begin_ns, 2**62) > 0
