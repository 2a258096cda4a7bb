"""Links: possible and impossible fates of packets."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import pytest
from builders import MS, TimedPacket
from chance_tests import SURELY_NOT, EveryPacket, binomial_tail, distance_is_likely, is_likely
from hypothesis import given
from hypothesis import strategies as st

from forcebound.messages.packets import DeviceState, EnvironmentReply, ForceCommand, Telemetry
from forcebound.network.impairment import Impairment
from forcebound.network.link import RESTART_NS, Link, Stamped, link_seed

PERIOD_NS = MS


@dataclass(frozen=True)
class Answer:
    """A packet that answers a device state."""

    seq: int
    time_ns: int
    device_seq: int
    device_time_ns: int


def stream(count: int, first: int = 0, start_ns: int = 0) -> list[TimedPacket]:
    """One packet a millisecond."""
    return [TimedPacket(first + i, start_ns + i * PERIOD_NS) for i in range(count)]


def drain(link: Link[Any]) -> list[tuple[int, Any]]:
    """Everything on the way, asked for at the very times at which it is through."""
    deliveries = []
    while (due_ns := link.next_due_ns) is not None:
        deliveries += [(due_ns, packet) for packet in link.due(due_ns)]
    return deliveries


def deliver(
    link: Link[TimedPacket], packets: Iterable[TimedPacket]
) -> list[tuple[int, TimedPacket]]:
    """Run ``packets``, each sent at its stamp, through ``link``; return (time, packet)."""
    deliveries = []
    for packet in packets:
        while link.next_due_ns is not None and link.next_due_ns < packet.time_ns:
            due_ns = link.next_due_ns
            deliveries += [(due_ns, through) for through in link.due(due_ns)]
        link.accept(packet.time_ns, packet)
    return deliveries + drain(link)


impairments = st.builds(
    Impairment,
    delay=st.floats(0, 0.05),
    jitter=st.floats(0, 0.05),
    loss=st.sampled_from([0.0, 0.1, 0.5, 1.0]),
)

# What a link promises, whatever the impairment


@given(
    impairment=impairments,
    seed=st.integers(0, 2**64),
    actions=st.lists(st.tuples(st.booleans(), st.integers(0, 30 * MS)), max_size=60),
)
def test_no_packet_is_gained_or_forgotten_or_kept_back(
    impairment: Impairment, seed: int, actions: list[tuple[bool, int]]
) -> None:
    link: Link[TimedPacket] = Link(impairment, seed)
    now = 0
    delivered: list[TimedPacket] = []
    for seq, (is_asked, wait_ns) in enumerate(actions):
        now += wait_ns
        link.accept(now, TimedPacket(seq, now))
        if is_asked:
            delivered += link.due(now)
            assert link.next_due_ns is None or link.next_due_ns > now
    delivered += link.due(now + 200 * MS)
    assert link.queued == 0
    assert len(delivered) == len(set(delivered)) == link.delivered
    assert delivered == sorted(delivered, key=lambda packet: packet.seq)


@given(impairments, st.integers(0, 2**64))
def test_every_delivery_is_within_the_jitter_and_never_before_the_arrival(
    impairment: Impairment, seed: int
) -> None:
    latest_ns = (impairment.delay + impairment.jitter) * 1e9 + 1
    earliest_ns = max(0.0, (impairment.delay - impairment.jitter) * 1e9 - 1)
    for time_ns, packet in deliver(EveryPacket(impairment, seed), stream(50)):
        assert earliest_ns <= time_ns - packet.time_ns <= latest_ns


def test_another_seed_gives_other_deliveries() -> None:
    impairment = Impairment(delay=0.01, jitter=0.005, loss=0.1)
    runs = {tuple(deliver(EveryPacket(impairment, seed), stream(50))) for seed in range(20)}
    assert len(runs) == 20


def test_the_packets_do_not_decide_their_fate() -> None:
    impairment = Impairment(delay=0.02, jitter=0.01, loss=0.3)
    one = deliver(EveryPacket(impairment, 1), stream(100))
    other = deliver(EveryPacket(impairment, 1), stream(100, first=5000))
    assert [time_ns for time_ns, _ in one] == [time_ns for time_ns, _ in other]


# What the impairments are


def test_a_perfect_link_delivers_at_once() -> None:
    packets = stream(100)
    link: Link[TimedPacket] = Link(Impairment(), 1)
    for packet in packets:
        link.accept(packet.time_ns, packet)
        assert link.next_due_ns == packet.time_ns
        assert link.due(packet.time_ns - 1) == []
        assert link.due(packet.time_ns) == [packet]
    assert (link.sent, link.delivered, link.lost, link.superseded) == (100, 100, 0, 0)


def test_a_delay_is_exact_to_the_nanosecond() -> None:
    link: Link[TimedPacket] = EveryPacket(Impairment(delay=0.002_000_001), 1)
    assert deliver(link, stream(5)) == [
        (packet.time_ns + 2_000_001, packet) for packet in stream(5)
    ]


def test_equal_times_keep_the_order_of_arrival() -> None:
    link: Link[TimedPacket] = EveryPacket(Impairment(delay=0.001), 1)
    packets = [TimedPacket(seq, 0) for seq in (3, 1, 2, 0)]
    for packet in packets:
        link.accept(0, packet)
    assert link.due(MS) == packets


def test_a_loss_of_one_loses_all_and_of_zero_none() -> None:
    for loss, expected in ((0.0, 200), (1.0, 0)):
        link: Link[TimedPacket] = EveryPacket(Impairment(delay=0.001, loss=loss), 1)
        assert len(deliver(link, stream(200))) == expected
        assert link.lost == 200 - expected


@pytest.mark.parametrize("loss", [0.01, 0.5])
def test_packets_are_lost_with_the_given_probability(loss: float) -> None:
    count = 4000
    link: Link[TimedPacket] = EveryPacket(Impairment(loss=loss), link_seed(1, "loss"))
    deliver(link, stream(count))
    assert binomial_tail(count, loss, link.lost) > SURELY_NOT


@pytest.mark.parametrize("loss", [0.1, 0.5])
def test_losses_are_independent(loss: float) -> None:
    """Given that a packet is lost, the next is lost as often as any other."""
    packets = stream(8000)
    link: Link[TimedPacket] = EveryPacket(Impairment(loss=loss), link_seed(2, "loss"))
    arrived = {packet.seq for _, packet in deliver(link, packets)}
    lost = [packet.seq not in arrived for packet in packets]
    # Disjoint pairs, so that the pairs are independent and the count is binomial.
    seconds = [second for first, second in zip(lost[::2], lost[1::2], strict=True) if first]
    assert is_likely(seconds, loss)


def test_delays_are_uniform_within_the_jitter() -> None:
    count = 4000
    link: Link[TimedPacket] = EveryPacket(
        Impairment(delay=0.010, jitter=0.004), link_seed(1, "jitter")
    )
    deliveries = deliver(link, stream(count))
    delays = [time_ns - packet.time_ns for time_ns, packet in deliveries]
    assert all(6 * MS <= delay <= 14 * MS for delay in delays)
    assert distance_is_likely([(delay - 6 * MS) / (8 * MS) for delay in delays])


def test_jitter_beyond_the_delay_stops_at_the_arrival() -> None:
    count = 2000
    link: Link[TimedPacket] = EveryPacket(
        Impairment(delay=0.001, jitter=0.004), link_seed(1, "clamp")
    )
    delays = [time_ns - packet.time_ns for time_ns, packet in deliver(link, stream(count))]
    assert min(delays) == 0
    assert max(delays) <= 5 * MS
    assert is_likely([delay == 0 for delay in delays], 3 / 8)  # u <= -1/4


def test_survivors_are_delayed_as_if_there_were_no_loss() -> None:
    without, with_loss = (
        {
            packet: time_ns
            for time_ns, packet in deliver(
                EveryPacket(Impairment(delay=0.01, jitter=0.005, loss=loss), 7), stream(300)
            )
        }
        for loss in (0.0, 0.3)
    )
    assert len(with_loss) < len(without)
    assert with_loss.items() <= without.items()


def test_a_change_leaves_packets_on_the_way_alone() -> None:
    link: Link[TimedPacket] = EveryPacket(Impairment(delay=0.05), 1)
    first, second = TimedPacket(0, 0), TimedPacket(1, MS)
    link.accept(0, first)
    link.change(Impairment(delay=0.001))
    link.accept(MS, second)
    assert drain(link) == [(2 * MS, second), (50 * MS, first)]


def test_links_of_a_graph_have_seeds_of_their_own() -> None:
    seeds = {link_seed(seed, topic) for seed in range(-2, 50) for topic in ("a", "b", "0/a")}
    assert len(seeds) == 52 * 3
    assert link_seed(1, "environment_query") == link_seed(1, "environment_query")


# Newest wins


def test_of_the_packets_that_are_through_only_the_newest_is_delivered() -> None:
    link: Link[TimedPacket] = Link(Impairment(delay=0.001), 1)
    for packet in stream(5):
        link.accept(0, packet)
    assert link.due(MS) == [stream(5)[-1]]
    assert (link.delivered, link.superseded) == (1, 4)


def test_a_pause_leaves_no_backlog() -> None:
    packets = stream(1000)
    link: Link[TimedPacket] = Link(Impairment(delay=0.002, jitter=0.001), 1)
    for packet in packets[:500]:  # nobody asks for half a second
        link.accept(packet.time_ns, packet)
    first, *rest = link.due(500 * MS)
    assert rest == []
    assert first.seq >= 496
    for packet in packets[500:]:
        link.accept(packet.time_ns, packet)
        for through in link.due(packet.time_ns):
            assert packet.time_ns - through.time_ns <= 4 * MS


def test_nothing_older_than_what_was_delivered_comes_later() -> None:
    packets = stream(300)
    link: Link[TimedPacket] = Link(Impairment(delay=0.02, jitter=0.02), 3)
    order = [packet.seq for _, packet in deliver(link, packets)]
    assert order == sorted(set(order))
    assert link.superseded > 100


def test_a_packet_that_comes_twice_is_delivered_once() -> None:
    link: Link[TimedPacket] = Link(Impairment(), 1)
    packet = TimedPacket(3, 0)
    link.accept(0, packet)
    assert link.due(0) == [packet]
    link.accept(1, packet)
    assert link.due(1) == []
    assert link.superseded == 1


def test_equal_stamps_are_told_apart_by_their_sequence_numbers() -> None:
    link: Link[TimedPacket] = Link(Impairment(), 1)
    for seq in (0, 2, 1, 3):
        link.accept(0, TimedPacket(seq, 0))
    assert link.due(0) == [TimedPacket(3, 0)]
    link.accept(0, TimedPacket(2, 0))
    assert link.due(0) == []


def test_answers_are_ordered_by_the_state_that_they_answer() -> None:
    link: Link[Answer] = Link(Impairment(), 1)
    newer = Answer(seq=0, time_ns=0, device_seq=8, device_time_ns=8 * MS)
    older = Answer(seq=1, time_ns=9, device_seq=7, device_time_ns=7 * MS)
    second = Answer(seq=2, time_ns=9, device_seq=8, device_time_ns=8 * MS)
    for packet, expected in ((newer, [newer]), (older, []), (second, [second]), (newer, [])):
        link.accept(0, packet)
        assert link.due(0) == expected


# Restarts


def accepted_after(link: Link[Any], packets: Iterable[Stamped]) -> list[Stamped]:
    """What is delivered if each packet arrives and is asked for at once."""
    delivered = []
    for time_ns, packet in enumerate(packets):
        link.accept(time_ns, packet)
        delivered += link.due(time_ns)
    return delivered


@pytest.mark.parametrize(
    ("before", "after"),
    [
        # A process counts from 0, its machine's clock goes on; of a machine both begin again.
        (stream(5000), stream(10, start_ns=5100 * MS)),
        (stream(5000, start_ns=3600 * 1000 * MS), stream(10, start_ns=30_000 * MS)),
        # A process that answers, and the device that is answered.
        (
            [Answer(i, i, 100 + i, (100 + i) * MS) for i in range(900)],
            [Answer(i, 0, 1100 + i, (1100 + i) * MS) for i in range(10)],
        ),
        (
            [Answer(i, i, i, i * MS) for i in range(900)],
            [Answer(900 + i, 900 + i, i, (1100 + i) * MS) for i in range(10)],
        ),
    ],
    ids=["process", "machine", "answerer", "device"],
)
def test_what_has_restarted_is_heard_at_once(before: list[Any], after: list[Any]) -> None:
    link: Link[Any] = Link(Impairment(), 1)
    accepted_after(link, before)
    assert accepted_after(link, after) == after


def test_a_clock_set_back_is_never_refused_for_longer_than_stated() -> None:
    link: Link[TimedPacket] = Link(Impairment(), 1)
    accepted_after(link, stream(600))
    again = stream(2000)  # the same clock, from 0 again after 0.6 s
    heard = accepted_after(link, again)
    assert heard == again[600:]
    assert heard[0].time_ns <= RESTART_NS


def test_packets_of_a_former_life_do_not_come_after_the_new_one() -> None:
    link: Link[TimedPacket] = Link(Impairment(delay=0.1, jitter=0.1), 5)
    former = stream(100, first=90_000, start_ns=90_000 * MS)
    new = stream(100, first=0, start_ns=5 * MS)
    for packet in former + new:  # all arrive in one instant, and overtake each other
        link.accept(0, packet)
    order = [packet.seq for _, packet in drain(link)]
    change = next(place for place, seq in enumerate(order) if seq < 90_000)
    assert all(seq < 90_000 for seq in order[change:])
    assert order[change:] == sorted(order[change:])


def test_one_absurd_packet_does_not_silence_the_stream() -> None:
    link: Link[TimedPacket] = Link(Impairment(), 1)
    accepted_after(link, [*stream(10), TimedPacket(2**63 - 1, 2**63 - 1)])
    rest = stream(10, first=11, start_ns=11 * MS)
    assert accepted_after(link, rest) == rest


# Real packets


def test_it_takes_every_packet_of_the_graph() -> None:
    zero = (0.0,)
    state = DeviceState(1, 2, 0.0, zero, zero, zero)
    reply = EnvironmentReply(1, 2, 3, 4, 5, 6, zero, "e")
    command = ForceCommand(1, 2, 3, 4, zero)
    telemetry = Telemetry(
        1, 2, 0.0, zero, zero, zero, 0.0, 0.0, None, None, None, 0.0, None, None, 0, {}
    )
    for packet in (state, reply, command, telemetry):
        link: Link[Any] = Link(Impairment(), 1)
        link.accept(10, packet)
        assert link.due(10) == [packet]
