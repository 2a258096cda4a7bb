"""Several hands in one environment: in the node, in worlds of one's own, and in worlds to share."""

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
from builders import MS, query
from msgspec.structs import replace
from test_environments import model_of

from forcebound.errors import ConfigError
from forcebound.haptics.environments import (
    ENVIRONMENTS,
    Environment,
    EnvironmentModel,
    SharedClock,
    open_environment,
)
from forcebound.haptics.environments.bodies import Bodies
from forcebound.haptics.environments.fixtures import (
    Fixtures,
    HandFixtures,
    WithFixtures,
    WorkspaceLimit,
)
from forcebound.haptics.environments.mass_spring import MassSpring
from forcebound.haptics.environments.membrane import Membrane
from forcebound.haptics.environments.strokes import strokes
from forcebound.haptics.environments.walls import Wall
from forcebound.messages.packets import (
    Contact,
    EnvironmentReply,
    Event,
    Packet,
    Scene,
    SceneObject,
    Vector,
)
from forcebound.nodes.environment import EnvironmentNode

# A hand feels what others do; the cup is held by one hand alone.
SHARED = {"mass_spring", "bodies", "membrane", "coupling", "cart_pendulum"}


class Noted(Environment):
    def __init__(self) -> None:
        self.calls: list[tuple[Any, ...]] = []

    def take_readings(self, user: str, buttons: int | None, measured_force: Vector | None) -> None:
        self.calls.append(("readings", user, buttons, measured_force))

    def force(self, user: str, position: Vector, velocity: Vector, elapsed: float) -> Vector:
        self.calls.append(("force", user))
        return position

    def contact(self, user: str) -> Contact:
        return Contact((0.0,), (-1.0,))

    def scene(self) -> tuple[SceneObject, ...]:
        return (SceneObject("thing", "box"),)

    def leave(self, user: str) -> None:
        self.calls.append(("leave", user))


@dataclass(frozen=True)
class Noting(EnvironmentModel):
    """An environment that notes what it is asked."""

    opened: Noted = field(default_factory=Noted)

    def open(self, axes: int) -> Noted:
        return self.opened


def noting() -> tuple[EnvironmentNode, list[tuple[Any, ...]]]:
    model = Noting()
    return EnvironmentNode(model, name="one"), model.opened.calls


def asked(seq: int, hand: str, **fields: Any) -> Any:
    return replace(query(seq), hand=hand, **fields)


def replies(packets: list[Packet]) -> list[str]:
    return [packet.hand for packet in packets if isinstance(packet, EnvironmentReply)]


def test_a_hand_whose_controller_has_another_environment_does_not_hinder_the_others() -> None:
    node = EnvironmentNode(Wall(), name="one")
    answered, events = [], []
    for tick in range(1500):
        mine = asked(tick, "left", environment="one")
        others = asked(tick, "right", environment="two")
        packets = node.step(tick * MS, [mine, others])
        answered += replies(packets)
        events += [packet for packet in packets if isinstance(packet, Event)]
    assert answered.count("left") == 1500
    assert answered.count("right") == 2  # once a second
    assert [(each.event, each.data["hand"]) for each in events] == [
        ("serving", "left"),
        ("environment_refused", "right"),
    ]
    assert node.status().refused_for == "two"


def test_readings_come_right_before_the_force_of_the_same_hand() -> None:
    node, calls = noting()
    felt = asked(0, "left", buttons=4, measured_force=(-1.5,))
    node.step(0, [felt, asked(0, "right")])
    assert calls == [
        ("readings", "left", 4, (-1.5,)),
        ("force", "left"),
        ("readings", "right", None, None),
        ("force", "right"),
    ]


def test_a_measured_force_that_is_not_finite_is_not_answered() -> None:
    node, calls = noting()
    assert node.step(0, [asked(0, "left", measured_force=(math.nan,))]) == []
    assert node.status().rejected == {"not_finite": 1}
    assert calls == []


def test_a_hand_whose_queries_end_leaves_once_and_takes_part_again() -> None:
    node, calls = noting()
    scenes = []
    for tick in range(400):
        hands = ["left"] if 100 <= tick < 300 else ["left", "right"]
        packets = node.step(tick * MS, [asked(tick, hand) for hand in hands])
        if node.wake_ns is not None:
            packets += node.step(tick * MS, [])
        scenes += [(tick, set(each.proxies)) for each in packets if isinstance(each, Scene)]
    assert [call for call in calls if call[0] == "leave"] == [("leave", "right")]
    before = calls.index(("leave", "right"))
    # 0.1 s after its last query, at tick 99: 200 answers in the first 100 ticks, then one each.
    assert sum(call[0] == "force" for call in calls[:before]) == 200 + 100
    during = [proxies for tick, proxies in scenes if 200 <= tick < 300]
    assert during
    assert all(proxies == {"left"} for proxies in during)
    assert scenes[-1][0] >= 300
    assert scenes[-1][1] == {"left", "right"}


def test_one_hand_alone_never_leaves_however_long_it_is_silent() -> None:
    node, calls = noting()
    for second in (0, 1, 50):
        node.step(second * 1000 * MS, [asked(second, "")])
    assert [call[0] for call in calls] == ["readings", "force"] * 3


class Unleavable(Noted):
    def leave(self, user: str) -> None:
        raise RuntimeError("stuck")


@dataclass(frozen=True)
class Sticky(EnvironmentModel):
    def open(self, axes: int) -> Environment:
        return Unleavable()


def test_code_that_fails_when_a_hand_leaves_is_counted_and_the_others_are_answered() -> None:
    node = EnvironmentNode(Sticky(), name="one")
    node.step(0, [asked(0, "left"), asked(0, "right")])
    packets = node.step(200 * MS, [asked(200, "right")])
    assert replies(packets) == ["right"]
    (event,) = (packet for packet in packets if isinstance(packet, Event))
    assert event.event == "environment_failed"
    assert "stuck" in event.message
    assert node.faults == 1


# Worlds


@pytest.mark.parametrize("name", sorted(ENVIRONMENTS.keys() - SHARED))
def test_a_hand_feels_the_same_whether_or_not_another_one_touches_elsewhere(
    name: str, tmp_path: Path
) -> None:
    model = model_of(name, tmp_path)
    alone, both = open_environment(model, 3), open_environment(model, 3)
    objects = tuple(alone.scene() or ()) or (SceneObject("thing", "sphere", size=(0.02,)),)
    mine, others = strokes(objects, 3, 8), strokes(tuple(reversed(objects)), 3, 8)
    touched = 0
    for one, other in zip(mine, others, strict=True):
        for question, elsewhere in zip(one, reversed(other), strict=True):
            both.force("b", *elsewhere)
            answer = both.force("a", *question)
            assert answer == alone.force("a", *question)
            assert both.contact("a") == alone.contact("a")
            touched += any(answer)
            both.force("b", *elsewhere)
            assert both.contact("a") == alone.contact("a")
    assert touched or name == "recorded"


def test_a_membrane_that_one_hand_breaks_is_broken_for_all() -> None:
    skin = Membrane(stiffness=500.0, strength=2.0, skin=0.0).open(1)
    assert skin.force("a", (0.003,), (0.0,), 0.0) == (1.5,)
    skin.force("b", (0.005,), (0.0,), 0.0)
    assert skin.force("a", (0.003,), (0.0,), 0.0) == (0.0,)


# The time of a shared world


def test_the_time_of_a_world_is_that_of_the_fastest_and_goes_on_without_it() -> None:
    clock = SharedClock()
    assert clock.at("a", 5.0) == 0.0
    assert clock.at("b", 1.0) == 0.0  # its force engaged later
    assert clock.at("a", 5.5) == 0.5
    assert clock.at("b", 1.25) == 0.5
    assert clock.at("b", 2.0) == 1.0
    clock.leave("a")
    assert clock.at("b", 3.0) == 2.0
    assert clock.at("a", 9.0) == 2.0  # back, with a clock that went on without it
    assert clock.at("a", 9.5) == 2.5
    assert clock.at("a", 0.0) == 2.5  # its device was lost, and begins again
    assert clock.at("a", 0.5) == 3.0


class Aged(Environment):
    """A world that notes the time of its queries, by each hand's clock and by that of all."""

    def __init__(self) -> None:
        self.clock, self.times, self.elapsed = SharedClock(), [0.0], list[tuple[str, float]]()

    def force(self, user: str, position: Vector, velocity: Vector, elapsed: float) -> Vector:
        self.times.append(self.clock.at(user, elapsed))
        self.elapsed.append((user, elapsed))
        return position

    def leave(self, user: str) -> None:
        self.clock.leave(user)


@dataclass(frozen=True)
class Ageing(EnvironmentModel):
    opened: Aged = field(default_factory=Aged)

    def open(self, axes: int) -> Aged:
        return self.opened


def honest(tick: int) -> float:
    """The time of a hand whose packets are late by half a second at first, in s."""
    return (tick if tick >= 1000 else max(tick - 500, 0)) * 1e-3


CLOCKS: dict[str, Callable[[int], float]] = {
    "jumps to 1e308 s": lambda tick: 1e308 if tick >= 100 else tick * 1e-3,
    "jumps to 1e18 s and goes on": lambda tick: 1e18 + 128.0 * tick if tick >= 100 else 0.0,
    "100 times too fast": lambda tick: tick * 0.1,
    "forth and back": lambda tick: 0.9 * (tick % 2),
    "1e308 s from the beginning": lambda tick: 1e308,
}


@pytest.mark.parametrize("name", CLOCKS)
def test_no_hand_moves_a_world_faster_than_the_clock_of_its_environment(name: str) -> None:
    model = Ageing()
    node = EnvironmentNode(model, name="one")
    for tick in range(3000):
        theirs = asked(tick, "theirs", elapsed=CLOCKS[name](tick))
        packets = node.step(tick * MS, [asked(tick, "mine", elapsed=honest(tick)), theirs])
        assert replies(packets) == ["mine", "theirs"]
    times = model.opened.times
    assert all(before <= now for before, now in itertools.pairwise(times))
    assert 2.4 < times[-1] <= 3.0 * 1.01 + 1.0  # our clock, and a second at most
    mine = [elapsed for user, elapsed in model.opened.elapsed if user == "mine"]
    assert mine == [honest(tick) for tick in range(3000)]  # to the bit


def test_a_hand_whose_time_jumped_takes_part_with_its_clock_from_then_on() -> None:
    model = Ageing()
    node = EnvironmentNode(model, name="one")
    for tick in range(2000):
        elapsed = tick * 1e-3 + (3600.0 if tick >= 500 else 0.0)
        node.step(tick * MS, [asked(tick, "", elapsed=elapsed)])
    steps = [now - before for before, now in itertools.pairwise(model.opened.times[502:])]
    assert len(steps) == 1499 - 1
    assert steps == pytest.approx([1e-3] * len(steps), abs=1e-9)


class Broken(Noted):
    def force(self, user: str, position: Vector, velocity: Vector, elapsed: float) -> Vector:
        return (math.nan,) if elapsed >= 1.0 else position


@dataclass(frozen=True)
class Breaking(EnvironmentModel):
    """A world that is broken once its time is 1 s; its first instances are."""

    opened: list[Environment] = field(default_factory=list)
    broken: int = 1

    def open(self, axes: int) -> Environment:
        self.opened.append(Broken() if len(self.opened) < self.broken else Noted())
        return self.opened[-1]


@pytest.mark.parametrize(("broken", "expected"), [(1, 2), (9, 2)])
def test_a_world_that_fails_after_it_has_answered_is_opened_once_again(
    broken: int, expected: int
) -> None:
    model = Breaking(broken=broken)
    node = EnvironmentNode(model, name="one")
    packets: list[Packet] = []
    for tick in range(2000):
        packets += node.step(tick * MS, [asked(tick, "", elapsed=tick * 1e-3)])
    assert len(model.opened) == expected  # one that never answers is not opened over and over
    failures = [each for each in packets if isinstance(each, Event) and each.is_fault]
    assert ["opened again" in each.message for each in failures] == [False, True]
    assert len(replies(packets)) == (1899 if broken == 1 else 1000)


def slab_period(users: tuple[str, ...]) -> float:
    """The period of a free slab, in s, which so many hands look at from afar."""
    slab = MassSpring(mass=0.2, spring=300.0, damping=0.0).open(1)
    faces = []
    for tick in range(2000):
        place = 0.02 if tick < 20 else -0.1
        for user in users:
            slab.force(user, (place,), (0.0,), tick * 1e-3)
        faces.append(next(iter(slab.scene() or ())).position[0])
    rises = [i for i in range(21, 2000) if faces[i - 1] < 0.015 <= faces[i]]
    return (rises[-1] - rises[0]) / (len(rises) - 1) * 1e-3


def test_two_hands_do_not_make_a_slab_swing_faster() -> None:
    expected = 2.0 * math.pi * math.sqrt(0.2 / 300.0)
    assert slab_period(("a",)) == pytest.approx(expected, rel=0.01)
    assert slab_period(("a", "b")) == pytest.approx(expected, rel=0.01)


# A box between two hands

BOX = MassSpring(
    mass=0.5,
    spring=0.0,
    damping=5.0,
    stiffness=1000.0,
    contact_damping=2.0,
    position=-0.03,
    thickness=0.06,
)


def test_a_box_that_two_hands_hold_rests_where_their_forces_balance() -> None:
    box = BOX.open(3)
    still = (0.0, 0.0, 0.0)
    for tick in range(4000):
        left = box.force("left", (-0.026, 0.0, 0.0), still, tick * 1e-3)
        right = box.force("right", (0.028, 0.0, 0.0), still, tick * 1e-3)
    # Both push 6 mm in all into faces 60 mm apart: 3 mm each, and 3 N.
    assert left == pytest.approx((3.0, 0.0, 0.0), rel=1e-6)
    assert right == pytest.approx((-3.0, 0.0, 0.0), rel=1e-6)
    scene = {each.name: each for each in box.scene() or ()}
    assert scene["slab"].position[0] == pytest.approx(0.001, rel=1e-6)
    assert not scene["slab"].is_fixed
    assert scene["floor"].shape == "plane"
    contacts = [box.contact(user) for user in ("left", "right")]
    assert contacts[0] is not None
    assert contacts[1] is not None
    assert contacts[0].normal == (-1.0, 0.0, 0.0)
    assert contacts[0].proxy[0] == pytest.approx(-0.029)
    assert contacts[1].normal == (1.0, 0.0, 0.0)
    assert contacts[1].proxy[0] == pytest.approx(0.031)


def test_the_momentum_of_a_box_is_that_of_the_forces_on_both_hands() -> None:
    slab = MassSpring(
        mass=0.5, spring=0.0, damping=0.0, stiffness=1000.0, position=-0.03, thickness=0.06
    ).open(1)
    impulse, places = 0.0, []
    for tick in range(300):  # the left hand goes in and out again, the right one goes less deep
        time = tick * 1e-3
        in_and_out = math.sin(math.pi * min(time, 0.2) / 0.2) ** 2
        left, right = -0.032 + 0.005 * in_and_out, 0.032 - 0.004 * in_and_out
        forces = slab.force("left", (left,), (0.0,), time)
        forces += slab.force("right", (right,), (0.0,), time)
        impulse += sum(forces) * 1e-3  # they resist the hands, so the box has them as they are
        places.append(next(iter(slab.scene() or ())).position[0])
    assert forces == (0.0, 0.0)
    momentum = 0.5 * (places[-1] - places[-3]) / 2e-3
    assert abs(momentum) > 1e-3
    assert momentum == pytest.approx(impulse, rel=0.02)


def test_a_box_is_pushed_by_the_hand_that_stays() -> None:
    box = BOX.open(1)
    for tick in range(2000):
        box.force("left", (-0.026,), (0.0,), tick * 1e-3)
        box.force("right", (0.028,), (0.0,), tick * 1e-3)
    box.leave("right")
    for tick in range(2000, 6000):
        (force,) = box.force("left", (-0.026,), (0.0,), tick * 1e-3)
    assert force == pytest.approx(0.0, abs=1e-3)


def test_two_hands_that_squeeze_a_box_between_stiff_contacts_do_not_make_it_swing() -> None:
    stiff = MassSpring(
        mass=1e-3, spring=0.0, damping=0.0, stiffness=1e5, contact_damping=1.0,
        position=-0.03, thickness=0.06,
    )  # fmt: skip
    box = stiff.open(1)
    for tick in range(500):
        (left,) = box.force("left", (-0.029,), (0.0,), tick * 1e-3)
        (right,) = box.force("right", (0.029,), (0.0,), tick * 1e-3)
    assert left == pytest.approx(100.0, rel=1e-3)
    assert right == pytest.approx(-100.0, rel=1e-3)


# Rigid bodies

SCENE = """<mujoco><option timestep="0.001" gravity="0 0 0"/><worldbody>
<body name="box"><joint type="slide" axis="1 0 0" damping="1"/>
<geom name="box" type="box" size="0.03 0.03 0.03" mass="0.2"/></body></worldbody></mujoco>"""


def bodies(folder: Path, **parameters: Any) -> Environment:
    file = folder / "box.xml"
    file.write_text(SCENE)
    return open_environment(Bodies(file, **parameters), 3)


def box_at(scene: Environment) -> float:
    return next(each for each in scene.scene() or () if each.name == "box").position[0]


def test_a_rigid_box_between_two_probes_rests_where_their_forces_balance(tmp_path: Path) -> None:
    scene, still = bodies(tmp_path), (0.0, 0.0, 0.0)
    for tick in range(300):  # the left hand alone moves the box first
        left = scene.force("left", (-0.035 + 1e-4 * min(tick, 100), 0.0, 0.0), still, tick * 1e-3)
    before = box_at(scene)
    assert before > 0.009
    for tick in range(300, 3000):
        shift = 1e-5 * min(tick - 300, 1000)
        left = scene.force("left", (-0.025, 0.0, 0.0), still, tick * 1e-3)
        right = scene.force("right", (0.05 - shift, 0.0, 0.0), still, tick * 1e-3)
        if tick == 300:
            assert box_at(scene) == pytest.approx(before, abs=1e-4)  # it stays where it was
    assert left[0] == pytest.approx(-right[0], rel=1e-3)
    # 65 mm from hand to hand, and a box of 60 mm between two balls of 5 mm: 2.5 mm each.
    assert left[0] == pytest.approx(2.5, rel=0.02)
    names = {each.name for each in scene.scene() or ()}
    assert names == {"box"}
    contact = scene.contact("right")
    assert contact is not None
    assert contact.normal[0] == pytest.approx(1.0, abs=1e-3)
    scene.leave("right")
    for tick in range(3000, 4000):
        left = scene.force("left", (-0.025, 0.0, 0.0), still, tick * 1e-3)
    assert left[0] == pytest.approx(0.0, abs=0.02)
    again = scene.force("right", (0.1, 0.0, 0.0), still, 4.0)
    assert again == pytest.approx(still, abs=1e-9)


def test_two_hands_do_not_make_rigid_bodies_faster(tmp_path: Path) -> None:
    file = tmp_path / "falling.xml"
    file.write_text(SCENE.replace("0 0 0", "2 0 0").replace('damping="1"', ""))
    scene = open_environment(Bodies(file), 3)
    for tick in range(101):
        for user, side in (("a", 0.2), ("b", -0.2)):
            scene.force(user, (0.0, 0.0, side), (0.0, 0.0, 0.0), tick * 1e-3)
    assert box_at(scene) == pytest.approx(0.5 * 2.0 * 0.1**2, rel=0.02)


def test_a_hand_that_joins_expected_bodies_stalls_nobody(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file, still = tmp_path / "box.xml", (0.0, 0.0, 0.0)
    file.write_text(SCENE)
    unexpected = open_environment(Bodies(file), 3)
    expected = open_environment(Bodies(file), 3, ("left", "right"))
    answers: dict[Environment, list[Vector]] = {unexpected: [], expected: []}
    for scene in answers:
        with monkeypatch.context() as patch:
            if scene is expected:  # nothing is compiled in the loop
                patch.setattr("forcebound.haptics.environments.bodies.compile_scene", None)
            for tick in range(300):
                left = (-0.035 + 1e-4 * min(tick, 100), 0.0, 0.0)
                answers[scene].append(scene.force("left", left, still, tick * 1e-3))
                if tick >= 150:
                    place = (0.06 - 2e-4 * min(tick - 150, 100), 0.0, 0.0)
                    right = scene.force("right", place, still, tick * 1e-3)
                    answers[scene].append(right)
    assert max(map(abs, answers[expected][-1])) > 0.5  # both hands press
    assert answers[expected] == pytest.approx(answers[unexpected], abs=1e-6)


def test_a_tool_is_for_one_hand(tmp_path: Path) -> None:
    scene, still = bodies(tmp_path, tool="box"), (0.0, 0.0, 0.0)
    scene.force("left", still, still, 0.0)
    with pytest.raises(ConfigError) as error:
        scene.force("right", still, still, 0.0)
    assert error.value.field == "tool"
    assert "left" in str(error.value)


# Fixtures


def test_fixtures_of_a_hand_are_added_to_those_of_all() -> None:
    limit = WorkspaceLimit(low=(-0.01,), high=(0.01,), stiffness=100.0)
    own = HandFixtures(workspace=WorkspaceLimit(low=(-0.02,), high=(0.02,), stiffness=1000.0))
    both = WithFixtures(Wall(stiffness=0.0), Fixtures(workspace=limit, hands={"left": own}))
    environment = both.open(1)
    assert environment.force("right", (0.03,), (0.0,), 0.0) == pytest.approx((2.0,))
    assert environment.force("left", (0.03,), (0.0,), 0.0) == pytest.approx((12.0,))
    names = [each.name for each in environment.scene() or ()]
    assert names == ["workspace limit", "left workspace limit"]


def test_an_environment_with_fixtures_gets_readings_and_leavings() -> None:
    model = Noting()
    environment = WithFixtures(model, Fixtures()).open(1)
    environment.take_readings("left", 1, None)
    environment.leave("left")
    assert model.opened.calls == [("readings", "left", 1, None), ("leave", "left")]
