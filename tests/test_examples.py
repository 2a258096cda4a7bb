"""The walls in other languages, against a graph of bytes and against a live graph.

``make examples`` builds them and runs these tests; of a program that is not built they are skipped.
"""

import os
import random
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import msgpack
import pytest
import zmq
from live_graph import STIFFNESS, SURFACE, Ended, live_graph
from waiting import TIMEOUT
from walls import LANGUAGES, ROOT, FakeGraph, Wall, query, walls_started

from forcebound.messages.codec import decode, encode
from forcebound.messages.packets import EnvironmentQuery, EnvironmentReply, Packet

pytestmark = [pytest.mark.examples, pytest.mark.live, pytest.mark.xdist_group("processes")]


@pytest.fixture(params=sorted(LANGUAGES))
def language(request: pytest.FixtureRequest) -> str:
    name: str = request.param
    return name


@pytest.fixture
def start() -> Iterator[Callable[..., Wall]]:
    with walls_started() as start:
        yield start


@pytest.fixture
def graph() -> Iterator[FakeGraph]:
    with zmq.Context() as context:
        graph = FakeGraph(context)
        yield graph
        graph.socket.close()


def golden(topic: str) -> bytes:
    text = (ROOT / f"tests/golden/{topic}.hex").read_text()
    return bytes.fromhex("".join(line.partition("#")[0] for line in text.splitlines()))


def started(start: Callable[..., Wall], language: str, graph: FakeGraph, *words: str) -> Wall:
    wall = start(language, "127.0.0.1", str(graph.port), *words)
    graph.meet()
    return wall


@pytest.mark.parametrize("ending", [signal.SIGTERM, signal.SIGINT])
def test_the_golden_query_gets_the_golden_answer(
    start: Callable[..., Wall], language: str, graph: FakeGraph, ending: signal.Signals
) -> None:
    wall = started(start, language, graph)
    asked, expected = decode(golden("environment_query")), decode(golden("environment_reply"))
    assert isinstance(asked, EnvironmentQuery)
    assert isinstance(expected, EnvironmentReply)
    first, second = graph.ask(asked), graph.ask(asked)
    assert first.force == pytest.approx(expected.force)
    assert (first.proxy, first.normal) == (expected.proxy, expected.normal)
    outside = graph.ask(query(1, 0.0, 0.0))
    assert outside.contact is None
    echo = ("device_seq", "device_time_ns", "query_seq", "query_time_ns")
    assert first.hand == expected.hand
    assert [getattr(first, key) for key in echo] == [getattr(expected, key) for key in echo]
    assert first.environment == wall.name
    assert second.seq == first.seq + 1
    assert second.time_ns > first.time_ns
    assert wall.name.startswith(f"{language}-wall-")
    answered, dropped = wall.end(ending)
    assert answered == outside.seq + 1
    assert dropped == 0


def test_stiffness_and_surface_are_those_of_the_command_line(
    start: Callable[..., Wall], language: str, graph: FakeGraph
) -> None:
    started(start, language, graph, "500", "-0.25")
    for position, force in ((1.0, 625.0), (-0.125, 62.5), (-0.25, 0.0), (-0.5, 0.0)):
        assert graph.ask(query(1, position, 7.0)).force == (force, 0.0)
    assert graph.ask(query(2, 0.75, 1, 2, 3, 4, 5)).force == (500.0, 0, 0, 0, 0, 0)


@pytest.mark.parametrize("count", [0, 127, 128, 2**31, 2**32, 2**53 + 1, 2**63 - 1])
def test_the_echo_is_the_same_to_the_last_bit(
    start: Callable[..., Wall], language: str, graph: FakeGraph, count: int
) -> None:
    started(start, language, graph)
    asked = EnvironmentQuery(count, count, count, count, 0.0, (0.02,), (0.0,), None)
    reply = graph.ask(asked)
    assert [reply.query_seq, reply.query_time_ns] == [count, count]
    assert [reply.device_seq, reply.device_time_ns] == [count, count]


def pairs(**changes: object) -> dict[str, object]:
    """Return the pairs of a good query with changes; None takes a pair away."""
    good: dict[str, object] = msgpack.unpackb(golden("environment_query"))
    changed = good | changes
    return {key: value for key, value in changed.items() if changes.get(key, 0) is not None}


def test_other_encodings_of_the_same_query_are_answered(
    start: Callable[..., Wall], language: str, graph: FakeGraph
) -> None:
    wall = started(start, language, graph)
    body = golden("environment_query")[1:]
    integers = pairs(position=[1, -2], velocity=[0, 0], elapsed=3)
    wide = b"\x8d" + msgpack.packb("seq") + b"\xcf" + (300).to_bytes(8, "big")
    wide += b"".join(msgpack.packb(x) for kv in pairs(seq=None).items() for x in kv)
    backwards = {key: pairs()[key] for key in list(pairs())[::-1]}
    for frame, force in (
        (b"\xde\x00\x0d" + body, 25.0),
        (b"\xdf\x00\x00\x00\x0d" + body, 25.0),
        (wide, 25.0),
        (msgpack.packb(backwards), 25.0),
        (msgpack.packb(pairs(more={"deep": [1]}, buttons=None)), 25.0),
        (msgpack.packb(pairs(), use_single_float=True), 25.0),
        (msgpack.packb(integers), 9900.0),
    ):
        graph.send(frame)
        reply = graph.reply()
        assert reply is not None
        assert reply.force == pytest.approx((force, 0.0), rel=1e-6)
        assert reply.query_seq == 300
    assert wall.end()[1] == 0


def each(key: str, *values: object) -> list[dict[str, object]]:
    return [{key: value} for value in values]


def malformed() -> list[bytes]:
    good = golden("environment_query")
    changes: list[dict[str, object]] = [
        *each("version", 3, 4, "5", None),
        *each("packet", "environment_reply", 7, None),
        *(change for key in ("seq", "elapsed", "velocity") for change in each(key, None)),
        {"seq": None, "sequence": 1},
        *each("device_seq", -1, 2**63, 1.5, "7", True, [7]),
        *each("device_time_ns", -1, 2**64 - 1, False),
        *each("elapsed", "0", True, []),
        *each("position", [], 0.1, [0.1], [0.1] * 3, ["0.1", 0.1], [True, 0.1]),
        {"position": [0.1] * 7, "velocity": [0.1] * 7},
        *each("environment", "", 7, []),
    ]
    without = [{k: v for k, v in pairs().items() if k != "environment"}]
    return [
        b"\xc1",
        b"wall",
        good[:-1],
        good + b"\xc0",
        good + good,
        b"\x8c" + good[1:],
        msgpack.packb([pairs()]),
        msgpack.packb(list(pairs().values())),
        msgpack.packb(pairs(more="x" * 8192)),
        b"\x91" * 4000,
        b"\xdf\xff\xff\xff\xff",
        b"\xdd\xff\xff\xff\xff",
        random.Random(1).randbytes(300),
        *map(msgpack.packb, without),
        *(golden(topic) for topic in ("environment_reply", "force_command", "telemetry")),
        *(msgpack.packb(pairs(**change)) for change in changes),
    ]


def test_what_is_no_query_is_dropped_and_counted(
    start: Callable[..., Wall], language: str, graph: FakeGraph
) -> None:
    wall = started(start, language, graph)
    before = graph.ask(query(1))
    for seq, frame in enumerate(malformed(), start=1000):
        graph.send(frame)
        reply = graph.ask(query(seq, 0.02))
        assert reply.query_seq == seq, f"{frame!r} was answered"
    graph.send(golden("environment_query"), golden("environment_query"))  # two frames
    graph.send(b"")  # a greeting, which is not counted
    after = graph.ask(query(7, 0.02))
    assert after.query_seq == 7
    assert after.seq - before.seq == len(malformed()) + 1
    assert wall.end()[1] == len(malformed()) + 1
    assert "dropped 1 so far" in wall.log


def test_who_is_not_served_says_so_and_answers_at_most_once_a_second(
    start: Callable[..., Wall], language: str, graph: FakeGraph
) -> None:
    wall = started(start, language, graph)
    graph.ask(query(1))
    begin = time.monotonic()
    replies = asked = 0
    while time.monotonic() < begin + 2.2:
        graph.send(encode(query(2, environment="other-1")))
        asked += 1
        replies += graph.reply(0.01) is not None
    assert 1 <= replies <= 1 + time.monotonic() - begin < asked
    assert "refused: other-1 serves the graph" in wall.log
    for seq, environment in ((3, None), (4, wall.name), (5, None)):
        reply = graph.ask(query(seq, environment=environment))
        while reply.query_seq == 2:  # a last one to the queries before
            late = graph.reply()
            assert late is not None
            reply = late
        assert reply.query_seq == seq
    assert f"{wall.name} serves the graph" in wall.log


def test_of_the_queries_that_wait_the_newest_is_answered(
    start: Callable[..., Wall], language: str, graph: FakeGraph
) -> None:
    wall = started(start, language, graph)
    wall.process.send_signal(signal.SIGSTOP)
    for seq in range(1, 501):
        graph.send(encode(query(seq)))
    wall.process.send_signal(signal.SIGCONT)
    answered = [0]
    while answered[-1] != 500:
        reply = graph.reply()
        assert reply is not None
        answered.append(reply.query_seq)
    assert answered == sorted(set(answered))
    assert len(answered) < 500  # of all, the one before included: not each in turn


def test_wrong_arguments_are_said_on_one_line(
    start: Callable[..., Wall], language: str, tmp_path: Path
) -> None:
    empty = tmp_path / "empty.key"
    empty.touch()
    link, key = ("127.0.0.1", "7410"), "x" * 40
    stiffness = "expected STIFFNESS in N/m, a number from 0 to 1e9, got "
    surface = "expected SURFACE in m, a number from -1 to 1, got "
    for words, message in (
        (link[:1], "usage: ADDRESS PORT"),
        ((*link, "1"), "usage: ADDRESS PORT"),
        *(
            ((link[0], port), f"expected PORT, a whole number from 1 to 65535, got '{port}'")
            for port in ("x", "7410.5", "-1", "65536", "9" * 30, "")
        ),
        *(
            ((*link, word, "0"), f"{stiffness}'{word}'")
            for word in ("10 N/mm", "10N", "nan", "inf", "-1", "", "1,5")
        ),
        *(((*link, "1", word), f"{surface}'{word}'") for word in ("10mm", "10", "x", "")),
        ((*link, "1", "0", "/missing.key_secret", key), "/missing.key_secret"),
        ((*link, "1", "0", str(empty), key), f"{empty}"),
    ):
        wall = start(language, *words)
        assert wall.process.wait(TIMEOUT) == 2
        assert message in wall.log
        assert wall.log.count("\n") == 1


@dataclass(frozen=True)
class Run:
    """A live graph that a wall has served, which a second wall and a stranger tried to serve."""

    language: str
    ended: Ended
    packets: list[Packet]  # queries and replies
    served: Wall
    second: Wall
    stranger: Wall
    stranger_key: str


@pytest.fixture(scope="module", params=sorted(LANGUAGES))
def run(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Run]:
    language, keys = request.param, tmp_path_factory.mktemp("keys")
    device_lab, server_lab = keys / "device-lab", keys / "server-lab"  # key folders of two machines
    for folder, name in (
        (device_lab, "device-lab"),
        (server_lab, "server-lab"),
        (server_lab, "stranger"),
    ):
        subprocess.run(
            [sys.executable, "-m", "forcebound", "keys", "new", name],
            env={**os.environ, "FORCEBOUND_KEYS": str(folder)},
            check=True,
            capture_output=True,
            timeout=TIMEOUT,
        )
    shutil.copy(server_lab / "server-lab.key", device_lab)
    public = {path.stem: public_key(path) for path in keys.glob("*/*.key")}
    with zmq.Context() as context:
        probe = FakeGraph(context)
        port = str(probe.port)
        probe.socket.close()
    launch_file = keys / "graph.yaml"
    launch_file.write_text(
        f"""\
forcebound: 1
include: {ROOT}/launch/stiff_wall.yaml
remote:
  address: 127.0.0.1
  port: {port}
  listens: graph
  graph_key: device-lab
  environment_keys: [server-lab]
"""
    )
    link = ("127.0.0.1", port, "10000", "0.01")
    graph_key = str(device_lab / "device-lab.key")
    with pytest.MonkeyPatch.context() as patch, walls_started() as start:
        patch.setenv("FORCEBOUND_KEYS", str(device_lab))
        one = start(language, *link, str(server_lab / "server-lab.key_secret"), graph_key)
        other = start(
            language, *link, str(server_lab / "server-lab.key_secret"), public["device-lab"]
        )
        stranger = start(language, *link, str(server_lab / "stranger.key_secret"), graph_key)
        with live_graph(str(launch_file)) as graph:
            graph.until(lambda: "refused: " in one.log + other.log, "a second to be refused")
            graph.until(lambda: "rejected environment" in graph.log, "it to be told")
            stranger.until("no query for 3 s")
            graph.until(lambda: public["stranger"] in graph.log, "the stranger to be refused")
            ended = graph.end()
            packets = list(ended.recording.stream("environment_query", "environment_reply"))
        for wall in (one, other, stranger):
            wall.end(signal.SIGINT)
        served, second = (other, one) if "refused: " in one.log else (one, other)
        yield Run(language, ended, packets, served, second, stranger, public["stranger"])


def public_key(path: Path) -> str:
    found = re.search(r'public-key = "(.{40})"', path.read_text())
    assert found is not None
    return found[1]


def test_a_live_graph_feels_the_wall(run: Run) -> None:
    queries = {packet.seq: packet for packet in run.packets if isinstance(packet, EnvironmentQuery)}
    replies = [
        packet
        for packet in run.packets
        if isinstance(packet, EnvironmentReply) and packet.query_seq in queries
    ]
    for reply in replies:
        asked = queries[reply.query_seq]
        assert reply.query_time_ns == asked.time_ns
        assert (reply.device_seq, reply.device_time_ns) == (asked.device_seq, asked.device_time_ns)
        depth = max(0.0, asked.position[0] - SURFACE)
        assert reply.force == pytest.approx((STIFFNESS * depth,), rel=1e-12, abs=1e-12)
    assert sum(reply.environment == run.served.name for reply in replies) > 10
    assert any(reply.force[0] > 1.0 for reply in replies)
    assert {reply.environment for reply in replies} <= {run.served.name, run.second.name}


def test_a_live_graph_rejects_nothing_and_stays_passive(run: Run) -> None:
    assert run.ended.exit_status == 0, run.ended.log
    rejected = run.ended.columns.rejected
    assert set(rejected) <= {"too_old"}  # of a machine that stood still for the age limit
    assert run.ended.columns.true_energy.min() >= -1e-9
    assert run.ended.summary["faults"].get("force_released", 0) <= 1 + len(rejected)


def test_of_two_at_once_the_second_says_that_it_is_refused(run: Run) -> None:
    served = {event.data["environment"] for event in run.ended.events("environment_serves")}
    refused = {event.data["environment"] for event in run.ended.events("environment_refused")}
    assert served == {run.served.name}
    assert refused == {run.second.name}
    assert run.served.name.startswith(f"{run.language}-wall-")
    assert f"refused: {run.served.name} serves the graph" in run.second.log
    assert "refused: " not in run.served.log


def test_who_has_the_wrong_key_gets_no_data_and_both_say_so(run: Run) -> None:
    assert run.stranger.log.endswith("0 answered, 0 dropped\n")
    assert "does it let our key in?" in run.stranger.log
    assert run.stranger_key in run.ended.log
