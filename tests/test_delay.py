"""Loop delays of runs: recorded, watched, as traces."""

import json
import threading
from pathlib import Path

import numpy as np
import pytest
from addresses import topic_endpoint
from builders import MS, telemetry_packet
from click.testing import CliRunner
from launch_texts import GOOD, written
from msgspec import structs
from waiting import TIMEOUT

from forcebound.cli import main
from forcebound.errors import ConfigError
from forcebound.graph.graph import GraphConfig
from forcebound.graph.loader import from_document, load
from forcebound.graph.parameters import change
from forcebound.graph.resolved import to_document
from forcebound.messages.codec import encode
from forcebound.messages.packets import EnvironmentReply, Packet, Telemetry
from forcebound.messages.topology import HAND, LINKS, flat
from forcebound.network.sockets import Network
from forcebound.network.trace import DelayTrace
from forcebound.observe.delay import DelayFigures, Measured, Percentiles, measure, watch
from forcebound.recordings.delay_traces import hop_delays, loop_delays, read_trace
from forcebound.recordings.hops import Hops
from forcebound.recordings.recording import Recorder, read
from forcebound.recordings.telemetry import TelemetryColumns
from forcebound.run.run_directory import RUN_FILE, RunDocument
from forcebound.run.virtual import run_virtual


def test_the_delay_of_a_tick_is_that_of_its_answer(tmp_path: Path) -> None:
    written(tmp_path, "time_s,delay_s\n10,0.004\n10.010,\n10.020,0.002\n", "wifi.csv")
    path = written(tmp_path, GOOD.replace("delay: 2 ms", "trace: wifi.csv"))
    run_virtual(load(path), 1.0, tmp_path / "run.mcap")
    trace = read_trace(tmp_path / "run.mcap")
    steps = {round(b - a, 9) for a, b in zip(trace.times, trace.times[1:], strict=False)}
    assert steps == {0.001}
    # Of 30 ticks, 10 took 4 ms, 10 were lost, 10 took 2 ms: the trace that the link had. No
    # 4 ms are overtaken by 2 ms, because there is the gap between.
    found = trace.delays[:900]
    for delay, count in ((0.004, 300), (None, 300), (0.002, 300)):
        near = [d for d in found if d is delay or (d and delay and abs(d - delay) < 1e-9)]
        assert abs(len(near) - count) <= 10
    assert len(found) == 900


def test_delays_from_hop_to_hop_of_a_recording(tmp_path: Path) -> None:
    run = tmp_path / "run.mcap"
    run_virtual(load("stiff_wall", ["delay:=3 ms"]), 0.2, run)
    done = CliRunner().invoke(main, ["delay", str(run), "--links", "--json"])
    links = json.loads(done.stdout)["links_ms"]
    # Each way 3 ms; the environment and the controller answer within the same instant.
    for name in ("environment_query", "environment_reply"):
        assert links[name]["p50"] == pytest.approx(3.0)
        assert links[name]["count"] > 100
    hops = [links[name]["p50"] for name in links if name != "loop"]
    assert links["loop"]["p50"] == pytest.approx(sum(hops))
    row = CliRunner().invoke(main, ["delay", str(run), "--links"]).stdout.splitlines()[-1]
    name, least, *_, largest, count = row.split()
    assert (name, least, int(count)) == ("loop", largest, links["loop"]["count"])


def test_a_tick_that_a_newer_answer_overtook_counts_as_lost() -> None:
    columns = TelemetryColumns.from_packets(
        [
            telemetry(seq, answered, delay)
            for seq, answered, delay in (
                (0, None, None),
                (1, 0, 0.0014),
                (2, 0, 0.0024),
                (3, 2, 0.0014),
                (4, 3, 0.0014),
                (5, 4, 0.0014),
                (6, 5, 0.0014),
            )
        ]
    )
    trace = loop_delays(columns)
    # From tick 1, the first with an engaged force; ticks 4 to 6 are within 2.4 ms of the end.
    assert trace.delays == (None, 0.0014, 0.0014)
    assert trace.times == pytest.approx((0.5, 0.501, 0.502))


def telemetry(seq: int, answered: int | None, delay: float | None) -> Telemetry:
    return telemetry_packet(
        seq,
        elapsed=0.499 + seq * 1e-3 if answered is not None else 0.0,
        engagement=0.0 if answered is None else 1.0,
        device_seq=answered,
        loop_delay=delay,
    )


def test_a_run_without_any_answer_is_all_lost() -> None:
    columns = TelemetryColumns.from_packets([telemetry(seq, None, None) for seq in range(5)])
    trace = loop_delays(columns)
    assert trace.delays == (None,) * 5
    assert Measured(trace, {}).figures == DelayFigures(5, 1.0, Percentiles(), [])


def test_a_run_shorter_than_its_delays_has_no_trace() -> None:
    packets = [telemetry(0, None, None), telemetry(1, 0, 0.0014)]
    with pytest.raises(ConfigError, match="record for longer"):
        loop_delays(TelemetryColumns.from_packets(packets))


def test_a_recording_and_the_csv_made_from_it_replay_the_same(tmp_path: Path) -> None:
    config = load("delayed_wall", ("law:=certified",))
    run_virtual(config, 0.3, tmp_path / "run.mcap")
    result = CliRunner().invoke(
        main, ["delay", str(tmp_path / "run.mcap"), "-o", str(tmp_path / "t.csv"), "--json"]
    )
    assert result.exit_code == 0, result.output
    document = json.loads(result.stdout)
    assert document["trace"] == str(tmp_path / "t.csv")
    assert document["loop_delay_ms"]["p50"] == pytest.approx(4.4)
    recorded, written_down = read_trace(tmp_path / "run.mcap"), read_trace(tmp_path / "t.csv")
    assert recorded.delays == pytest.approx(written_down.delays)
    for at_ns in range(0, 10**9, 7 * MS // 10):
        assert recorded.delay_ns(at_ns) == written_down.delay_ns(at_ns)


def test_a_replay_on_one_link_has_the_loop_delay_of_the_recording(tmp_path: Path) -> None:
    run_virtual(load("delayed_wall"), 0.3, tmp_path / "run.mcap")
    path = written(
        tmp_path,
        "forcebound: 1\ninclude: stiff_wall.yaml\n"
        "links: { environment_reply: { trace: run.mcap } }\n",
        "replay.yaml",
    )
    replay = run_virtual(load(path), 0.3)
    recorded = measure(tmp_path / "run.mcap").figures.loop_delay_ms
    assert recorded.p50 == pytest.approx(4.4)
    assert replay.summary["loop_delay_ms"]["p50"] == pytest.approx(recorded.p50)
    assert replay.summary["loop_delay_ms"]["p99"] == pytest.approx(recorded.p99)


FAR = {
    "links.device_state.delay": 0.0015,
    "links.environment_query.delay": 0.003,
    "links.environment_query.jitter": 0.001,
    "links.environment_reply.delay": 0.002,
    "links.environment_reply.loss": 0.3,
}


def hops_of(path: Path, config: GraphConfig) -> dict[str, DelayTrace]:
    """Run a graph, record it, and return the delays of its links."""
    run_virtual(config, 0.2, path)
    return hop_delays(read(path))


def test_each_link_has_its_own_delays_and_losses(tmp_path: Path) -> None:
    hops = hops_of(tmp_path / "run.mcap", change(load("stiff_wall"), FAR))
    assert set(hops["device_state"].delays) == {0.0015}
    reply = [delay for delay in hops["environment_reply"].delays if delay is not None]
    assert 0.2 < 1.0 - len(reply) / len(hops["environment_reply"].delays) < 0.4
    assert max(reply) == 0.002
    assert min(reply) > 0.002 - 0.0004  # what a tick waits for its answer is there again
    query = {d for d in hops["environment_query"].delays if d is not None}
    assert len(query) > 50
    assert min(query) >= 0.002 - 0.0004
    assert max(query) <= 0.004


def test_its_hops_give_a_run_the_loop_delays_of_the_recording(tmp_path: Path) -> None:
    config = change(load("stiff_wall"), FAR)
    first = run_virtual(config, 0.2, tmp_path / "run.mcap").columns
    links = {topic: {"trace": str(tmp_path / "run.mcap"), "trace_hop": topic} for topic in LINKS}
    again = run_virtual(from_document(flat(to_document(config)) | {"links": links}), 0.2).columns
    known = first.seq < 180  # of later ticks the answers were still on their way
    np.testing.assert_array_equal(again.device_seq[known], first.device_seq[known])
    np.testing.assert_array_equal(again.loop_delay[known], first.loop_delay[known])


def test_a_controller_that_answers_at_once_hides_when_it_had_the_reply(tmp_path: Path) -> None:
    hops = hops_of(tmp_path / "run.mcap", load("far_wall"))
    assert set(hops["environment_query"].delays[:150]) == {0.02}
    assert set(hops["environment_reply"].delays) == {0.0}


def test_of_an_environment_with_another_clock_the_way_there_and_back_is_known(
    tmp_path: Path,
) -> None:
    path = tmp_path / "run.mcap"
    run_virtual(load("delayed_wall"), 0.1, path)
    recording = read(path)
    launch = recording.launch | {"remote": {"address": "127.0.0.1"}}
    packets = list(recording.stream(*LINKS, "telemetry"))
    with Recorder(path, {"launch": json.dumps(launch)}) as recorder:
        for packet in packets:
            ahead = 10**15 * isinstance(packet, EnvironmentReply)
            recorder.write(structs.replace(packet, time_ns=packet.time_ns + ahead))
    hops = hop_delays(read(path))
    assert set(hops["environment_query"].delays) == {0.004}
    assert set(hops["environment_reply"].delays) == {0.0}


def test_a_trace_replaces_no_other_file(tmp_path: Path) -> None:
    run, trace, launch = (tmp_path / name for name in ("run.mcap", "t.csv", "mine.yaml"))
    run_virtual(load("delayed_wall"), 0.3, run)
    launch.write_text(GOOD)
    recorded = run.read_bytes()
    trace.touch()
    for output, status in ((run, 2), (launch, 2), (trace, 0), (trace, 0)):
        result = CliRunner().invoke(main, ["delay", str(run), "-o", str(output)])
        assert result.exit_code == status, result.output
        assert ("exists and is not a trace" in result.output) == (status == 2)
    assert run.read_bytes() == recorded
    assert launch.read_text() == GOOD


def test_a_file_that_is_no_recording_is_refused(tmp_path: Path) -> None:
    path = written(tmp_path, "x", "a.mcap")
    with pytest.raises(ConfigError, match=r"a\.mcap is not an MCAP file"):
        read_trace(path)
    result = CliRunner().invoke(main, ["delay", str(path)])
    assert result.exit_code == 2
    assert "is not an MCAP file" in result.stderr


@pytest.mark.live
def test_a_graph_that_runs_is_watched_until_it_ends(tmp_path: Path) -> None:
    class EndOfTheGraph(Hops):
        """Ends the graph when a packet of it was seen."""

        def add(self, topic: str, packet: Packet) -> None:
            (tmp_path / RUN_FILE).unlink(missing_ok=True)

    RunDocument(1, None, "", []).write(tmp_path)
    with Network() as network:
        publisher = network.publisher(topic_endpoint(tmp_path, "telemetry"))
        is_over = threading.Event()

        def publish() -> None:
            seq = 0
            while not is_over.wait(0.001):
                publisher.send(b"not a packet")
                publisher.send(encode(telemetry(seq, seq, 0.0004)))
                seq += 1

        thread = threading.Thread(target=publish)
        thread.start()
        try:
            columns = watch(tmp_path, TIMEOUT, (HAND,), EndOfTheGraph())[HAND]
        finally:
            is_over.set()
            thread.join()
    assert columns.seq.size > 0
    assert set(columns.loop_delay.tolist()) == {0.0004}


@pytest.mark.live
def test_a_silent_graph_has_no_telemetry(tmp_path: Path) -> None:
    RunDocument(1, None, "", []).write(tmp_path)
    assert not watch(tmp_path, 0.05, (HAND,))[HAND].time.size
