"""Leader and follower: forces, energy, scales, sensors, the clutch, two devices in one graph."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from forcebound.errors import ConfigError
from forcebound.graph.loader import load
from forcebound.graph.servo import ServoSettings, dissipation_of
from forcebound.haptics.controllers.direct import DirectController
from forcebound.haptics.devices.phantom import PhantomPremium15
from forcebound.haptics.environments import Environment, EnvironmentModel
from forcebound.haptics.environments.coupling import Coupling
from forcebound.haptics.hands import Operator
from forcebound.haptics.hands.hands import Press, PressingHand, StrokingHand
from forcebound.messages.packets import EnvironmentReply, Packet, Telemetry, Vector
from forcebound.messages.topology import graph_of
from forcebound.nodes.controller import ControllerNode
from forcebound.nodes.device import DeviceNode
from forcebound.nodes.environment import EnvironmentNode
from forcebound.run.simulation import Simulation

STILL = (0.0, 0.0)
LEADER, FOLLOWER = "leader", "follower"


def forces(
    coupled: Environment,
    leader: Vector,
    follower: Vector,
    speeds: Sequence[Vector] = (STILL, STILL),
    felt: Sequence[Vector | None] = (None, None),
    buttons: int | None = None,
) -> tuple[Vector, Vector]:
    """The answers to leader and follower once each knows where the other is."""
    answers = {}
    for hand, place, speed, sensed in (
        (LEADER, leader, speeds[0], felt[0]),
        (FOLLOWER, follower, speeds[1], felt[1]),
        (LEADER, leader, speeds[0], felt[0]),
    ):
        coupled.take_readings(hand, buttons if hand == LEADER else None, sensed)
        answers[hand] = coupled.force(hand, place, speed, 0.0)
    return answers[LEADER], answers[FOLLOWER]


def test_spring_and_damper_act_on_both() -> None:
    coupled = Coupling(stiffness=300.0, damping=2.0, offset=(0.001,)).open(2)
    leader, follower = forces(coupled, (0.01, 0.0), (0.005, 0.002), ((0.1, 0.0), STILL))
    # The follower is 6 mm behind on x, and the leader 0.1 m/s faster; it is 2 mm ahead on y.
    assert follower == pytest.approx((-300.0 * 0.006 - 0.2, 300.0 * 0.002))
    assert leader == pytest.approx(tuple(-one for one in follower))
    numbers = coupled.published.numbers
    assert numbers["position_error"] == pytest.approx(math.hypot(0.006, 0.002))
    assert "force_error" not in numbers


@pytest.mark.parametrize("scale", [0.5, -2.0])
def test_a_scaled_coupling_makes_no_power(scale: float) -> None:
    coupled = Coupling(stiffness=300.0, damping=0.0, scale=scale).open(1)
    stored = work = 0.0
    before = (0.0, 0.0)
    for step in range(20001):
        angle = 2.0 * math.pi * step / 20000
        now = (0.01 * math.sin(angle), 0.006 * math.sin(2.0 * angle) + 0.002 * math.sin(angle))
        (leader,), (follower,) = forces(coupled, now[:1], now[1:], ((0.0,), (0.0,)))
        work += leader * (now[0] - before[0]) + follower * (now[1] - before[1])
        stored, before = 0.5 * 300.0 * (scale * now[0] - now[1]) ** 2, now
        if step == 7000:
            assert work == pytest.approx(stored, rel=0.01)
            assert stored > 1e-3
    assert work == pytest.approx(0.0, abs=5e-4)  # of 40 mJ and more that come and go


def test_with_position_force_the_leader_feels_what_is_measured_at_the_follower() -> None:
    coupled = Coupling(architecture="position_force", stiffness=300.0, force_scale=2.0).open(2)
    # What the follower touches pushes it back, with 1.5 N along negative x.
    leader, follower = forces(coupled, (0.01, 0.0), (0.005, 0.0), felt=(None, (-1.5, 0.0)))
    assert leader == pytest.approx((3.0, 0.0))
    assert follower == pytest.approx((-1.5, 0.0))
    assert not coupled.published.events


def test_without_its_sensor_the_leader_feels_the_coupling_and_an_event_says_so_once() -> None:
    coupled = Coupling(architecture="position_force", stiffness=300.0).open(2)
    for _ in range(3):
        leader, _ = forces(coupled, (0.01, 0.0), (0.005, 0.0))
    assert leader == pytest.approx((1.5, 0.0))
    ((event, words, is_fault),) = coupled.published.events
    assert (event, is_fault) == ("no_force_sensor", True)
    assert words.startswith("follower ")


def test_four_channels_balance_at_rest_where_both_hands_feel_the_same() -> None:
    coupled = Coupling(architecture="four_channel", force_scale=3.0).open(1)
    # The hand pushes the leader with 6 N, the follower pushes what it touches with 2 N: positions
    # agree, so nothing moves if each motor holds against what acts on its tip.
    still = ((0.0,), (0.0,))
    (leader,), (follower,) = forces(coupled, (0.01,), (0.01,), still, felt=((6.0,), (-2.0,)))
    assert leader == pytest.approx(6.0)  # resists the hand
    assert follower == pytest.approx(-2.0)  # pushes on
    assert coupled.published.numbers["force_error"] == pytest.approx(0.0, abs=1e-12)


def test_four_channels_correct_a_force_that_differs() -> None:
    coupled = Coupling(architecture="four_channel", stiffness=0.0, damping=0.0).open(1)
    (leader,), (follower,) = forces(
        coupled, (0.0,), (0.0,), ((0.0,), (0.0,)), felt=((3.0,), (-1.0,))
    )
    assert (leader, follower) == (1.0, -3.0)  # each has the other's force
    assert coupled.published.numbers["force_error"] == pytest.approx(2.0)


def test_alone_a_hand_feels_nothing_and_nothing_again_when_the_other_has_left() -> None:
    coupled = Coupling().open(1)
    assert coupled.force(LEADER, (0.02,), (0.0,), 0.0) == (0.0,)
    assert coupled.scene() == ()
    coupled.force(FOLLOWER, (0.0,), (0.0,), 0.0)
    assert coupled.force(LEADER, (0.02,), (0.0,), 0.0)[0] > 0.0
    (line,) = list(coupled.scene() or ())
    assert (line.shape, line.points) == ("path", ((0.02, 0.0, 0.0), (0.0, 0.0, 0.0)))
    coupled.leave(FOLLOWER)
    assert coupled.force(LEADER, (0.02,), (0.0,), 0.0) == (0.0,)
    assert "position_error" not in coupled.published.numbers
    coupled.force(FOLLOWER, (0.01,), (0.0,), 0.0)
    assert coupled.force(LEADER, (0.02,), (0.0,), 0.0)[0] == pytest.approx(3.0)


def test_the_force_on_a_hand_grows_from_zero_when_its_partner_comes_back() -> None:
    coupled = Coupling(stiffness=300.0, damping=0.0).open(1)

    def on_leader(elapsed: float) -> float:
        return coupled.force(LEADER, (0.01,), (0.0,), elapsed)[0]

    coupled.force(FOLLOWER, (0.0,), (0.0,), 0.0)
    assert on_leader(0.001) == pytest.approx(3.0)  # begun together: the device's own ramp
    coupled.leave(FOLLOWER)
    assert on_leader(5.0) == 0.0
    coupled.force(FOLLOWER, (0.0,), (0.0,), 0.0)
    assert [on_leader(6.0 + late) for late in (0.0, 0.5, 1.0, 9.0)] == pytest.approx(
        [0.0, 1.5, 3.0, 3.0]
    )
    assert [(kind, is_fault) for kind, _, is_fault in coupled.published.events] == [
        ("coupled", False)
    ]


def test_another_hand_feels_nothing() -> None:
    coupled = Coupling().open(1)
    forces(coupled, (0.01,), (0.0,), ((0.0,), (0.0,)))
    assert coupled.force("third", (0.5,), (1.0,), 0.0) == (0.0,)


def test_the_clutch_releases_both_and_couples_them_again_where_they_are() -> None:
    coupled = Coupling(clutch=1, scale=2.0).open(2)
    up, down = 0b01, 0b10
    leader, _ = forces(coupled, (0.01, 0.0), (0.0, 0.0), buttons=up)
    assert leader[0] > 0.0
    released = forces(coupled, (-0.03, 0.01), (0.004, 0.0), buttons=down)
    assert released == (STILL, STILL)
    again = forces(coupled, (-0.03, 0.01), (0.004, 0.0), buttons=up)
    assert np.array(again) == pytest.approx(np.zeros((2, 2)))
    _, follower = forces(coupled, (-0.02, 0.01), (0.004, 0.0), buttons=up)
    assert follower == pytest.approx((-300.0 * 2.0 * 0.01, 0.0))


def test_changed_parameters_keep_the_coupling_without_a_jump() -> None:
    coupled = Coupling(stiffness=300.0).open(2)
    forces(coupled, (0.01, 0.0), (0.01, 0.0))
    assert coupled.change(Coupling(stiffness=500.0, scale=3.0))
    leader, follower = forces(coupled, (0.01, 0.0), (0.01, 0.0))
    assert np.array((leader, follower)) == pytest.approx(np.zeros((2, 2)))
    _, follower = forces(coupled, (0.011, 0.0), (0.01, 0.0))
    assert follower[0] == pytest.approx(-500.0 * 3.0 * 0.001)
    assert not coupled.change(Coupling(follower="other"))


@pytest.mark.parametrize(
    ("parameters", "field"),
    [
        ({"scale": 0.0}, "scale"),
        ({"scale": math.inf}, "scale"),
        ({"force_scale": 0.0}, "force_scale"),
        ({"force_scale": -1.0}, "force_scale"),
        ({"scale": -1.0, "force_scale": 1.0}, "force_scale"),
        ({"follower": "leader"}, "follower"),
        ({"stiffness": -1.0}, "stiffness"),
        ({"clutch": 63}, "clutch"),
    ],
)
def test_numbers_that_cannot_be_are_refused(parameters: dict[str, Any], field: str) -> None:
    with pytest.raises(ConfigError) as error:
        Coupling(**parameters)
    assert error.value.field == field


def test_an_offset_of_more_axes_than_there_are_is_refused() -> None:
    with pytest.raises(ConfigError) as error:
        Coupling(offset=(0.0, 0.1)).open(1)
    assert error.value.field == "offset"


# Two devices in one graph


def run(
    model: EnvironmentModel, hands: dict[str, Operator], seconds: float, law: str
) -> list[Packet]:
    """What two simulated devices of one axis and the environment sent."""
    packets: list[Packet] = []
    nodes: list[Any] = []
    servo = ServoSettings(law=law)
    for name, operator in hands.items():
        device = PhantomPremium15(force_sensor=True)
        opened = device.open(operator, servo.opening_hold)
        node = DeviceNode(opened, dissipation_of(device, servo), servo, hand=name)
        node.engage()
        nodes += [node, ControllerNode(DirectController(), hand=name)]
    nodes.append(EnvironmentNode(model))
    Simulation(nodes, {}, packets.append, graph=graph_of(tuple(hands))).run(round(seconds * 1e9))
    return packets


def last(packets: list[Packet], hand: str) -> Telemetry:
    return next(p for p in reversed(packets) if isinstance(p, Telemetry) and p.hand == hand)


GRIP: dict[str, Any] = {"mass": 0.2, "stiffness": 300.0, "damping": 5.0}


def test_a_follower_follows_the_leader_and_the_leader_feels_what_holds_the_follower() -> None:
    pushing = PressingHand(**GRIP, start=0.0, end=0.02)
    resting = PressingHand(**GRIP, start=0.0, end=0.0)
    packets = run(Coupling(stiffness=300.0), {LEADER: pushing, FOLLOWER: resting}, 3.0, "none")
    leader, follower = last(packets, LEADER), last(packets, FOLLOWER)
    assert leader.true_position is not None
    assert follower.true_position is not None
    # Three equal springs in series, over 20 mm: 2 N in each, but for friction (0.12 N each).
    assert leader.true_position[0] == pytest.approx(0.0133, abs=1e-3)
    assert follower.true_position[0] == pytest.approx(0.0067, abs=1e-3)
    assert leader.applied_force[0] == pytest.approx(-follower.applied_force[0], abs=0.05)
    assert leader.applied_force[0] == pytest.approx(2.0, abs=0.25)
    numbers = next(p.signals for p in reversed(packets) if isinstance(p, EnvironmentReply))
    assert isinstance(numbers, dict)
    assert numbers["position_error"] == pytest.approx(0.0067, abs=1e-3)
    assert numbers["force_error"] < 0.5  # N: what friction takes on the way


def stroked(architecture: Any, law: str) -> dict[str, list[Telemetry]]:
    """A run in which the leader strokes, and presses its clutch from 1 s to 1.5 s."""
    presses = (Press(button=0, start=1.0, end=1.5),)
    stroking = StrokingHand(
        **GRIP, start=0.0, end=0.01, stroke=(0.01,), frequency=1.0, presses=presses
    )
    resting = PressingHand(**GRIP, start=0.0, end=0.0)
    model = Coupling(architecture=architecture, clutch=0, stiffness=400.0)
    packets = run(model, {LEADER: stroking, FOLLOWER: resting}, 2.0, law)
    telemetry = [packet for packet in packets if isinstance(packet, Telemetry)]
    return {hand: [p for p in telemetry if p.hand == hand] for hand in (LEADER, FOLLOWER)}


@pytest.mark.parametrize("architecture", ["position_position", "position_force", "four_channel"])
def test_no_hand_gets_energy_whatever_the_architecture(architecture: Any) -> None:
    ticks = stroked(architecture, "certified")
    for hand, pushes in ticks.items():
        assert min(p.true_energy for p in pushes if p.true_energy is not None) > -1e-6, hand
    asked = max(abs(p.commanded_force[0]) for p in ticks[FOLLOWER])
    assert asked > 2.0  # to push its hand, which the law does not let it
    assert max(abs(p.applied_force[0]) for p in ticks[FOLLOWER]) < 0.5 * asked


def test_the_clutch_ends_the_force_on_both_and_then_they_are_coupled_again() -> None:
    for pushes in stroked("position_position", "none").values():
        released = [p for p in pushes if 1.01 < p.elapsed < 1.49]
        assert all(p.commanded_force == (0.0,) for p in released)
        for coupled in ([p for p in pushes if p.elapsed <= 1.0], pushes[-400:]):
            assert max(abs(p.applied_force[0]) for p in coupled) > 0.5


@pytest.mark.parametrize(
    ("world", "line"),
    [
        ("{kind: coupling, leader: lft, follower: right}", "no hand 'lft'"),
        ("{kind: wall, fixtures: {hands: {midle: {}}}}", "no hand 'midle'"),
    ],
)
def test_a_hand_that_is_not_there_is_an_error_at_its_place(
    tmp_path: Path, world: str, line: str
) -> None:
    hands = "{left: {include: stiff_wall.yaml}, right: {include: stiff_wall.yaml}}"
    file = tmp_path / "two.yaml"
    text = f"forcebound: 1\nseed: 1\nduration: 1 s\nhands: {hands}\nenvironment: {world}\n"
    file.write_text(text)
    with pytest.raises(ConfigError, match=rf"two.yaml:5:\d+.*{line}"):
        load(file)
