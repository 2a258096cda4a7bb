"""The page's server: which requests it accepts, what it sends to pages, what they may change."""

import asyncio
import itertools
import json
import os
import signal
import socket
import stat
import subprocess
import sys
import tempfile
import webbrowser
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from queue import Queue
from threading import Event
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest
import tornado.httpclient
import tornado.websocket
from addresses import LAUNCHERS
from click.testing import CliRunner
from live_graph import LiveGraph, live_graph
from waiting import TIMEOUT

from forcebound.cli import main
from forcebound.cli.view import opened_in_browser
from forcebound.errors import ConfigError
from forcebound.haptics.hands.paths import TrajectoryHand
from forcebound.lab.replay import device_of, duration_of, graph_of
from forcebound.lab.verification import verify
from forcebound.observe.kernels import Kernels
from forcebound.observe.page.access import LOOPBACK, Access, hosts_of
from forcebound.observe.page.controls import Controls
from forcebound.observe.page.pace import SLOWEST, Pace
from forcebound.observe.page.scene_files import content
from forcebound.observe.page.server import Server, _Page
from forcebound.recordings.recording import Recording, read
from forcebound.run.run_directory import RunDocument


def test_only_the_servers_own_host_and_origin_get_in() -> None:
    access = Access(LOOPBACK, 8000)
    assert access.permits_host("127.0.0.1:8000")
    assert access.permits_host("localhost:8000")
    for host in ("127.0.0.1:8001", "evil.example", "evil.example:8000", "", None):
        assert not access.permits_host(host)
    assert access.permits_origin("http://localhost:8000", "localhost:8000")
    assert access.permits_origin(None, "localhost:8000")  # a program, no page
    for origin in ("http://127.0.0.1:8000", "null", "https://localhost:8000"):
        assert not access.permits_origin(origin, "localhost:8000")


def test_the_watching_token_may_look_and_not_change() -> None:
    access = Access(LOOPBACK, 8000)
    assert access.may_look(access.token)
    assert access.may_change(access.token)
    assert access.may_look(access.watching)
    assert not access.may_change(access.watching)
    assert not access.may_look("")
    assert not access.may_look("ü" * 22)
    assert Access(LOOPBACK, 8000).token != access.token


@pytest.mark.parametrize(
    ("listen", "hosts"),
    [("::1", LOOPBACK), ("192.0.2.7", ("192.0.2.7",)), ("fd00::7", ("[fd00::7]",))],
)
def test_hosts_of_an_address(listen: str, hosts: tuple[str, ...]) -> None:
    assert hosts_of(listen) == hosts


@contextmanager
def pointed(monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[LiveGraph, Path]]:
    """A running graph whose hand follows a pointer, and its run directory."""
    with live_graph("pointer_wall", is_alone=False) as graph:
        monkeypatch.setenv("XDG_RUNTIME_DIR", str(graph.runtime))
        graph.until(lambda: list(graph.runtime.glob(LAUNCHERS)), "a launcher")
        graph.until(lambda: graph.status().phase == "running", "an engaged force")
        yield graph, graph.run_dir


UPGRADE = {  # to a WebSocket; the key is that of RFC 6455
    "Connection": "Upgrade",
    "Upgrade": "websocket",
    "Sec-WebSocket-Version": "13",
    "Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ==",
}


class Page:
    """A page that a program plays; to be closed."""

    def __init__(self, socket: tornado.websocket.WebSocketClientConnection) -> None:
        self._socket = socket
        self._earlier: deque[dict[str, Any]] = deque()  # that came before an answer

    async def _next(self) -> dict[str, Any]:
        text = await asyncio.wait_for(self._socket.read_message(), TIMEOUT)
        assert text is not None, "the server has closed the page"
        message: dict[str, Any] = json.loads(text)
        return message

    async def until(self, kind: str, accepts: Any = lambda message: True) -> dict[str, Any]:
        """The first message of a kind that is accepted."""
        while True:
            message = self._earlier.popleft() if self._earlier else await self._next()
            if message["type"] == kind and accepts(message):
                return message

    async def send(self, **message: Any) -> None:
        await self._socket.write_message(json.dumps(message))

    async def close(self) -> None:
        self._socket.close()
        while await asyncio.wait_for(self._socket.read_message(), TIMEOUT) is not None:
            pass

    async def asks(self, **request: Any) -> str | None:
        """What the server says is wrong with a request."""
        await self.send(id=7, **request)
        while (message := await self._next())["type"] != "answer":
            if message["type"] != "frame":  # earlier frames show no effect of a request
                self._earlier.append(message)
        error: str | None = message["error"]
        return error


async def opened(server: Server, token: str) -> Page:
    url = f"ws://127.0.0.1:{server.access.port}/live?token={token}"
    return Page(await tornado.websocket.websocket_connect(url))


async def answer_of(server: Server, path: str, **headers: str) -> tornado.httpclient.HTTPResponse:
    url = f"http://127.0.0.1:{server.access.port}{path}"
    client = tornado.httpclient.AsyncHTTPClient(force_instance=True)
    answer = await client.fetch(url, headers=headers, raise_error=False)
    client.close()
    return answer


async def status_of(server: Server, path: str, **headers: str) -> int:
    return (await answer_of(server, path, **headers)).code


@pytest.mark.live
@pytest.mark.xdist_group("processes")
def test_pages_see_the_graph_and_change_it_and_nobody_else_gets_in(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    async def visit(run_dir: Path, folder: Path) -> None:
        server = Server(recordings=folder)
        token, watching = server.access.token, server.access.watching
        port = server.access.port
        early = await opened(server, token)
        await early.until("over")  # there is no graph yet
        assert await early.asks(do="break") == "no graph runs"
        serving = asyncio.create_task(server.show(run_dir))
        assert (await early.until("hello"))["name"] == "pointer_wall"
        await early.close()

        answer = await answer_of(server, f"/?token={token}")
        assert answer.code == 200
        policy = answer.headers["Content-Security-Policy"]
        assert "default-src 'self'" in policy  # nothing from elsewhere
        assert "frame-ancestors 'none'" in policy
        assert answer.headers["Referrer-Policy"] == "no-referrer"  # the address has the token
        assert answer.headers["X-Content-Type-Options"] == "nosniff"
        assert answer.headers["Cache-Control"] == "no-store"
        assert await status_of(server, f"/?token={watching}") == 200
        assert await status_of(server, "/app.js") == 200
        for path in ("/", "/?token=guess", "/nothing.js", "/..%2fserver.py"):
            assert await status_of(server, path) in (403, 404)
        assert await status_of(server, f"/?token={token}", Host="evil.example") == 403
        for headers in ({"Origin": "http://evil.example"}, {"Host": f"evil.example:{port}"}):
            assert await status_of(server, f"/live?token={token}", **UPGRADE, **headers) == 403
        assert await status_of(server, "/live?token=guess", **UPGRADE) == 403

        page, audience = await opened(server, token), await opened(server, watching)
        hello = await page.until("hello")
        assert (hello["name"], hello["axes"], hello["may_change"]) == ("pointer_wall", 1, True)
        assert "certified" in hello["laws"]
        assert hello["units"]["N/m"] == [1e-3, "N/mm"]
        assert [one["hand_speed"] for one in hello["hands"]] == ["3 m/s"]
        await page.until("state", lambda m: m["hands"]["hand"]["head"].startswith("Passive."))
        assert not (await audience.until("hello"))["may_change"]
        assert "only look" in str(await audience.asks(do="set", settings={"device.law": "none"}))

        await page.send(do="point", target=[0.02], stamp=41.5)
        assert (await page.until("taken"))["stamp"] == 41.5
        await page.until("frame", lambda m: m["tip"][0] > 0.0105 and m["applied"][-1][0] > 0.0)

        assert await page.asks(do="set", settings={"environment.stiffness": "3 N/mm"}) is None
        assert await page.asks(do="set", settings={"environment.stifness": 3}) is not None
        changed = await page.until(
            "parameters", lambda m: m["values"]["environment.stiffness"] == "3000 N/m"
        )
        assert changed["values"]["environment.compute_delay"] == "0 s"
        assert changed["ranges"]["environment.stiffness"] == ">= 0 N/m"
        assert changed["ranges"]["links.environment_reply.loss"] == "0 to 1"
        assert "Probability" in changed["help"]["links.environment_reply.loss"]
        assert "no such control" in str(await page.asks(do="format the disk"))
        for target in ([2**70 * 10**300], ["near"], {"x": 1}, 0.02, None):
            assert "target" in str(await page.asks(do="point", target=target))
        await page.send(do="point", target=[2**70])  # the device's to refuse
        wrong = await page.asks(do="set", settings={"device.law": "fading"})
        assert "did you mean 'certified_fading'" in str(wrong)
        assert await page.asks(do="record") is None
        recording = await page.until("recording", lambda m: m["file"] is not None)
        assert "already recording to" in str(await page.asks(do="record"))
        assert await page.asks(do="break") is None
        event = await page.until("event", lambda m: m["message"].startswith("law:"))
        assert event["message"].startswith(
            "law: none from now on; under certified the hand has put in"
        )
        await page.until("parameters", lambda m: m["values"]["device.law"] == "none")
        await page.until("frame", lambda m: m["law"] == "none" and m["since"] > 0.0)
        await page.until("state", lambda m: m["hands"]["hand"]["kind"] == "not_passive")
        assert await page.asks(do="safe") is None
        await page.until("event", lambda m: m["message"].startswith("law: certified"))
        safe = await page.until("frame", lambda frame: frame["engagement"] == 1.0)
        energies = zip(safe["time"], safe["true_energy"], strict=True)
        assert min(e for t, e in energies if t > safe["since"]) >= 0.0  # of this law alone
        await page.until("nodes", lambda m: any(p["steps"] for p in m["processes"]))
        assert await page.asks(do="end_recording") is None
        ended = await page.until("recording", lambda m: m["file"] is None)
        assert ended["result"].endswith(recording["file"])
        server.stop()
        await page.until("over")
        await serving
        closing = asyncio.create_task(server.close())
        await page.until("closed")
        for one in (page, audience):
            await one.close()
        await closing

    with pointed(monkeypatch) as (graph, run_dir):
        asyncio.run(visit(run_dir, graph.folder))
        [file] = graph.folder.glob("pointer_wall-*.mcap")
        check_part(read(file))
        ended = graph.end()
        laws = [event.data["law"] for event in ended.events("law_changed")]
    assert laws == ["none", "certified"]
    assert ended.summary["law"] == "certified, then none, then certified"


def check_part(recording: Recording) -> None:
    """Check a recording that a page began in the middle of the run, before two changes of the law.

    It has the values of then, is verified from the first new law on, and can be replayed.
    """
    assert recording.complete
    assert recording.launch["environment"]["stiffness"] == 3000.0
    assert recording.launch["device"]["law"] == "certified"
    found = verify(recording, device_of(recording))
    assert not found.differing  # on a busy machine the recorder may lose commands, which it counts
    assert found.verified + found.unknown == found.ticks
    assert found.unknown > 0
    assert found.verified > 100
    hand = graph_of(recording, feeds=("hand",)).only.operator
    assert isinstance(hand, TrajectoryHand)
    first = recording.telemetry.true_position[0, 0]
    assert hand.target(0.0)[0] == pytest.approx(first, abs=0.02)
    config = graph_of(recording)
    length = float(np.ptp(recording.telemetry.time))
    assert duration_of(recording, config) == pytest.approx(length, abs=0.01)


def test_a_page_that_has_just_closed_gets_nothing_and_ends_nothing() -> None:
    page = Mock()  # tornado has closed its stream, and has not yet said so
    page.ws_connection.stream = Mock(closed=lambda: True, _write_buffer=None)
    _Page.send(page, "news")
    page.write_message.assert_not_called()


def test_pages_give_way_while_ticks_are_missed_and_come_back() -> None:
    pace = Pace(1e-3)
    misses, seen = 0, []
    for second in range(30):
        misses += 50 if 5 <= second < 10 else 0
        pace.note(misses, float(second))
        seen.append(pace.slowness)
    assert set(seen[:5]) == {1}
    assert max(seen) == SLOWEST
    assert seen[-1] == 1
    pace.note(0, 30.0)  # another device, which counts from 0
    assert pace.slowness == 1


def test_a_graph_that_ends_while_its_controls_are_made_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    controls = Mock()
    monkeypatch.setattr("forcebound.observe.page.server.Controls", lambda *_: controls)

    async def visit() -> None:
        server = Server()
        with pytest.raises(ConfigError, match="is not the run directory of a running graph"):
            await server.show(tmp_path)
        assert server.graph is None
        await server.close()

    asyncio.run(visit())
    controls.close.assert_called_once_with()


def test_looks_at_the_nodes_do_not_queue_up_behind_other_work(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("forcebound.observe.page.server.PROCESSES_PERIOD", 0.0)
    turns, looks, is_free = itertools.count(), itertools.count(), Event()

    async def visit(descriptor: int) -> None:
        server = Server()

        def look(_: float) -> list[Any]:
            if next(turns) == 20:
                server.stop()
            return []

        graph = Mock(look=look)
        graph.feed.hands, graph.pace.slowness = {}, 0.0
        graph.pointers = {"": Mock(descriptor=descriptor)}
        graph.watch.is_over = False
        monkeypatch.setattr(server, "_look_at_nodes", lambda *_: next(looks))
        server.pages.add(Mock())
        server.workers.submit(is_free.wait, TIMEOUT)  # a law that is being compiled
        await server._follow(graph)
        is_free.set()
        server.workers.shutdown()  # when all that waits is done
        server.pages.clear()
        await server.close()

    ours, theirs = socket.socketpair()
    with ours, theirs:
        asyncio.run(visit(ours.fileno()))
    assert next(looks) == 1


def test_a_body_is_refused_at_the_headers_and_connections_are_limited(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("forcebound.observe.page.server.MOST_CONNECTIONS", 3)

    async def said(server: Server, request: bytes) -> tuple[bytes, asyncio.StreamWriter]:
        reader, writer = await asyncio.open_connection("127.0.0.1", server.access.port)
        writer.write(request)
        return await asyncio.wait_for(reader.read(100), TIMEOUT), writer

    async def visit() -> None:
        server = Server()
        post = b"POST / HTTP/1.1\r\nHost: evil.example\r\n"
        for body in (b"Content-Length: 1\r\n\r\n", b"Transfer-Encoding: chunked\r\n\r\n1\r\n"):
            answer, writer = await said(server, post + body)
            assert answer.startswith(b"HTTP/1.1 400")
            writer.close()
        get = f"GET /app.js HTTP/1.1\r\nHost: 127.0.0.1:{server.access.port}\r\n\r\n".encode()
        kept = [await said(server, get) for _ in range(3)]
        assert all(answer.startswith(b"HTTP/1.1 200") for answer, _ in kept)
        answer, writer = await said(server, b"")
        assert answer == b""  # closed
        for each in (writer, *(writer for _, writer in kept)):
            each.close()
        await server.close()

    asyncio.run(visit())


def test_an_address_that_is_not_here_and_a_port_in_use_are_told() -> None:
    with pytest.raises(ConfigError, match=r"cannot listen at 192\.0\.2\.1, port 0"):
        Server("192.0.2.1")
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        with pytest.raises(ConfigError, match=f"port {port}: Address already in use"):
            Server(port=port)


@pytest.mark.live
@pytest.mark.xdist_group("processes")
def test_a_page_shows_one_graph_after_the_other_at_one_address_until_ctrl_c(tmp_path: Path) -> None:
    async def visit(address: str) -> None:
        place = address.replace("http://", "ws://").replace("/?", "/live?")
        page = Page(await tornado.websocket.websocket_connect(place))
        await page.until("over")  # there is none yet
        graphs = set()
        for name, axes in (("one_axis", 1), ("three_axes", 3)):
            with live_graph(str(files[name]), variables=variables, is_alone=False) as graph:
                hello = await page.until("hello")
                assert (hello["name"], hello["axes"]) == (str(files[name]), axes)
                graphs.add(hello["graph"])
                target = [-0.001] * axes
                await page.send(do="point", target=target, stamp=name)
                assert (await page.until("taken"))["stamp"] == name
                pointed = await page.until("frame", lambda frame: frame["pointer"])
                assert pointed["pointer"] == target  # no more that of the graph before
                assert len(pointed["position"][0]) == axes
                if axes == 3:
                    (mesh,) = (await page.until("scene"))["objects"]
                    file = address.replace("/?", f"/file/{mesh['digest']}?")
                    answer = await tornado.httpclient.AsyncHTTPClient().fetch(file)
                    assert json.loads(answer.body) == content(mesh)
                graph.process.send_signal(signal.SIGINT)
                await page.until("over")
        assert len(graphs) == 2  # a page begins again
        server.send_signal(signal.SIGINT)
        await page.until("closed")
        await page.close()

    files = {name: tmp_path / name / "shown_in_turn.yaml" for name in ("one_axis", "three_axes")}
    for name, base in (("one_axis", "pointer_wall"), ("three_axes", "pointer_rabbit")):
        files[name].parent.mkdir()
        files[name].write_text(f"forcebound: 1\ndescription: Shown.\ninclude: {base}.yaml\n")
    variables = {"XDG_RUNTIME_DIR": tempfile.mkdtemp(prefix="fb-", dir=tmp_path)}
    words = ["view", "--no-open", "--wait", "--run", "shown_in_turn"]
    pipe, environment = subprocess.PIPE, {**os.environ, **variables}
    with subprocess.Popen(
        [sys.executable, "-u", "-m", "forcebound", *words],
        env=environment,
        stdout=pipe,
        stderr=pipe,
        text=True,
    ) as server:
        assert server.stdout is not None
        address, _, waiting = (server.stdout.readline().rstrip() for _ in range(3))
        assert waiting == "waiting for a graph; Ctrl-C ends the page"
        asyncio.run(visit(address.split()[-1]))
        _, err = server.communicate(timeout=TIMEOUT)
    assert (server.returncode, err) == (130, "forcebound: interrupted\n")


def test_a_browser_that_is_started_stays_off_the_core_of_the_nodes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened: Queue[set[int]] = Queue()
    monkeypatch.setattr(webbrowser, "open", lambda _: opened.put(os.sched_getaffinity(0)))
    cores = os.sched_getaffinity(0)
    core = max(cores)
    RunDocument(os.getpid(), core, "", []).write(tmp_path)
    for run, free in ((None, cores), (tmp_path, cores - {core} or cores)):
        with opened_in_browser("address", run):
            assert opened.get(timeout=TIMEOUT) == free
    assert os.sched_getaffinity(0) == cores


def test_a_browser_gets_a_private_file_in_place_of_the_address_and_is_not_waited_for(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    opened: Queue[str] = Queue()
    ended = Event()

    def stay(url: str) -> None:
        opened.put(url)
        ended.wait(TIMEOUT)

    monkeypatch.setattr(webbrowser, "open", stay)
    address = "http://127.0.0.1:8000/?token=secret"
    with opened_in_browser(address, None):
        url = opened.get(timeout=TIMEOUT)
        assert "secret" not in url
        file = Path(url.removeprefix("file://"))
        assert stat.S_IMODE(file.stat().st_mode) == 0o600
        assert f'content="0;url={address}"' in file.read_text()
        assert not ended.is_set()
    assert not file.exists()
    ended.set()


def test_without_tornado_nothing_starts(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "tornado", None)
    for words in (["launch", "pointer_wall", "--view"], ["view"]):
        result = CliRunner().invoke(main, words)
        assert result.exit_code == 2
        assert result.output == (
            "forcebound: the page needs tornado: pip install 'forcebound[view]'\n"
        )


def test_a_newer_request_for_a_law_replaces_those_that_wait(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    waiting = subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE)
    monkeypatch.setattr("forcebound.observe.kernels.subprocess.Popen", lambda *_, **__: waiting)
    kernels = Kernels(tmp_path, "certified")
    controls = Controls.__new__(Controls)  # without a graph
    done: list[str] = []
    actions = {"break": lambda _: kernels.wait("none"), "safe": lambda _: done.append("safe")}
    own = {"_config": Mock(hands_here=["hand"]), "_law_requests": 0, "_newest": {}}
    vars(controls).update(own, _kernels=kernels, _actions=actions)
    counts = [controls.receive({"do": do}) for do in ("break", "safe")]
    delays = controls.receive({"do": "set", "settings": {"links.environment_query.delay": "5 ms"}})
    assert [count() for count in (*counts, delays)] == [False, True, True]
    assert controls.act({"do": "break"}, counts[0]) is None  # not begun
    looks = itertools.count()
    assert controls.act({"do": "break"}, lambda: next(looks) < 2) is None  # a newer one comes
    controls.act({"do": "safe"}, counts[1])
    assert done == ["safe"]
    kernels.close()
    assert waiting.stdin is not None
    waiting.stdin.close()
