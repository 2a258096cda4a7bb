import importlib
import json
import math
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from forcebound.benchmark import BENCHMARKS, link_delay, tables
from forcebound.benchmark.figures import SHARES, Measured, beyond, compare, judge, percentile, plan
from forcebound.benchmark.workers import collect, compile_c, module, read_times, started
from forcebound.errors import RunError
from forcebound.messages.codec import decode

CODEC = Path(__file__).parent.parent / "benchmarks" / "codec.py"

needs_compiler = pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")


def measured(*rounds: list[int], label: str = "one") -> Measured:
    one = Measured(label)
    for times_ns in rounds:
        one.add(times_ns, missed=1, processor_ns=10, elapsed_ns=100)
    return one


@pytest.mark.parametrize(
    ("share", "expected"), [(0.0, 1), (0.5, 50), (0.501, 51), (0.99, 99), (0.999, 100), (1.0, 100)]
)
def test_a_percentile_is_the_smallest_value_that_so_many_do_not_exceed(
    share: float, expected: int
) -> None:
    assert percentile(range(1, 101), share) == expected


def test_a_single_value_is_every_percentile() -> None:
    assert {percentile([7], share) for share in SHARES.values()} == {7}


def test_there_is_no_percentile_of_nothing() -> None:
    with pytest.raises(ValueError, match="at least one value"):
        percentile([], 0.5)


def test_a_summary_puts_all_rounds_together_in_microseconds() -> None:
    assert measured([3000, 1000], [2000]).summary() == {
        "label": "one",
        "p50_us": 2.0,
        "p99_us": 3.0,
        "p99_9_us": 3.0,
        "max_us": 3.0,
        "count": 3,
        "missed": 2,
        "processor_share": 0.1,
    }


def test_the_ratio_is_of_all_rounds_and_the_spread_of_neighbours() -> None:
    compared = compare(
        measured([100], [300], label="ours"), measured([100], [100], label="limit"), "max", 2.0
    )
    assert compared == {
        "what": "ours / limit, max",
        "value": 3.0,
        "unit": "ratio",
        "lowest": 1.0,
        "highest": 3.0,
        "target": 2.0,
        "reached": False,
    }


def test_a_clock_that_did_not_move_gives_a_finite_ratio() -> None:
    assert compare(measured([0]), measured([0]), "p50", 1.0)["value"] == 1.0


def test_a_round_without_times_is_left_out_of_the_spread() -> None:
    compared = compare(measured([10], []), measured([10], [20]), "p50", None)
    assert (compared["lowest"], compared["highest"], compared["reached"]) == (1.0, 1.0, None)


def test_what_is_beyond_is_counted_from_the_median_of_what_there_is_anyway() -> None:
    ours = measured([5000, 9000, 9000], [6000, 7000, 8000], label="ours")
    own = measured([1000, 2000, 9000], [3000, 3000, 3000], label="own")
    assert beyond(ours, own, "max", 6.0) == {
        "what": "ours, max beyond own",
        "value": 6.0,
        "unit": "us",
        "lowest": 5.0,
        "highest": 7.0,
        "target": 6.0,
        "reached": True,
    }


@pytest.mark.parametrize("name", sorted(set(link_delay.LINKS) - {"own"}))
def test_the_watched_link_tells_what_it_adds(name: str) -> None:
    link = link_delay.WatchedLink(link_delay.LINKS[name])
    sender = link_delay.SenderNode(1_000_000, 0)
    sent = {}
    for tick in range(100):
        (packet,) = sender.step(tick * 1_000_000, ())
        sent[packet.seq] = packet.time_ns
        link.accept(packet.time_ns, packet)
    while (due_ns := link.next_due_ns) is not None:
        for packet in link.due(due_ns):
            assert link.added_ns.pop(packet.seq) == due_ns - sent.pop(packet.seq)
    assert len(sent) == link.superseded < 100


def test_the_sender_skips_the_ticks_that_it_missed() -> None:
    sender = link_delay.SenderNode(1000, 5000)
    (packet,) = sender.step(7500, ())
    assert (packet.seq, packet.time_ns, sender.wake_ns) == (0, 7500, 8000)


def test_a_target_is_reached_up_to_its_very_value() -> None:
    assert judge("missed", 0.0, "ticks", 0.0)["reached"] is True
    assert judge("missed", 1.0, "ticks", 0.0)["reached"] is False


@pytest.mark.parametrize(
    ("duration", "contestants", "expected"),
    [(30.0, 3, (10, 1000)), (4.0, 4, (1, 1000)), (7.5, 3, (2, 1250)), (0.01, 2, (1, 20))],
)
def test_a_duration_is_shared_out_in_rounds_of_about_a_second(
    duration: float, contestants: int, expected: tuple[int, int]
) -> None:
    assert plan(duration, contestants, rate=1000.0) == expected


@pytest.mark.parametrize("data", [b"", b"1234567", b"12345678"])
def test_an_answer_that_is_no_row_of_times_is_refused(data: bytes) -> None:
    with pytest.raises(RunError, match="instead of times"):
        read_times(data, Measured("one"))


def test_without_a_compiler_the_message_says_what_to_install(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(RunError, match=r"no C compiler .* apt install gcc"):
        compile_c("pacing.c", tmp_path)


@needs_compiler
def test_the_c_limit_can_be_built(tmp_path: Path) -> None:
    assert compile_c("pacing.c", tmp_path).exists()


def test_the_bare_loop_sends_the_bytes_of_real_packets() -> None:
    bare_loop = importlib.import_module("forcebound.benchmark.bare_loop")
    for packet in bare_loop.PACKETS:
        assert decode(bare_loop.encode(packet), type(packet)) == packet


@pytest.fixture
def result() -> dict[str, Any]:
    ours, limit = measured([10]), measured([20])
    return {
        "benchmark": "test",
        "contestants": {"ours": ours.summary(), "limit": limit.summary()},
        "comparisons": {
            "p50": compare(ours, limit, "p50", 1.0),
            "missed": judge("missed", 1.0, "ticks", 0.0),
            "processor": judge("processor", 0.1, "share", None),
            "cost": judge("cost", 61.0, "us", 60.0),
        },
        "conditions": {"cores": [0, 1], "kernel": "Linux"},
    }


def test_every_row_of_a_table_has_all_its_columns(result: dict[str, Any]) -> None:
    for table in tables(result):
        assert {len(row) for row in table.rows} == {len(table.columns)}


def test_the_table_of_targets_says_what_is_reached(result: dict[str, Any]) -> None:
    (targets,) = (table for table in tables(result) if "targets" in table.title)
    assert [row[1:] for row in targets.rows] == [
        ("0.5", "0.5 to 0.5", "at most 1", "yes"),
        ("1", "", "at most 0", "no"),
        ("10.0%", "", "", ""),
        ("61 us", "", "at most 60 us", "no"),
    ]


@pytest.mark.live
def test_a_contestant_that_fails_is_named() -> None:
    with pytest.raises(RunError, match=r"forcebound\.benchmark\.pacing ended with status 1"):
        collect(module("pacing", "not a core"), 0.1, Measured("one"))


@pytest.mark.live
def test_a_process_ends_with_what_needs_it_even_if_that_fails() -> None:
    def fail() -> Iterator[int]:
        with started(module("pacing", 0, "other", 1_000_000, 60_000)) as process:
            yield process.pid
            raise RuntimeError

    failing = fail()
    pid = next(failing)
    with pytest.raises(RuntimeError):
        next(failing)
    assert not Path(f"/proc/{pid}").exists()


@pytest.mark.live
@needs_compiler
@pytest.mark.parametrize("name", sorted(BENCHMARKS))
def test_a_short_run_gives_every_figure(name: str) -> None:
    said: list[str] = []
    result = BENCHMARKS[name].run(duration=0.3, progress=said.append)
    assert json.loads(json.dumps(result, allow_nan=False)) == result
    assert said
    for one in result["contestants"].values():
        assert one["count"] > 0
        assert 0 < one["processor_share"] < 10
        times = [one[key] for key in ("p50_us", "p99_us", "p99_9_us", "max_us")]
        assert times == sorted(times)
        assert all(math.isfinite(time) and time > 0 for time in times)
    for one in result["comparisons"].values():
        assert math.isfinite(one["value"])
        assert one["value"] >= 0 or "beyond" in one["what"]  # a difference, on a noisy machine
    assert {"cores", "kernel", "policies", "python", "pyzmq"} <= set(result["conditions"])
    assert tables(result)


def test_the_benchmark_of_the_codec_measures_every_packet() -> None:
    done = subprocess.run(
        [sys.executable, str(CODEC), "--rounds", "1", "--calls", "5", "--json"],
        capture_output=True,
        text=True,
        check=False,
    )
    document = json.loads(done.stdout)  # its status depends on the machine
    assert set(document["packets"]) == {
        "device_state",
        "environment_query",
        "environment_reply",
        "force_command",
        "telemetry",
    }
    assert all(one["warm_ratio"] > 0 for one in document["packets"].values())
