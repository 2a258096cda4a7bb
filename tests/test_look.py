"""What one sees of a running graph: rates, hops, drawings, names."""

import asyncio
import json
import logging
import math
import signal
import socket
import struct
import subprocess
import sys
import time
from asyncio import wait_for
from collections.abc import Callable
from pathlib import Path
from threading import Thread
from types import SimpleNamespace
from typing import Any

import pytest
import zmq
from builders import MS, state, telemetry_packet
from click.testing import CliRunner, Result
from live_graph import LiveGraph, live_graph
from msgspec.structs import astuple
from tornado.websocket import websocket_connect
from waiting import TIMEOUT, free_port, until

from forcebound.cli import main
from forcebound.errors import ConfigError, RunError
from forcebound.messages.packets import DeviceState, Event, Telemetry
from forcebound.messages.topology import ONE_HAND
from forcebound.network.trace import DelayTrace
from forcebound.observe import drawing, runs, streams
from forcebound.observe.bridges import foxglove, frames, plotjuggler, serve
from forcebound.observe.delay import Measured
from forcebound.observe.streams import Stream, check_fields, streams_of
from forcebound.recordings.schema import schema
from forcebound.run.process.reader import Received
from forcebound.run.run_directory import RunDocument


def test_rate_is_that_of_the_senders_time_stamps_and_gaps_are_counted() -> None:
    stream = Stream()
    for seq in (10, 11, 12, 14):
        stream.add(state(seq, 0.0), 100)
    figures = stream.figures(duration=5.0)
    assert figures.rate_hz == pytest.approx(3 / 0.004)
    assert figures.interval_ms is not None
    assert astuple(figures.interval_ms) == pytest.approx((1.0, 4 / 3, 2.0, 0.4714), rel=1e-3)
    assert (figures.packets, figures.missing) == (4, 1)
    assert (figures.bandwidth_b_per_s, figures.mean_size_b) == (80.0, 100.0)


def test_events_of_several_nodes_have_a_rate_but_no_interval() -> None:
    stream = Stream()
    for node in ("device", "controller"):
        stream.add(Event(0, 5, node, "kind", False, "text", {}), 50)
    figures = stream.figures(duration=2.0)
    assert (figures.rate_hz, figures.interval_ms, figures.missing) == (1.0, None, 0)


def test_nothing_is_measured_of_a_graph_that_has_just_ended(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(streams, "packets_of", lambda *_: ())
    monkeypatch.setattr(streams, "streams_of", lambda *_: {"telemetry": Telemetry})
    with pytest.raises(RunError, match="has ended"):
        streams.measure_streams(tmp_path, ["telemetry"], 0.1)


def test_unknown_topics_and_fields_are_named_with_the_nearest(tmp_path: Path) -> None:
    RunDocument(0, None, "", []).write(tmp_path)
    assert streams_of(tmp_path, ["telemetry"]) == {"telemetry": Telemetry}
    with pytest.raises(ConfigError, match="unknown topic 'telemtry'; did you mean 'telemetry'"):
        streams_of(tmp_path, ["telemtry"])
    with pytest.raises(ConfigError, match="did you mean 'position'"):
        check_fields(DeviceState, ["seq", "positon"])


def test_no_value_is_lost_where_a_list_comes_later(monkeypatch: pytest.MonkeyPatch) -> None:
    packets = [telemetry_packet(position=(1.0, 2.0), cut_position=c) for c in (None, (0.01, 0.02))]
    monkeypatch.setattr(runs, "find", lambda run, **_: Path())
    monkeypatch.setattr(streams, "streams_of", lambda *_: {"telemetry": Telemetry})
    came = [Received("telemetry", packet, b"") for packet in packets]
    monkeypatch.setattr(streams, "packets_of", lambda *_: iter(came))
    words = ["echo", "telemetry", "--csv", "--field", "position", "--field", "cut_position"]
    assert CliRunner().invoke(main, words).stdout.splitlines() == [
        "position[0],position[1],cut_position",
        "1.0,2.0,",
        '1.0,2.0,"[0.01, 0.02]"',
    ]


def test_histogram_has_every_delay_and_outliers_in_its_last_class() -> None:
    delays = [0.001] * 500 + [0.002] * 499 + [0.5, None]
    summary = Measured(DelayTrace([i * 1e-3 for i in range(1001)], delays), {}).figures
    classes = summary.histogram
    assert sum(row.count for row in classes) == 1000
    assert classes[0].from_ms == 1.0
    assert summary.loop_delay_ms.max == pytest.approx(500.0)


def test_graph_is_drawn_as_text_and_flowchart() -> None:
    edges = [drawing.Edge(s.sender, str(s.receiver), s.name, 1e3) for s in ONE_HAND.links]
    first, *_ = drawing.as_text(edges).splitlines()
    assert first == "device      ── device_state 1000 Hz ──▶ controller"
    reply = 'environment -- "environment_reply<br/>1000 Hz" --> controller'
    assert reply in drawing.as_mermaid(edges)


def series_of(message: list[bytes]) -> dict[str, tuple[float, float]]:
    """Return time and value of each series, as PlotJuggler reads topic and JSON."""
    topic, payload = message
    fields = json.loads(payload)
    found = {}

    def flatten(prefix: str, value: object) -> None:
        if isinstance(value, dict):
            for name, entry in value.items():
                flatten(f"{prefix}/{name}", entry)
        elif isinstance(value, list):
            for i, entry in enumerate(value):
                flatten(f"{prefix}[{i}]", entry)
        elif isinstance(value, int | float):
            found[prefix] = (fields["timestamp"], float(value))

    flatten(topic.decode(), fields)
    return found


def test_plotjuggler_gets_a_series_for_each_number() -> None:
    packet = DeviceState(3, 7 * MS, 0.5, (0.1, 0.2), (math.nan, 0.0), (1.0, 2.0))
    series = series_of(list(frames("device_state", packet, 10**18 + packet.time_ns)))
    stamp, position = series["device_state/position[1]"]
    assert stamp == pytest.approx(1e9 + 0.007, abs=1e-6)
    assert position == 0.2
    assert series["device_state/elapsed"][1] == 0.5
    assert "device_state/velocity[0]" not in series
    assert "device_state/orientation" not in series


def check_bridge(run_dir: Path) -> None:
    """Receive telemetry of a running graph as PlotJuggler's subscriber does."""
    port = free_port()
    bridge = Thread(target=serve, args=(plotjuggler, run_dir, ("telemetry",), port, 2.0))
    with zmq.Context() as context, context.socket(zmq.SUB) as subscriber:
        subscriber.set(zmq.SUBSCRIBE, b"")
        subscriber.set(zmq.RCVTIMEO, round(1e3 * TIMEOUT))
        subscriber.connect(f"tcp://localhost:{port}")
        bridge.start()
        first, second = (series_of(subscriber.recv_multipart()) for _ in range(2))
        bridge.join()
    assert second["telemetry/seq"][1] > first["telemetry/seq"][1]
    assert second["telemetry/position[0]"][0] > first["telemetry/position[0]"][0]
    assert abs(first["telemetry/seq"][0] - time.time()) < TIMEOUT


def is_open(port: int) -> bool:
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) == 0


def subscription_to(channel: dict[str, Any]) -> str:
    subscription = {"id": 5, "channelId": channel["id"]}
    return json.dumps({"op": "subscribe", "subscriptions": [subscription]})


async def receive_as_foxglove(port: int) -> tuple[dict[str, Any], dict[str, Any], int, Any]:
    """Subscribe to telemetry; return server, channel, log time in ns, and a message."""
    client = await websocket_connect(
        f"ws://127.0.0.1:{port}", subprotocols=["foxglove.sdk.v1"], connect_timeout=TIMEOUT
    )
    server: dict[str, Any] = {}
    channel: dict[str, Any] = {}
    while True:
        got = await wait_for(client.read_message(), TIMEOUT)
        assert got is not None
        if isinstance(got, str):
            said = json.loads(got)
            server = said if said["op"] == "serverInfo" else server
            if said["op"] == "advertise":
                (channel,) = (one for one in said["channels"] if one["topic"] == "/telemetry")
                await client.write_message(subscription_to(channel))
        elif got[0] == 1:
            subscription, log_time = struct.unpack_from("<IQ", got, 1)
            assert subscription == 5
            client.close()
            while await client.read_message() is not None:
                pass  # on their way when it was closed
            return server, channel, log_time, json.loads(got[13:])


def check_foxglove(run_dir: Path) -> None:
    """Receive telemetry of a running graph as Foxglove does."""
    port = free_port()
    words = ["bridge", "foxglove", "telemetry", "--run", str(run_dir), "--port", str(port)]
    bridge = subprocess.Popen([sys.executable, "-m", "forcebound", *words])
    try:
        until(lambda: is_open(port), "the bridge to listen")
        server, channel, log_time, message = asyncio.run(receive_as_foxglove(port))
    finally:
        bridge.send_signal(signal.SIGINT)
        assert bridge.wait(TIMEOUT) == 130
    assert server["capabilities"] == []
    assert (channel["encoding"], channel["schemaName"]) == ("json", "forcebound.Telemetry")
    rules = json.loads(channel["schema"])
    assert set(rules["required"]) <= set(message) <= set(rules["properties"])
    assert abs(log_time * 1e-9 - time.time()) < TIMEOUT


async def vanish_as_foxglove(port: int) -> None:
    """Subscribe to the only channel, take a message, and close as a window that is shut."""
    client = await websocket_connect(f"ws://127.0.0.1:{port}", subprotocols=["foxglove.sdk.v1"])
    while True:
        got = await wait_for(client.read_message(), TIMEOUT)
        if isinstance(got, bytes):
            assert client.protocol is not None
            assert client.protocol.stream is not None
            client.protocol.stream.close()  # no closing handshake
            client.close()
            return
        if got is not None and (said := json.loads(got))["op"] == "advertise":
            await client.write_message(subscription_to(said["channels"][0]))


def test_a_foxglove_window_that_is_shut_is_no_error(caplog: pytest.LogCaptureFixture) -> None:
    port = free_port()
    with foxglove({"device_state": schema(DeviceState)}, port) as send:
        window = Thread(target=lambda: asyncio.run(vanish_as_foxglove(port)))
        window.start()
        while window.is_alive():
            send("device_state", state(0, 0.0), time.time_ns())
        for _ in range(1000):
            send("device_state", state(0, 0.0), time.time_ns())
    assert [one.getMessage() for one in caplog.records if one.levelno >= logging.WARNING] == []


def check_law(graph: LiveGraph, look: Callable[..., Result]) -> None:
    """Check that the law of a running graph is a parameter like others."""
    assert look("param", "get", "device.law").stdout == "device.law: certified\n"
    first = look("param", "list").stdout.splitlines()[0]
    assert first.startswith("device.law: certified  # aol, certified, certified_fading, ")
    done = look("param", "set", "device.law:=certified_fading")
    assert done.stdout == "device.law: certified_fading\n"
    assert "note: the law was taken without force" in done.stderr
    graph.until(lambda: "law: certified_fading from now on" in graph.log, "the new law")
    assert look("param", "list", "--changed").stdout == "device.law: certified_fading\n"
    refused = CliRunner().invoke(main, ["param", "set", "device.law:=fading"])
    assert refused.exit_code == 2
    assert "did you mean 'certified_fading'?" in refused.stderr
    words = {"COMP_WORDS": "forcebound param set device.law:=cert", "COMP_CWORD": "3"}
    asking = {"_FORCEBOUND_COMPLETE": "bash_complete", **words}
    offered = CliRunner().invoke(main, [], env=asking, prog_name="forcebound")
    laws = ["certified", "certified_fading"]
    assert offered.stdout.split() == [f"plain,device.law:={law}" for law in laws]


@pytest.mark.live
@pytest.mark.xdist_group("processes")
def test_each_command_looks_at_a_running_graph_by_the_name_of_its_file(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    with live_graph("stiff_wall") as graph:
        monkeypatch.setenv("XDG_RUNTIME_DIR", str(graph.runtime))

        def look(*words: str) -> Result:
            done = CliRunner().invoke(main, list(words))
            assert done.exit_code == 0, done.output
            return done

        [listed] = json.loads(look("list", "--json").stdout)
        nodes = {one["node"]: SimpleNamespace(**one) for one in listed["processes"]}
        assert nodes["device"].pid == graph.pid("device")
        assert nodes["device"].state == "running"
        assert nodes["device"].memory > 10e6
        assert nodes["device"].processor > 0.0

        short = ("--run", "stiff_wall", "--duration", "500ms")
        rates = json.loads(look("hz", "telemetry", *short, "--json").stdout)
        assert rates["telemetry"]["packets"] > 0
        assert rates["telemetry"]["interval_ms"]["min"] > 0.0
        assert "kB/s" in look("hz", "telemetry", *short).stdout
        edges = json.loads(look("graph", *short, "--json").stdout)
        assert [edge["receiver"] for edge in edges] == [
            "controller", "environment", "controller", "device",
        ]  # fmt: skip
        rows = look("echo", "telemetry", "--csv", "--count", "3", "--field", "position").stdout
        assert rows.splitlines()[0] == "position[0]"
        assert len(rows.splitlines()) == 4
        [line] = look("echo", "device_state", "--json", "--count", "1").stdout.splitlines()
        assert json.loads(line)["elapsed"] > 0.0
        links = look("delay", "stiff_wall", "--links", "--duration", "500ms", "--json")
        hops = json.loads(links.stdout)["links_ms"]
        assert 0.0 < hops["environment_query"]["p50"] < hops["loop"]["max"]
        assert (
            json.loads(look("list", "--watch", "--duration", "100ms", "--json").stdout)[0]["core"]
            is not None
        )
        check_law(graph, look)

        check_bridge(graph.run_dir)
        check_foxglove(graph.run_dir)

        assert json.loads(look("outage", "10 s", "--json").stdout)["duration_s"] == 10.0
        graph.until(lambda: "zero force" in graph.log, "the end of the force")
        graph.wait_until_released()
    refused = CliRunner().invoke(main, ["hz", "--run", "stiff_wall"])
    assert refused.exit_code == 2
    assert "is not the run directory of a running graph, nor its launch file" in refused.stderr
