"""Recorded delays: file format, replay on a link, recording."""

import json
import math
import re
from dataclasses import replace
from pathlib import Path

import pytest
from builders import MS, TimedPacket
from chance_tests import EveryPacket
from fakes import press
from hypothesis import given
from hypothesis import strategies as st
from launch_texts import GOOD, problems_of, written

from forcebound.errors import ConfigError
from forcebound.graph.loader import from_document, load
from forcebound.graph.resolved import to_document
from forcebound.network.impairment import Impairment, Outage
from forcebound.network.link import Link
from forcebound.network.trace import DelayTrace, Opportunities, read_csv, read_numbers
from forcebound.recordings.delay_traces import read_trace, shortest_of
from forcebound.run.build import build_links
from forcebound.run.virtual import run_virtual

WIFI = "time_s,delay_s\n10,0.004\n10.010,\n10.020,0.002\n"  # 30 ms long
NAMED = Impairment(trace=Path("wifi.csv"))


def wifi() -> DelayTrace:
    return DelayTrace((10.0, 10.01, 10.02), (0.004, None, 0.002))


# The file


def test_a_file_is_read_as_it_was_written(tmp_path: Path) -> None:
    trace = DelayTrace((0.0, 0.0010004, 0.5), (0.0, None, 0.012345678))
    trace.write(tmp_path / "trace.csv")
    again = read_csv(tmp_path / "trace.csv")
    assert (again.times, again.delays) == (trace.times, trace.delays)


def test_empty_lines_and_the_mark_of_spreadsheets_are_passed_over(tmp_path: Path) -> None:
    path = written(tmp_path, b"\xef\xbb\xbftime_s,delay_s\r\n0,0.001\r\n\r\n1, \r\n", "a.csv")
    assert read_csv(path).delays == (0.001, None)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("0,0.1\n", "wrong.csv:1: "),
        ("time_us,delay_us\n0,1\n", "wrong.csv:1: .*time_ms.*delay_ms.*'time_us,delay_us'"),
        ("time_s,delay_s,delay_ms\n0,1,1\n", "wrong.csv:1: "),
        ("No.,Time,Source,Info\n1,0.0,10.0.0.1,Echo\n", "wrong.csv:1: .*tcp.analysis.ack_rtt"),
        ("frame.time\ttcp.analysis.ack_rtt\nJan 1\t0.1\n", "wrong.csv:1: .*frame.time_epoch"),
        ("frame.time_epoch;icmp.resptime\n1.0;2,3\n", "wrong.csv:2: .*'1.0,2,3'"),
        ("time_s,delay_s\n", "got none"),
        ("time_s,delay_s\n0,x\n", "wrong.csv:2: .*'0,x'"),
        ('time_s,delay_s\n0,"1\n', "wrong.csv:2: "),
        ("time_s,delay_s\n0,1,2\n", "wrong.csv:2: "),
        ("time_s,delay_s\n,1\n", "wrong.csv:2: "),
        ("time_s,delay_s\n0,-1e-9\n", "wrong.csv:2: .*>= 0"),
        ("time_s,delay_s\n0,nan\n", "wrong.csv:2: .*empty cell for a lost packet; got nan"),
        ("time_s,delay_s\n0,0\n1e-10,0\n", "wrong.csv:3: "),
    ],
)
def test_what_is_no_trace_is_refused_at_its_line(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        read_csv(written(tmp_path, text, "wrong.csv"))


def test_a_file_that_cannot_be_read_or_written_is_named(tmp_path: Path) -> None:
    for name, what in (("missing.csv", "trace"), ("missing.mcap", "recording")):
        with pytest.raises(ConfigError, match=f"cannot read the {what} .*{name}: No such file"):
            read_trace(tmp_path / name)
    with pytest.raises(ConfigError, match=r"bytes.csv:2:2: byte 0xff is not UTF-8"):
        read_csv(written(tmp_path, b"time_s\n0\xff", "bytes.csv"))
    with pytest.raises(ConfigError, match=r"cannot write the trace .*no/trace\.csv"):
        wifi().write(tmp_path / "no" / "trace.csv")


@pytest.mark.parametrize(
    ("times", "delays", "message"),
    [
        ((0.0,), (), "got 0 and 1"),
        ((0.0,), (math.nan,), ">= 0 s"),
        ((0.0, 0.0), (0.0, 0.0), "must increase"),
    ],
)
def test_impossible_traces_are_refused(
    times: tuple[float, ...], delays: tuple[float, ...], message: str
) -> None:
    with pytest.raises(ConfigError, match=message):
        DelayTrace(times, delays)


# The files of others


@pytest.mark.parametrize(
    ("text", "times", "delays"),
    [
        ("time_ms,delay_ms\n0,1\n20,\n", (0.0, 0.02), (0.001, None)),
        (  # tshark -T fields -E header=y -E quote=d; an acknowledgement has a round trip, data none
            "frame.number\tframe.time_epoch\tip.src\ttcp.analysis.ack_rtt\r\n"
            '"1"\t"1700000000.25"\t"10.0.0.1"\t""\r\n'
            '"2"\t"1700000000.50"\t"10.0.0.2"\t"0.031250000"\r\n'
            '"3"\t"1700000000.50"\t"10.0.0.2"\t"0.015625000"\r\n'
            '"4"\t"1700000001.00"\t"10.0.0.2"\t"0.062500000"\r\n',
            (1700000000.5, 1700000001.0),
            (0.015625, 0.0625),
        ),
        ("icmp.resptime;frame.time_relative\n12.5;0.0\n;0.5\n25;1\n", (0.0, 1.0), (0.0125, 0.025)),
    ],
)
def test_a_table_of_others_is_read_by_the_names_of_its_columns(
    tmp_path: Path, text: str, times: tuple[float, ...], delays: tuple[float | None, ...]
) -> None:
    trace = read_csv(written(tmp_path, text, "other.csv"))
    assert (trace.times, trace.delays) == (times, delays)


@pytest.mark.parametrize(
    ("text", "form", "times", "delays"),
    [
        ("# ping, ms\n20.5\n\nnan\n  21 \n", "ms", (0.0, 0.25, 0.5), (0.0205, None, 0.021)),
        ("0.5\n-\n", "s", (0.0, 0.25), (0.5, None)),
        ("0 2\n10\t4\n", "ms", (0.0, 0.01), (0.002, 0.004)),
        ("1.0, 0.25\n1.5,\n2.0 ,NaN\n", "s", (1.0, 1.5, 2.0), (0.25, None, None)),
        ("1;0.25\r\n2;0.5\r\n", "s", (1.0, 2.0), (0.25, 0.5)),
    ],
)
def test_numbers_without_a_header_are_delays_or_times_and_delays(
    tmp_path: Path,
    text: str,
    form: str,
    times: tuple[float, ...],
    delays: tuple[float | None, ...],
) -> None:
    trace = read_numbers(written(tmp_path, text, "numbers.txt"), form, 0.25)
    assert trace.times == pytest.approx(times)
    assert trace.delays == pytest.approx(delays)


@pytest.mark.parametrize(
    ("text", "form", "message"),
    [
        ("1\nslow\n", "ms", "n.txt:2: .*'slow'"),
        ("1\n-2\n", "ms", "n.txt:2: .*>= 0"),
        ("1\n\n# one\n2 3\n", "s", "n.txt:4: expected 1 .*'2 3'"),
        ("1 2 3\n", "s", "n.txt:1: .*'1 2 3'"),
        ("2 1\n1 1\n", "s", "n.txt:2: .*increase"),
        ("nan 1\n", "s", "n.txt:1: .*nan"),
        ("inf\n", "s", "n.txt:1: .*inf"),
        ("# nothing\n", "s", "got none"),
        ("5\n7\n6\n", "mahimahi", "n.txt:3: .*6 ms after 7 ms"),
        ("5\n7.5\n", "mahimahi", "n.txt:2: .*'7.5'"),
        ("5\n-7\n", "mahimahi", "n.txt:2: "),
        ("5\n9999999999999\n", "mahimahi", "n.txt:2: "),
        ("0\n0\n", "mahimahi", "above 0 ms"),
        ("", "mahimahi", "above 0 ms"),
    ],
)
def test_a_file_of_wrong_numbers_is_refused_at_its_line(
    tmp_path: Path, text: str, form: str, message: str
) -> None:
    with pytest.raises(ConfigError, match=message):
        read_numbers(written(tmp_path, text, "n.txt"), form, 0.001)


def test_a_packet_waits_for_the_next_opportunity_of_mahimahi(tmp_path: Path) -> None:
    trace = read_numbers(written(tmp_path, "2\n2\n5\n9\n", "cell.up"), "mahimahi", 0.001)
    waits = [trace.delay_ns(at * MS) for at in range(12)]
    ms = [2, 1, 0, 2, 1, 0, 3, 2, 1, 0, 1, 0]  # again from the start after 9 ms
    assert waits == [one * MS for one in ms]
    assert trace.delay_ns(9 * MS + 1) == 2 * MS - 1


@given(
    st.lists(st.integers(0, 50), min_size=1).map(sorted).filter(lambda times: times[-1] > 0),
    st.integers(1, 500),
)
def test_no_opportunity_is_passed_over(times: list[int], since: int) -> None:
    every = [time + times[-1] * turn for turn in range(1 + since // times[-1]) for time in times]
    expected = min(time for time in every if time >= since) - since
    assert Opportunities(times).delay_ns(since * MS) == expected * MS


# The replay


def test_each_row_holds_until_the_next_and_then_it_starts_again() -> None:
    trace = wifi()
    found = [trace.delay_ns(at * MS) for at in (0, 9, 10, 19, 20, 29, 30, 39, 40, 3_000_050)]
    assert found == [4 * MS, 4 * MS, None, None, 2 * MS, 2 * MS, 4 * MS, 4 * MS, None, 2 * MS]
    assert trace.delay_ns(10 * MS - 1) == 4 * MS
    assert trace.delay_ns(30 * MS - 1) == 2 * MS


def test_a_single_row_holds_for_ever() -> None:
    assert DelayTrace((5.0,), (0.003,)).delay_ns(10**15 + 1) == 3 * MS


@given(
    st.lists(st.tuples(st.integers(1, 10**9), st.none() | st.integers(0, 10**9)), min_size=2),
    st.integers(0, 10**12),
)
def test_it_is_the_last_row_at_or_before(rows: list[tuple[int, int | None]], since: int) -> None:
    times = [sum(step for step, _ in rows[:index]) for index in range(len(rows))]
    length = times[-1] + times[-1] - times[-2]
    trace = DelayTrace(
        [time * 1e-9 for time in times], [None if d is None else d * 1e-9 for _, d in rows]
    )
    at = since % length
    row = max(index for index, time in enumerate(times) if time <= at)
    assert trace.delay_ns(since) == rows[row][1]


def link_of(impairment: Impairment = NAMED) -> Link[TimedPacket]:
    return EveryPacket(impairment, 1, wifi())


def through(link: Link[TimedPacket], arrivals: list[int]) -> dict[int, int]:
    """When each packet is through, in ns, by its number, in the order of delivery."""
    for seq, time_ns in enumerate(arrivals):
        link.accept(time_ns, TimedPacket(seq, time_ns))
    found: dict[int, int] = {}
    while (due_ns := link.next_due_ns) is not None:
        found |= {packet.seq: due_ns for packet in link.due(due_ns)}
    return found


def test_time_counts_from_the_first_packet_of_the_link() -> None:
    start = 123_456_789
    arrivals = [start, start + 9 * MS, start + 10 * MS, start + 20 * MS, start + 30 * MS]
    link = link_of()
    assert through(link, arrivals) == {
        0: start + 4 * MS,
        1: start + 13 * MS,
        3: start + 22 * MS,
        4: start + 34 * MS,
    }
    assert (link.sent, link.lost, link.delivered) == (5, 1, 4)


def test_a_packet_that_was_overtaken_is_superseded() -> None:
    link = Link[TimedPacket](NAMED, 1, DelayTrace((0.0, 0.001), (0.005, 0.001)))
    assert list(through(link, [0, MS])) == [1]
    assert link.superseded == 1


def test_a_trace_goes_with_loss_duplicates_and_outages() -> None:
    impairment = Impairment(
        trace=Path("wifi.csv"), loss=0.3, duplicate=0.3, outages=(Outage(0.1, 0.05),)
    )
    link = link_of(impairment)
    arrivals = [seq * MS for seq in range(3000)]
    found = through(link, arrivals)
    assert link.sent + link.duplicated == link.lost + link.delivered
    in_gap = {seq for seq in range(3000) if 10 <= seq % 30 < 20 or 100 <= seq < 150}
    assert not in_gap & set(found)
    assert {found[seq] - seq * MS for seq in found if seq % 30 < 10} == {4 * MS}
    assert {found[seq] - seq * MS for seq in found if seq % 30 >= 20} == {2 * MS}
    plain = EveryPacket(Impairment(loss=0.3, duplicate=0.3), 1)
    assert set(found) == set(through(plain, arrivals)) - in_gap  # the same chances as without
    assert 0.15 < link.duplicated / 3000 < 0.25


def test_a_link_changes_to_a_trace_and_back_while_it_runs() -> None:
    link: Link[TimedPacket] = EveryPacket(Impairment(), 1)
    link.accept(0, TimedPacket(0, 0))
    link.change(NAMED, wifi())
    link.accept(5 * MS, TimedPacket(1, 0))
    link.accept(15 * MS, TimedPacket(2, 0))  # lost: a trace counts from the first packet
    link.change(Impairment(delay=0.001))
    link.accept(16 * MS, TimedPacket(3, 0))
    assert [packet.seq for packet in link.due(9 * MS)] == [0, 1]
    assert [packet.seq for packet in link.due(17 * MS)] == [3]
    assert link.lost == 1


def test_a_link_is_not_silently_perfect_without_its_trace() -> None:
    with pytest.raises(ValueError, match=r"trace wifi\.csv are missing"):
        EveryPacket(NAMED, 1)
    link: Link[TimedPacket] = EveryPacket(Impairment(), 1)
    with pytest.raises(ValueError, match="are missing"):
        link.change(NAMED)


@pytest.mark.parametrize("other", [Impairment(delay=0.001), Impairment(0.01, jitter=0.001)])
def test_a_trace_excludes_other_delays(other: Impairment) -> None:
    with pytest.raises(ConfigError, match="trace sets each delay: give it without delay"):
        replace(other, trace=Path("wifi.csv"))


# In a launch file


def traced(folder: Path, trace: str = WIFI, link: str = "trace: wifi.csv") -> Path:
    written(folder, trace, "wifi.csv")
    return written(folder, GOOD.replace("delay: 2 ms", link))


def test_a_launch_file_names_a_trace_relative_to_itself(tmp_path: Path) -> None:
    config = load(traced(tmp_path))
    assert config.only.links["environment_query"] == Impairment(trace=tmp_path / "wifi.csv")
    assert from_document(json.loads(json.dumps(to_document(config)))) == config
    (link,) = build_links(config).values()
    link.accept(0, press("none", 0.002)[0])
    assert link.next_due_ns == 4 * MS


@pytest.mark.parametrize(
    ("trace", "link", "message"),
    [
        ("time_s\n", "trace: wifi.csv", "16:30: trace: "),
        (WIFI, "trace: gone.csv", "16:30: trace: cannot read the trace "),
        (WIFI, "trace: 5", "16:30: trace: expected "),
        (WIFI, "trace: wifi.csv, delay: 1 ms", "trace sets each delay"),
    ],
)
def test_problems_with_a_trace_are_told_at_their_place(
    tmp_path: Path, trace: str, link: str, message: str
) -> None:
    assert message in problems_of(traced(tmp_path, trace, link))


def test_a_trace_slower_than_the_age_limit_is_refused(tmp_path: Path) -> None:
    path = traced(tmp_path, "time_s,delay_s\n0,0.2\n1,0.15\n")
    assert "an answer takes at least 150 ms" in problems_of(path)


@pytest.mark.parametrize(
    ("link", "message"),
    [
        ("trace_format: ms", "16:37: trace_format .*give trace"),
        ("trace: wifi.csv, trace_format: ms", "16:30: trace: .*wifi.csv:1: "),
        ("trace: wifi.csv, trace_format: s, delay: 1 ms", "trace sets each delay"),
        ("trace: wifi.csv, trace_format: mahimahi, jitter: 1 ms", "trace sets each delay"),
    ],
)
def test_a_format_goes_with_a_file_of_numbers(tmp_path: Path, link: str, message: str) -> None:
    assert re.search(message, problems_of(traced(tmp_path, link=link)))


def test_a_launch_file_replays_mahimahi_with_a_delay_beside_it(tmp_path: Path) -> None:
    link = "trace: wifi.csv, trace_format: mahimahi, delay: 3 ms"
    config = load(traced(tmp_path, "4\n8\n", link))
    assert from_document(json.loads(json.dumps(to_document(config)))) == config
    assert shortest_of(config.only.links["environment_query"]) == 0.003
    result = run_virtual(replace(config, duration=0.1))
    # A query waits up to 4 ms, then 3 ms; the device waits for whole ticks.
    assert 0.006 < result.columns.loop_delay[-50:].max() < 0.009


def test_the_shortest_time_is_that_of_the_trace(tmp_path: Path) -> None:
    written(tmp_path, WIFI, "wifi.csv")
    assert shortest_of(Impairment(trace=tmp_path / "wifi.csv")) == 0.002
    assert shortest_of(Impairment(trace=tmp_path / "wifi.csv", reorder=0.1)) == 0.0
    assert shortest_of(Impairment(delay=0.001)) == 0.001
    lost = written(tmp_path, "time_s,delay_s\n0,\n", "lost.csv")
    assert shortest_of(Impairment(trace=lost)) == 0.0


def test_a_changed_file_is_read_again(tmp_path: Path) -> None:
    path = written(tmp_path, WIFI, "wifi.csv")
    assert read_trace(path).shortest == 0.002
    written(tmp_path, "time_s,delay_s\n0,0.0001\n", "wifi.csv")
    assert read_trace(path).shortest == 0.0001


def test_a_phase_replays_a_trace(tmp_path: Path) -> None:
    path = traced(tmp_path, link="delay: 2 ms")
    settings = "links.environment_query.delay: 0, links.environment_query.trace: wifi.csv"
    text = path.read_text().replace("duration: 6 s\n", "") + (
        "phases:\n"
        "  - { name: fixed, duration: 60 ms }\n"
        f"  - {{ name: recorded, duration: 60 ms, set: {{ {settings} }} }}\n"
    )
    result = run_virtual(load(written(tmp_path, text)))
    columns = result.columns
    fixed = (columns.time_ns > 5 * MS) & (columns.time_ns < 60 * MS)
    assert set(columns.loop_delay[fixed].round(4)) == {0.0024}
    assert columns.loop_delay[columns.time_ns > 60 * MS].max() > 0.01  # where all is lost
