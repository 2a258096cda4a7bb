"""Late ticks on purpose, the hold limit learned from late ticks, and the warning about them."""

from itertools import pairwise
from pathlib import Path

import pytest
from builders import MS
from fakes import DISSIPATION, press
from hypothesis import given
from hypothesis import strategies as st

from forcebound.errors import ConfigError
from forcebound.graph.loader import load
from forcebound.graph.servo import ServoSettings
from forcebound.haptics.laws.dissipation import Watchdog
from forcebound.haptics.laws.hold_limit import FLOOR, LADDER, PRICES, HoldLimit
from forcebound.messages.packets import Packet, Telemetry
from forcebound.nodes.device import DeviceNode
from forcebound.nodes.device_events import Overload
from forcebound.run.simulation import LateTicks
from forcebound.testing import Handle, OpenHandle

WATCHDOGS = sorted(PRICES)


def write_times(packets: list[Packet]) -> list[int]:
    return [packet.time_ns for packet in packets if isinstance(packet, Telemetry)]


def run(law: str, late_ticks: LateTicks) -> list[Packet]:
    return press(law, 1.0, servo=ServoSettings(reply_wait=0.4), late_ticks=late_ticks)


# Late ticks on purpose


def test_late_ticks_come_as_often_and_as_late_as_they_are_set() -> None:
    times = write_times(run("none", LateTicks(rate=40.0, shortest=0.3e-3, longest=0.5e-3)))
    lateness = [(time_ns - 400_000) % MS for time_ns in times]
    late = [late for late in lateness if late > 0]
    assert 20 <= len(late) <= 60
    assert all(300_000 <= late <= 500_000 for late in late)


def test_jitter_makes_a_write_early_or_late_by_no_more_than_it_is_set() -> None:
    times = write_times(run("none", LateTicks(jitter=20e-6)))
    lateness = [time_ns - 400_000 - k * MS for k, time_ns in enumerate(times)]
    assert all(-20_000 <= late <= 20_000 for late in lateness)
    assert min(lateness) < -10_000
    assert max(lateness) > 10_000


def test_late_ticks_do_not_depend_on_the_law_but_on_the_seed() -> None:
    settings = LateTicks(rate=40.0, jitter=20e-6)
    times = write_times(run("none", settings))
    assert times == write_times(run("certified", settings))
    assert times != write_times(run("none", LateTicks(rate=40.0, jitter=20e-6, seed=2)))


@given(
    rate=st.floats(0.0, 1000.0),
    longest=st.floats(0.0, 8e-3),
    jitter=st.floats(0.0, 1e-3),
    reply_wait=st.floats(0.0, 0.99),
)
def test_time_never_goes_backwards_and_no_two_writes_are_at_once(
    rate: float, longest: float, jitter: float, reply_wait: float
) -> None:
    late_ticks = LateTicks(rate=rate, shortest=0.0, longest=longest, jitter=jitter)
    servo = ServoSettings(reply_wait=reply_wait)
    packets = press("certified", 0.05, servo=servo, late_ticks=late_ticks)
    assert all(before < now for before, now in pairwise(write_times(packets)))
    times = [packet.time_ns for packet in packets]
    assert times == sorted(times)
    ticks = [packet.seq for packet in packets if isinstance(packet, Telemetry)]
    assert all(before < now for before, now in pairwise(ticks))


class Exchanging(OpenHandle):
    """A device whose writes bring a reading."""

    is_exchange = True


@pytest.mark.parametrize(
    ("late_ns", "written_ns"), [(0, 1_800_000), (450_000, 1_800_000), (700_000, 2_000_000)]
)
def test_a_state_that_a_slow_exchange_made_late_has_time_for_its_answer(
    late_ns: int, written_ns: int
) -> None:
    node = DeviceNode(Exchanging(Handle()), DISSIPATION, ServoSettings(law="none", reply_wait=0.8))
    node.step(0, [])
    node.step(800_000, [])
    node.step(MS + late_ns, [])
    assert node.wake_ns == written_ns


def test_skipped_ticks_are_counted() -> None:
    packets = run("none", LateTicks(rate=20.0, shortest=2e-3, longest=4e-3))
    last = [packet for packet in packets if isinstance(packet, Telemetry)][-1]
    ticks = sum(isinstance(packet, Telemetry) for packet in packets)
    assert last.deadline_misses > 0
    assert ticks + last.deadline_misses == last.seq + 1


# Without a watchdog


def test_without_a_watchdog_a_launch_file_must_bound_the_hold(tmp_path: Path) -> None:
    file = tmp_path / "unbounded.yaml"
    text = "forcebound: 1\ninclude: stiff_wall.yaml\ndevice: {kind: phantom_premium_1_5, "
    file.write_text(text + "watchdog: none}\n")
    with pytest.raises(ConfigError, match=r"needs a watchdog_limit .* finite, got inf s: state"):
        load(str(file))
    file.write_text(text + "watchdog: none, watchdog_limit: 10 ms, allowance: 20 mJ}\n")
    assert load(str(file)).only.servo.allowance == pytest.approx(0.02)


def test_a_watchdog_that_may_cut_every_hold_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "early.yaml"
    text = "forcebound: 1\ninclude: stiff_wall.yaml\n"
    early = "device: {watchdog: silent, watchdog_tolerance: 20 %, hold_limit: "
    file.write_text(f"{text}{early}1.2}}\n")
    with pytest.raises(ConfigError, match=r"hold_limit of at least 1\.25 periods, or auto"):
        load(str(file))
    for enough in ("1.25", "auto"):
        file.write_text(f"{text}{early}{enough}}}\n")
        assert load(str(file)).only.servo.hold_limit in (1.25, "auto")


# The hold limit


@pytest.mark.parametrize("watchdog", WATCHDOGS)
def test_a_punctual_servo_has_the_shortest_limit(watchdog: Watchdog) -> None:
    limit = HoldLimit(MS, watchdog)
    assert not any(limit.observe(MS + late) for late in (0, 10_000, -10_000, 20_000) * 500)
    assert limit.limit_ns == round(FLOOR * MS)


def test_with_a_silent_watchdog_an_overrun_lengthens_the_limit_at_once() -> None:
    limit = HoldLimit(MS, "silent")
    assert limit.observe(1_300_000)
    assert limit.limit_ns >= 1_300_000


def test_with_a_reporting_watchdog_one_overrun_changes_nothing_but_many_do() -> None:
    limit = HoldLimit(MS, "reporting")
    assert not limit.observe(3 * MS)
    for _ in range(10):
        limit.observe(1_045_000)
    assert round(FLOOR * MS) < limit.limit_ns < 3 * MS


@pytest.mark.parametrize("watchdog", WATCHDOGS)
def test_old_lateness_is_forgotten(watchdog: Watchdog) -> None:
    limit = HoldLimit(MS, watchdog)
    for _ in range(300):
        limit.observe(4 * MS)
    longest = limit.limit_ns
    for _ in range(200_000):
        limit.observe(MS)
    assert limit.limit_ns == round(FLOOR * MS)
    assert longest > limit.limit_ns or watchdog in ("guarding", "none")


@given(
    intervals=st.lists(st.integers(1, 50 * MS), max_size=400),
    watchdog=st.sampled_from(WATCHDOGS),
)
def test_the_limit_is_always_one_of_the_ladder(intervals: list[int], watchdog: Watchdog) -> None:
    limit = HoldLimit(MS, watchdog)
    for interval in intervals:
        before = limit.limit_ns
        assert limit.observe(interval) == (limit.limit_ns != before)
        assert limit.limit_ns in [round(ratio * MS) for ratio in LADDER]


# The warning


def test_many_missed_ticks_in_a_second_are_a_warning_and_not_each_second_again() -> None:
    overload = Overload(MS)
    warnings = [overload.observe(second * 1000 * MS, 100 * second) for second in range(13)]
    assert [k for k, warning in enumerate(warnings) if warning] == [1, 11]
    assert "missed 100 of 1000 ticks in the last second" in str(warnings[1])


def test_few_missed_ticks_and_those_before_the_first_look_are_no_warning() -> None:
    overload = Overload(MS)
    assert not any(overload.observe(k * MS, 5000 + k // 20) for k in range(20_000))
