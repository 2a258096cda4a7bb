"""A hand that follows a pointer: its target, on a device, and the requests for it."""

import math
from pathlib import Path
from typing import Any

import pytest
from addresses import control_endpoint
from builders import MS
from waiting import until

from forcebound.graph.loader import load
from forcebound.haptics.devices.phantom import PhantomPremium15
from forcebound.haptics.hands.pointer import PointerHand
from forcebound.messages.control import Point, Pointed, Refused
from forcebound.network.sockets import Network
from forcebound.nodes.device import DeviceNode
from forcebound.run.build import build_device
from forcebound.run.process.runner import Runner
from forcebound.units import energy_in_words

HAND = PointerHand(start=(0.01, -0.01), reach=0.05, smoothing=0.01, speed=0.5)


def test_target_rests_until_somebody_points_and_then_goes_there() -> None:
    target = HAND.follow(3)
    assert target.advance(1.0) == (0.01, -0.01, 0.0)
    target.point((0.02,))
    for _ in range(200):
        place = target.advance(0.001)
    assert place == pytest.approx((0.02, -0.01, 0.0), abs=1e-9)


def test_target_is_no_faster_than_its_speed_and_stays_within_reach() -> None:
    target = HAND.follow(2)
    assert target.point((5.0, -5.0)) == pytest.approx((0.06, -0.06))
    before = target.advance(1e-9)
    for _ in range(300):
        after = target.advance(0.001)
        assert math.dist(before, after) <= 0.0005 * (1 + 1e-9)
        before = after
    assert before == pytest.approx((0.06, -0.06), abs=1e-6)


def node(*words: str) -> DeviceNode:
    made = build_device(load("pointer_wall", words).only)
    made.engage()
    return made


def run(device: DeviceNode, start_ns: int, ticks: int) -> list[Any]:
    packets: list[Any] = []
    for tick in range(ticks):
        for part_ns in (0, 400_000):
            packets += device.step(start_ns + tick * MS + part_ns, [])
    return packets


def test_device_follows_the_pointer_that_a_request_moves() -> None:
    device = node()
    assert device.handle(Point((0.005,))) == Pointed((0.005,), 0)
    last = run(device, 0, 1500)[-1]
    assert last.true_position[0] == pytest.approx(0.005, abs=4e-4)  # 0.12 N over 400 N/m


def test_a_dragged_device_answers_after_each_write_and_says_from_when_on_it_follows(
    network: Network, run_dir: Path
) -> None:
    device = node()
    servo = Runner(device, "device", run_dir, {}, network)
    client = network.control_client(control_endpoint(run_dir, "device"))
    servo.turn(0)

    def is_answered(time_ns: int) -> bool:
        servo.turn(time_ns)
        return client.pending()

    device.handle(Point((0.001,)))
    assert not device.awaits_requests  # the write comes first
    servo.turn(400_000)
    assert device.awaits_requests
    until(lambda: client.ask(Point((0.002,))), "a connection")
    until(lambda: is_answered(400_001), "an answer in the same tick")
    assert client.answer() == Pointed((0.002,), MS)  # the next read


def test_a_device_that_nobody_drags_looks_for_requests_rarely() -> None:
    device = node()
    run(device, 0, 1)
    assert not device.awaits_requests


@pytest.mark.parametrize("target", [(0.0, 0.0), (math.nan,)])
def test_a_pointer_that_is_no_place_is_refused(target: tuple[float, ...]) -> None:
    answer = node().handle(Point(target))
    assert isinstance(answer, Refused)
    assert "target" in answer.error


def test_a_hand_that_follows_no_pointer_says_so() -> None:
    device = build_device(load("stiff_wall").only)
    answer = device.handle(Point((0.0,)))
    assert isinstance(answer, Refused)
    assert "operator" in answer.error
    assert PhantomPremium15().open(None, 0.001).point((0.0,)) is None


def test_law_changes_at_zero_force_and_begins_a_new_ledger() -> None:
    device = node("law:=certified")
    before = run(device, 0, 50)
    device.set("none")
    after = run(device, 50 * MS, 50)
    [event] = [p for p in after if getattr(p, "event", "") == "law_changed"]
    assert event.data["law"] == "none"
    assert before[-1].estimated_energy != 0.0
    at = after.index(event)
    assert not any(after[at - 1].applied_force)
    given = after[at - 1].true_energy
    assert event.message.endswith(f"under certified the hand has put in {energy_in_words(given)}")
    assert float(event.data["energy_before"]) == device.status().energy_before
