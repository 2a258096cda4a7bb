"""Impairments beyond delay, jitter and loss, against their definitions."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest
from builders import MS, TimedPacket, query
from chance_tests import (
    SURELY_NOT,
    EveryPacket,
    binomial_tail,
    delays,
    is_likely,
    passed,
)
from fakes import press
from hypothesis import given
from hypothesis import strategies as st
from launch_texts import GOOD, problems_of, written

from forcebound.errors import ConfigError
from forcebound.graph.loader import from_document, load
from forcebound.graph.resolved import to_document
from forcebound.messages.codec import encode
from forcebound.messages.packets import EnvironmentQuery, EnvironmentReply
from forcebound.network.impairment import QUANTILES, GilbertElliott, Impairment, Outage, Spike
from forcebound.network.link import Link
from forcebound.quantities import DAY

# Every setting

share = st.sampled_from([0.0, 0.1, 0.5, 1.0])
times = st.floats(0, 0.02)
impairments = st.builds(
    Impairment,
    delay=st.floats(1e-6, 0.02),
    jitter=times,
    distribution=st.sampled_from(sorted(QUANTILES)),
    correlation=share,
    gemodel=st.none() | st.builds(GilbertElliott, p=share, r=share, h=share, k=share),
    duplicate=share,
    corrupt=share,
    reorder=share,
    rate=st.sampled_from([0.0, 1e4, 1e6]),
    limit=st.integers(0, 10),
    deadband=st.sampled_from([0.0, 0.1]),
    outages=st.lists(st.builds(Outage, times, times), max_size=2).map(tuple),
    spikes=st.lists(
        st.builds(Spike, st.floats(0.04, 0.1), times, times, times, share), max_size=2
    ).map(tuple),
)
impairments |= st.builds(replace, impairments, gemodel=st.none(), loss=share)


@given(
    impairments,
    st.integers(0, 2**64),
    st.lists(st.tuples(st.booleans(), st.integers(0, 10 * MS)), max_size=60),
)
def test_every_packet_is_counted_once(
    impairment: Impairment, seed: int, actions: list[tuple[bool, int]]
) -> None:
    link: Link[TimedPacket] = Link(impairment, seed)
    now = delivered = 0
    for seq, (is_asked, wait_ns) in enumerate(actions):
        now += wait_ns
        link.accept(now, TimedPacket(seq, now), 100)
        if is_asked:
            delivered += len(link.due(now))
        outcomes = link.lost + link.corrupted + link.delivered + link.superseded + link.queued
        assert link.sent + link.duplicated == outcomes
        assert link.delivered == delivered
    link.due(10**15)
    assert link.queued == 0
    assert (
        link.sent + link.duplicated == link.lost + link.corrupted + link.delivered + link.superseded
    )


@given(impairments, st.integers(0, 2**64))
def test_seed_and_arrivals_decide_and_asking_does_not(impairment: Impairment, seed: int) -> None:
    _, patient = passed(impairment, 50, seed)
    assert passed(impairment, 50, seed)[1] == patient
    eager: Link[TimedPacket] = EveryPacket(impairment, seed)
    asked = []
    for seq in range(50):
        now = seq * MS
        asked += eager.due(now - 1)
        eager.accept(now, TimedPacket(seq, now))
    assert asked + eager.due(10**15) == [packet for _, packet in patient]


@given(st.floats(0, 0.02), st.floats(0, 0.02), share, st.integers(0, 2**64))
def test_an_impairment_that_never_acts_changes_nothing(
    delay: float, jitter: float, loss: float, seed: int
) -> None:
    plain = Impairment(delay, jitter, loss)
    beside = replace(plain, limit=10**9, outages=(Outage(100.0, 1.0),))
    assert plain.is_plain
    assert not beside.is_plain
    assert passed(beside, 50, seed)[1] == passed(plain, 50, seed)[1]


def test_a_duplicate_changes_nothing_for_the_others() -> None:
    impairment = Impairment(delay=0.01, jitter=0.005, loss=0.2)
    _, without = passed(impairment, 300)
    _, doubled = passed(replace(impairment, duplicate=0.3), 300)
    assert set(without) <= set(doubled)


# Duplicate, corrupt, reorder


def test_packets_are_duplicated_with_the_given_probability() -> None:
    count = 4000
    link, deliveries = passed(Impairment(delay=0.001, duplicate=0.2), count)
    assert binomial_tail(count, 0.2, link.duplicated) > SURELY_NOT
    assert len(deliveries) == count + link.duplicated
    assert {packet.seq for _, packet in deliveries} == set(range(count))


def test_of_a_packet_that_is_lost_and_duplicated_one_goes_on() -> None:
    link, deliveries = passed(Impairment(loss=1.0, duplicate=1.0), 100)
    assert len(deliveries) == 100
    assert (link.lost, link.duplicated) == (100, 100)


def test_corrupt_packets_take_their_time_and_are_thrown_away() -> None:
    count = 4000
    link, deliveries = passed(Impairment(corrupt=0.1), count)
    assert binomial_tail(count, 0.1, link.corrupted) > SURELY_NOT
    assert len(deliveries) == count - link.corrupted
    slow = Impairment(rate=1000.0)  # 128 ms a packet
    _, whole = passed(slow, 50)
    link, rest = passed(replace(slow, corrupt=0.5), 50)
    assert link.corrupted > 0
    assert set(rest) < set(whole)


def test_reordered_packets_go_at_once() -> None:
    count = 4000
    found = delays(Impairment(delay=0.010, reorder=0.25), count)
    assert set(found) == {0, 10 * MS}
    assert is_likely([delay == 0 for delay in found], 0.25)


# Rate and limit


def test_packets_leave_one_after_the_other_at_the_rate() -> None:
    impairment = Impairment(rate=100_000.0)  # 200 bytes: 2 ms
    _, deliveries = passed(impairment, 5, period_ns=MS, size=200)
    assert [time_ns for time_ns, _ in deliveries] == [2 * MS, 4 * MS, 6 * MS, 8 * MS, 10 * MS]
    _, deliveries = passed(impairment, 3, period_ns=3 * MS, size=200)  # idle between
    assert [time_ns for time_ns, _ in deliveries] == [2 * MS, 5 * MS, 8 * MS]


def test_delay_and_rate_add_as_in_netem() -> None:
    impairment = Impairment(delay=0.010, rate=100_000.0)
    _, deliveries = passed(impairment, 4, size=200)
    assert [time_ns for time_ns, _ in deliveries] == [12 * MS, 14 * MS, 16 * MS, 18 * MS]


def test_no_more_than_the_limit_is_on_the_way() -> None:
    link, deliveries = passed(Impairment(delay=0.010, limit=3), 23)
    # Three get in each 10 ms; the place of one that is through is free at once.
    assert [packet.seq for _, packet in deliveries] == [0, 1, 2, 10, 11, 12, 20, 21, 22]
    assert link.lost == 14


def test_a_changed_limit_counts_what_is_on_the_way() -> None:
    link: Link[TimedPacket] = EveryPacket(Impairment(delay=0.010), 1)
    for seq in range(5):
        link.accept(0, TimedPacket(seq, 0))
    link.change(Impairment(limit=5))
    link.accept(1, TimedPacket(5, 1))
    assert link.lost == 1
    link.accept(10 * MS, TimedPacket(6, 1))
    assert link.lost == 1


# Refusals and launch files


@pytest.mark.parametrize(
    ("make", "field"),
    [
        (partial(Impairment, -0.001), "delay"),
        (partial(Impairment, correlation=-1.0), "correlation"),
        (partial(Impairment, distribution="gamma"), "distribution"),  # type: ignore[arg-type]
        (partial(Impairment, reorder=0.1), "reorder"),
        (partial(Impairment, loss=0.1, gemodel=GilbertElliott(0.1, 0.1)), "gemodel"),
        (partial(GilbertElliott, 1.5, 0.1), "p"),
        (partial(Outage, 1.0, -1.0), "duration"),
        (partial(Outage, 0.0, 86_401.0), "duration"),  # a day at most
        (partial(Outage, 1e308, 0.0), "start"),
        (partial(Impairment, 1e308), "delay"),
        (partial(Impairment, jitter=1e308), "jitter"),
        (partial(Impairment, limit=2**63), "limit"),
        (partial(Impairment, rate=1e-300), "rate"),
    ],
)
def test_what_cannot_be_is_refused_with_its_field(make: Callable[[], object], field: str) -> None:
    with pytest.raises(ConfigError) as caught:
        make()
    assert caught.value.field == field


LARGEST = [
    Impairment(delay=DAY, jitter=DAY, distribution="pareto", limit=2**63 - 1, rate=1.0),
    Impairment(jitter=DAY, distribution="normal", outages=(Outage(DAY, DAY), Outage(0.0, 1e-9))),
    Impairment(delay=5e-324, jitter=5e-324, loss=5e-324, rate=1e30, reorder=1.0, duplicate=1.0),
]


@pytest.mark.parametrize("impairment", LARGEST)
def test_at_the_ends_of_the_ranges_every_packet_has_a_time_of_64_bits(
    impairment: Impairment,
) -> None:
    one, now_ns = Link[EnvironmentQuery](impairment, 1), 2**62
    for seq in range(50):
        one.accept(now_ns, query(seq), 60_000)
        one.due(now_ns)
    assert one.queued == 0 or now_ns <= (one.next_due_ns or 0) < 2**63


@pytest.mark.parametrize(
    ("impairment", "shortest"),
    [
        (Impairment(0.01, 0.004), 0.006),
        (Impairment(0.01, 0.003, distribution="pareto"), 0.008),
        (Impairment(0.01, 0.001, distribution="normal"), 0.006),
        (Impairment(0.01, reorder=0.1), 0.0),
    ],
)
def test_the_shortest_time_on_the_way(impairment: Impairment, shortest: float) -> None:
    assert impairment.shortest == pytest.approx(shortest)


ALL = """{delay: 2 ms, jitter: 500 us, distribution: paretonormal, correlation: 25 %,
    gemodel: {p: 1 %, r: 20 %, h: 5 %, k: 99 %}, duplicate: 1 %, corrupt: 0.1 %, reorder: 2 %,
    rate: 64 kB/s, limit: 100,
    outages: [{start: 1 s, duration: 100 ms}, {start: 3 s, duration: 0.5 s}]}"""


def test_a_launch_file_takes_all_of_it(tmp_path: Path) -> None:
    config = load(written(tmp_path, GOOD.replace("{delay: 2 ms}", ALL)))
    assert config.only.links["environment_query"] == Impairment(
        delay=0.002,
        jitter=0.0005,
        distribution="paretonormal",
        correlation=0.25,
        gemodel=GilbertElliott(0.01, 0.2, 0.05, 0.99),
        duplicate=0.01,
        corrupt=0.001,
        reorder=0.02,
        rate=64_000.0,
        limit=100,
        outages=(Outage(1.0, 0.1), Outage(3.0, 0.5)),
    )
    assert from_document(to_document(config)) == config


@pytest.mark.parametrize(
    ("given", "place", "fragment"),
    [
        ("rate: 3 ms", "16:29", "B/s"),
        ("gemodel: {p: 1 %, r: 200 %}", "16:44", "gemodel.r"),
        ("gemodel: {p: 1 %, x: 3}", "16:41", "'x'"),
        ("outages: [{start: 1 s, duration: 5 N}]", "16:56", "a time in s"),
    ],
)
def test_errors_are_told_at_their_place(
    given: str, place: str, fragment: str, tmp_path: Path
) -> None:
    problems = problems_of(written(tmp_path, GOOD.replace("delay: 2 ms", given)))
    assert f"graph.yaml:{place}" in problems
    assert fragment in problems


# In the graph


def test_the_rate_counts_the_bytes_of_the_encoded_packet() -> None:
    packets = press("certified", 0.02, environment_query=Impairment(rate=1e6))
    query = next(packet for packet in packets if isinstance(packet, EnvironmentQuery))
    reply = next(packet for packet in packets if isinstance(packet, EnvironmentReply))
    assert reply.device_seq == query.device_seq
    assert reply.time_ns - query.time_ns == len(encode(query)) * 1000  # 1 byte in 1 µs
