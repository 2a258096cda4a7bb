"""Scaling of way and force, the clutch, and the border of the workspace."""

import math
from itertools import pairwise

import pytest
from builders import MS, reply, state
from msgspec import structs

from forcebound.errors import ConfigError
from forcebound.graph.loader import load
from forcebound.graph.parts import member_of
from forcebound.haptics.controllers.plane import dot
from forcebound.haptics.controllers.scaled import OpenScaled, Scaled
from forcebound.haptics.hands.hands import Press, StrokingHand
from forcebound.messages.packets import Event
from forcebound.nodes.controller import ControllerNode
from forcebound.run.virtual import run_virtual

DOWN, UP = 0b100, 0


def go(opened: OpenScaled, tick: int, position: float, buttons: int | None = None) -> float:
    """The point of the environment that is asked about."""
    now = state(tick, position, buttons=buttons)
    opened.on_state(now, tick * MS)
    (point,), _ = opened.query(now)
    return point


@pytest.mark.parametrize("scale", [0.1, 1.0, 5.0])
def test_the_power_at_the_hand_is_that_in_the_environment(scale: float) -> None:
    opened = Scaled(motion_scale=scale).open(2)
    for tick in range(20):
        now = state(tick, 0.001 * tick, -0.002 * tick, velocity=0.1)
        opened.on_state(now, tick * MS)
        _, velocity = opened.query(now)
        force = opened.on_reply(reply(tick, 3.0, 2.0), tick * MS)
        assert dot(force, now.velocity) == pytest.approx(dot((3.0, 2.0), velocity))


def test_a_wall_feels_as_stiff_as_both_scales_say() -> None:
    config = load("stiff_wall", ["law:=none", "stiffness:=1 N/mm"])
    controller = Scaled(motion_scale=2.0, force_scale=0.25)
    columns = run_virtual(config.with_hand(controller=controller), 2.0).columns
    depth = columns.position[-1, 0] - 0.005  # the surface at 10 mm is 5 mm away
    assert columns.applied_force[-1, 0] == pytest.approx(2.0 * 0.25 * 1000.0 * depth, rel=0.01)


def test_more_force_than_the_power_allows_is_cautioned() -> None:
    assert not Scaled(motion_scale=2.0, force_scale=1.0).cautions(0.27, 1e-3, 0.0)
    (sentence,) = Scaled(motion_scale=0.5, force_scale=1.0).cautions(0.27, 1e-3, 0.0)
    assert "2 times the power" in sentence


@pytest.mark.parametrize("name", ["motion_scale", "force_scale"])
def test_a_scale_of_zero_is_refused(name: str) -> None:
    with pytest.raises(ConfigError, match=f"{name}: must be > 0, with 1 as it is, got 0"):
        member_of("controller", "scaled", [f"{name}:=0"])


def test_the_clutch_lets_the_hand_move_back_and_the_point_goes_on_without_a_jump() -> None:
    opened = Scaled(motion_scale=2.0, clutch_button=2).open(1)
    points = [go(opened, tick, 0.001 * tick, UP) for tick in range(10)]
    points += [go(opened, 10 + tick, 0.009 - 0.002 * tick, DOWN) for tick in range(10)]
    points += [go(opened, 20 + tick, -0.009 + 0.001 * tick, UP) for tick in range(10)]
    assert max(abs(b - a) for a, b in pairwise(points)) < 0.0021
    assert len(set(points[10:20])) == 1
    assert points[-1] == pytest.approx(points[19] + 2.0 * 0.009)


def test_there_is_no_force_while_the_clutch_is_down_and_a_ramp_after_it() -> None:
    opened = Scaled(clutch_button=2, engage_time=0.1).open(1)
    forces = []
    for tick in range(400):
        go(opened, tick, 0.0, DOWN if 100 <= tick < 200 else UP)
        forces.append(opened.on_reply(reply(tick, 4.0), tick * MS)[0])
    assert forces[99] == 4.0
    assert set(forces[100:200]) == {0.0}
    assert forces[250] == pytest.approx(2.0)
    assert max(b - a for a, b in pairwise(forces[200:])) < 0.05
    assert forces[-1] == 4.0


def test_the_point_stays_when_the_device_counts_its_ticks_from_0_again() -> None:
    opened = Scaled(motion_scale=2.0).open(1)
    before = [go(opened, tick, 0.001 * tick) for tick in range(10)][-1]
    again = structs.replace(state(0, -0.03), time_ns=10_000 * MS)
    opened.on_state(again, 10_000 * MS)
    assert opened.query(again)[0] == (before,)


def test_beyond_the_border_the_point_drifts_and_a_spring_says_so() -> None:
    model = Scaled(motion_scale=2.0, border=0.05, border_rate=5.0, border_stiffness=100.0)
    opened = model.open(2)
    place = (0.06 * math.cos(0.3), 0.06 * math.sin(0.3))  # 10 mm beyond it
    points = []
    for tick in range(1001):
        now = state(tick, *place)
        opened.on_state(now, tick * MS)
        points.append(opened.query(now)[0])
    assert math.dist(points[-1], points[0]) == pytest.approx(2.0 * 5.0 * 0.01 * 1.0)
    assert math.hypot(*opened.on_reply(reply(1000, 0.0, 0.0), 0)) == pytest.approx(1.0)
    within = model.open(1)
    assert {go(within, tick, 0.049) for tick in range(100)} == {2.0 * 0.049}
    assert within.on_reply(reply(99, 0.0), 0) == (0.0,)


def notices(buttons: list[int | None]) -> list[str]:
    """The notices of a clutch on button 2, a state each second."""
    node = ControllerNode(Scaled(clutch_button=2).open(1))
    sent = []
    for second, down in enumerate(buttons):
        sent += node.step(second * 1000 * MS, [state(second * 1000, 0.0, buttons=down)])
    return [packet.message for packet in sent if isinstance(packet, Event)]


def test_a_hand_that_holds_the_clutch_feels_nothing_until_it_lets_go() -> None:
    config = load("stiff_wall", ["law:=none", "stiffness:=1 N/mm"])
    presses = (Press(start=0.0, end=0.01), Press(start=0.5, end=1.0))
    hand = StrokingHand(stroke=0.0, presses=presses)
    coupled = config.with_hand(operator=hand, controller=Scaled(clutch_button=0))
    result = run_virtual(coupled, 1.5)
    columns, force = result.columns, result.columns.applied_force[:, 0]
    assert set(force[(columns.elapsed > 0.51) & (columns.elapsed < 1.0)]) == {0.0}
    assert force[(columns.elapsed > 0.4) & (columns.elapsed < 0.5)].min() > 1.0
    assert "clutch_down" in [event.event for event in result.events]


@pytest.mark.parametrize(
    ("buttons", "words"),
    [
        ([None, None], "the device has no buttons, so clutch_button: 2 never acts"),
        ([DOWN, DOWN, UP], "the clutch (button 2) is down at the start"),
        ([UP, DOWN, UP], ""),
    ],
)
def test_a_clutch_that_cannot_be_meant_is_reported(buttons: list[int | None], words: str) -> None:
    messages = notices(buttons)
    assert len(messages) == bool(words)
    assert "".join(messages).startswith(words)
