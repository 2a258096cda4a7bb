"""The device node, fed by hand: its schedule, its safety chain, its events."""

import math
from itertools import pairwise
from typing import Any

import pytest
from builders import MS
from fakes import answer, device_node
from msgspec.structs import replace

from forcebound.graph.servo import ServoSettings
from forcebound.messages.codec import decode, encode
from forcebound.messages.events import EventLog
from forcebound.messages.packets import (
    DeviceState,
    Event,
    ForceCommand,
    Packet,
    Telemetry,
    Vector,
)
from forcebound.nodes.device import DeviceNode


def sample(node: DeviceNode, time_ns: int) -> DeviceState:
    (packet,) = node.step(time_ns, [])
    assert isinstance(packet, DeviceState)
    return packet


def write(node: DeviceNode, time_ns: int, *received: Packet) -> Telemetry:
    packet, *events = node.step(time_ns, received)
    assert {type(event) for event in events} <= {Event}
    assert isinstance(packet, Telemetry)
    return packet


def tick(node: DeviceNode, start_ns: int, force: Vector | None = None) -> Telemetry:
    """Run a whole tick, answered with ``force`` at once if there is one."""
    state = sample(node, start_ns)
    received = [] if force is None else [answer(state, force)]
    return write(node, start_ns + 400_000, *received)


# The device node's schedule


def test_a_tick_reads_at_its_start_and_writes_after_the_reply_wait() -> None:
    node, device = device_node(reply_wait=0.4)
    state = sample(node, 5 * MS)
    assert (state.seq, state.time_ns) == (0, 5 * MS)
    assert node.wake_ns == 5 * MS + 400_000
    assert node.step(5 * MS + 100_000, []) == []
    telemetry = write(node, 5 * MS + 400_000)
    assert telemetry.seq == 0
    assert device.written == [(5 * MS + 400_000, (0.0,))]
    assert node.wake_ns == 6 * MS


def test_ticks_keep_the_phase_that_they_are_given() -> None:
    node, _ = device_node(reply_wait=0.4)
    node.phase_ns = 500_000  # of two hands on one core, the second
    sample(node, 5 * MS + 300_000)
    assert node.wake_ns == 5 * MS + 300_000  # due at 4.9 ms: the tick began at 4.5 ms
    write(node, 5 * MS + 310_000)
    assert node.wake_ns == 5 * MS + 500_000


def test_late_ticks_are_skipped_and_counted_and_the_phase_is_kept() -> None:
    node, _ = device_node()
    tick(node, 0)
    state = sample(node, 4 * MS + 300_000)
    assert state.seq == 4
    assert node.deadline_misses == 3
    assert node.wake_ns == 4 * MS + 400_000
    write(node, 4 * MS + 400_000)
    assert node.wake_ns == 5 * MS


def test_the_velocity_is_the_filtered_difference_of_readings() -> None:
    node, device = device_node(velocity_cutoff=1e9)
    for k in range(5):
        device.position = (0.002 * k,)
        state = sample(node, k * MS)
        write(node, k * MS + 400_000)
    assert state.velocity[0] == pytest.approx(2.0, rel=1e-3)


# The safety chain


def test_no_force_before_the_launcher_says_so() -> None:
    node, device = device_node()
    telemetry = tick(node, 0, (2.0,))
    assert telemetry.applied_force == (0.0,)
    assert telemetry.device_seq is None
    assert device.engaged_ns is None
    node.engage()
    assert tick(node, 1 * MS, (2.0,)).applied_force == (0.0,)  # the ledger begins
    assert device.engaged_ns == 1 * MS
    assert tick(node, 2 * MS, (2.0,)).applied_force == (2.0,)


def test_a_force_that_answers_its_own_tick_is_written_in_it() -> None:
    node, device = device_node()
    node.engage()
    tick(node, 0)
    telemetry = tick(node, 1 * MS, (2.0,))
    assert telemetry.device_seq == telemetry.seq == 1
    assert telemetry.loop_delay == pytest.approx(0.4e-3)
    assert device.written[-1] == (1_400_000, (2.0,))


@pytest.mark.parametrize(
    ("command", "reason"),
    [
        (ForceCommand(0, 0, 0, 0, (math.nan,)), "not_finite"),
        (ForceCommand(0, 0, 0, 0, (math.inf,)), "not_finite"),
        (ForceCommand(0, 0, 0, 0, (1e300,)), "not_finite"),
        (ForceCommand(0, 0, 0, 0, (1.0, 2.0)), "wrong_length"),
        (ForceCommand(0, 0, 1, 1 * MS, (1.0,)), "from_the_future"),
        (ForceCommand(0, 0, 0, 7, (1.0,)), "wrong_echo"),
        (DeviceState(0, 0, 0.0, (0.0,), (0.0,), (0.0,)), "unexpected"),
    ],
)
def test_a_packet_that_is_not_acceptable_is_counted_and_gives_no_force(
    command: Packet, reason: str
) -> None:
    node, _ = device_node()
    node.engage()
    sample(node, 0)
    telemetry = write(node, 400_000, command)
    assert telemetry.applied_force == (0.0,)
    assert telemetry.rejected == {reason: 1}


def test_only_a_newer_command_replaces_the_one_in_use() -> None:
    node, _ = device_node()
    node.engage()
    old = sample(node, 0)
    write(node, 400_000)
    new = sample(node, 1 * MS)
    first = answer(new, (2.0,), seq=1)
    telemetry = write(node, 1_400_000, first, answer(old, (5.0,)), first, replace(first, seq=0))
    assert telemetry.applied_force == (2.0,)
    assert telemetry.rejected == {"not_newer": 3}


def test_a_restarted_controller_whose_sequence_begins_again_is_heard() -> None:
    node, _ = device_node()
    node.engage()
    write(node, 400_000, answer(sample(node, 0), (2.0,), seq=900))
    telemetry = write(node, 1_400_000, answer(sample(node, 1 * MS), (3.0,), seq=0))
    assert telemetry.applied_force == (3.0,)


def test_the_force_ends_at_the_age_limit_and_comes_back_through_the_ramp() -> None:
    node, _ = device_node(age_limit=0.003, engage_time=0.004)
    node.engage()
    forces = [tick(node, k * MS, (2.0,)).applied_force[0] for k in range(6)]
    assert forces == pytest.approx([0.0, 0.5, 1.0, 1.5, 2.0, 2.0])
    silent = [tick(node, k * MS) for k in range(6, 10)]
    assert [t.applied_force[0] for t in silent] == pytest.approx([2.0, 2.0, 0.0, 0.0])
    assert silent[-1].device_seq is None
    back = [tick(node, k * MS, (2.0,)).applied_force[0] for k in range(10, 13)]
    assert back == pytest.approx([0.0, 0.5, 1.0])


def test_an_answer_that_arrives_too_old_is_refused() -> None:
    node, _ = device_node(age_limit=0.003)
    node.engage()
    old = sample(node, 0)
    write(node, 400_000)
    sample(node, 4 * MS)
    assert write(node, 4_400_000, answer(old, (2.0,))).rejected == {"too_old": 1}
    for k in range(5, 5 + 4096):
        sample(node, k * MS)
        write(node, k * MS + 400_000)
    sample(node, 5000 * MS)
    assert write(node, 5000 * MS + 400_000, answer(old, (2.0,))).rejected == {"too_old": 2}


def test_the_bounder_is_last_and_certified_starts_with_no_more_than_friction() -> None:
    node, _ = device_node(law="certified")
    node.engage()
    tick(node, 0)
    telemetry = tick(node, 1 * MS, (5.0,))
    assert telemetry.commanded_force == (5.0,)
    assert 0.0 < telemetry.applied_force[0] <= 0.12


def test_stopping_writes_zero_at_once_and_for_ever() -> None:
    node, device = device_node()
    node.engage()
    tick(node, 0, (2.0,))
    node.stop(600_000)
    assert device.written[-1] == (600_000, (0.0,))
    assert tick(node, 1 * MS, (2.0,)).applied_force == (0.0,)


def test_a_reading_that_cannot_be_is_counted_and_told_once_a_second() -> None:
    node, device = device_node()
    node.engage()
    tick(node, 0, (2.0,))
    events = []
    for k in range(1, 1200):
        device.position = (math.nan,) if k % 2 else (0.0,)
        state = sample(node, k * MS)
        _, *told = node.step(k * MS + 400_000, [answer(state, (2.0,))])
        events += [event for event in told if isinstance(event, Event)]
    counts = [event.data["refused"] for event in events if event.event == "readings_refused"]
    assert counts == ["1", "501"]
    assert node.status().bounder.refused_readings == 600


@pytest.mark.parametrize(
    ("setting", "value"),
    [
        ("rate", 0.0),
        ("reply_wait", 1.0),
        ("hold_limit", 0.9),
        ("age_limit", 0.0),
        ("engage_time", -1.0),
        ("velocity_cutoff", 0.0),
    ],
)
def test_settings_without_meaning_are_refused(setting: str, value: Any) -> None:
    with pytest.raises(ValueError, match=f"{setting} must be"):
        ServoSettings(**{setting: value})


# Events


def test_a_device_whose_answers_come_near_the_age_limit_says_so_now_and_then() -> None:
    node, _ = device_node(age_limit=0.002)
    node.engage()
    events: list[Event] = []
    states: list[DeviceState] = []
    for _ in range(2000):
        assert node.wake_ns is not None
        received = [answer(states[-1], (1.0,), seq=len(states))] if len(states) % 5 == 1 else []
        for packet in node.step(node.wake_ns, received):
            if isinstance(packet, DeviceState):
                states.append(packet)
            elif isinstance(packet, Event):
                events.append(packet)
    kinds = [event.event for event in events]
    assert {"force_engages", "force_released"} <= set(kinds)
    assert 4 <= len(kinds) <= 6  # in a second, and not the 400 that there were
    apart = [b.time_ns - a.time_ns for a, b in pairwise(events)]
    assert min(apart) >= 200 * MS


def test_an_event_with_much_to_tell_fits_into_a_packet() -> None:
    log = EventLog("device")
    few = log.emit(0, "parameter_set", "", {"a": "1"})
    assert few.data == {"a": "1"}
    many = log.emit(0, "parameter_set", "x" * 5000, {f"name{i}": "y" * 300 for i in range(200)})
    assert decode(encode(many)) == many
    assert int(many.data["left_out"]) == 200 - (len(many.data) - 1)
