"""Contacts and scenes: what an environment reports beside its force, and how the node sends it."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from builders import MS, telemetry_packet
from msgspec.structs import replace

from forcebound.haptics.environments import (
    Environment,
    EnvironmentModel,
    may_report_contacts,
    open_environment,
)
from forcebound.haptics.environments.contract import check
from forcebound.haptics.environments.walls import Wall
from forcebound.messages.codec import MAX_SCENE_BYTES, encode
from forcebound.messages.packets import (
    MAX_LENGTH,
    Contact,
    EnvironmentQuery,
    EnvironmentReply,
    Event,
    Packet,
    Scene,
    SceneObject,
    Vector,
)
from forcebound.network.chances import ComputationTime
from forcebound.network.impairment import Impairment
from forcebound.nodes.environment import EnvironmentNode
from forcebound.recordings.telemetry import TelemetryColumns

BALL = SceneObject("ball", "sphere", size=(0.05,), is_fixed=False)


@dataclass(frozen=True)
class Floor(EnvironmentModel):
    """A floor at 10 mm along the first axis, with whatever it is to tell."""

    stiffness: float = 1000.0
    told: Any = None  # in place of the contact
    objects: tuple[Any, ...] = (BALL,)

    def open(self, axes: int) -> "OpenFloor":
        return OpenFloor(self, axes)


class OpenFloor(Environment):
    def __init__(self, model: Floor, axes: int) -> None:
        self.model = model
        self.axes = axes
        self.position: Vector = (0.0,) * axes
        self.objects = model.objects
        self.asked = 0  # for the scene

    def force(self, user: str, position: Vector, velocity: Vector, elapsed: float) -> Vector:
        self.position = position
        depth = max(0.0, position[0] - 0.01)
        return (self.model.stiffness * depth, *(0.0,) * (self.axes - 1))

    def contact(self, user: str) -> Any:
        if self.position[0] <= 0.01:
            return None
        others = (0.0,) * (self.axes - 1)
        return self.model.told or Contact((0.01, *self.position[1:]), (-1.0, *others))

    def scene(self) -> tuple[Any, ...]:
        self.asked += 1
        return self.objects

    def close(self) -> None:
        pass


class Kept(Floor):
    """A floor that remembers its instance."""

    def open(self, axes: int) -> OpenFloor:
        opened = super().open(axes)
        object.__setattr__(self, "opened", opened)
        return opened

    opened: OpenFloor


def query(seq: int, *position: float) -> EnvironmentQuery:
    place = position or (0.012,)
    return EnvironmentQuery(seq, seq, seq, seq, 0.0, place, (0.0,) * len(place), None)


def answer(node: EnvironmentNode, time_ns: int, *position: float) -> list[Packet]:
    """Return what a node sends for a query, and in the step after it if it wants one at once."""
    packets = node.step(time_ns, [query(time_ns, *position)])
    return packets + (node.step(time_ns, []) if node.wake_ns == time_ns else [])


def scenes(packets: list[Packet]) -> list[Scene]:
    return [packet for packet in packets if isinstance(packet, Scene)]


# --- Contacts ------------------------------------------------------------------------------------


def test_a_reply_carries_the_contact_and_none_in_free_motion() -> None:
    node = EnvironmentNode(Floor(), axes=2)
    touching, *_ = node.step(0, [query(0, 0.012, 0.5)])
    free, *_ = node.step(1, [query(1, 0.008, 0.5)])
    assert isinstance(touching, EnvironmentReply)
    assert isinstance(free, EnvironmentReply)
    assert touching.contact == Contact((0.01, 0.5), (-1.0, 0.0))
    assert (free.proxy, free.normal, free.contact) == (None, None, None)


def test_the_contact_is_that_of_its_query_however_late_the_answer_is() -> None:
    node = EnvironmentNode(Floor(), ComputationTime(Impairment(0.003)))
    node.step(0, [query(0, 0.012)])
    node.step(MS, [query(1, 0.008)])
    reply, *_ = node.step(3 * MS, [])
    assert isinstance(reply, EnvironmentReply)
    assert (reply.query_seq, reply.proxy) == (0, (0.01,))


@pytest.mark.parametrize("told", [((0.01,),), ((0.01, 0.0), (-1.0, 0.0)), ("a", "b")])
def test_a_contact_that_is_none_is_a_failure_and_no_answer(told: Any) -> None:
    node = EnvironmentNode(Floor(told=told))
    assert [type(packet) for packet in node.step(0, [query(0)])] == [Event]
    assert node.faults == 1


def test_a_stateless_model_may_tell_its_scene() -> None:
    class Drawn(Wall):
        def scene(self) -> tuple[SceneObject, ...]:
            return (BALL,)

    node = EnvironmentNode(Drawn())
    assert scenes(answer(node, 0)) == [Scene(0, 0, (BALL,))]
    assert not may_report_contacts(Drawn())
    assert may_report_contacts(Floor())
    assert open_environment(Wall(), 1).scene() is None


def test_columns_have_the_contact_of_the_same_tick() -> None:
    replies = [
        EnvironmentReply(0, 0, 1, 0, 0, 0, (1.0,), "e", (0.01,), (-1.0,)),
        EnvironmentReply(1, 0, 2, 0, 1, 0, (0.0,), "e"),
        EnvironmentReply(2, 0, 3, 0, 2, 0, (0.0,) * 2, "e", (0.0,) * 2, (1.0, 0.0)),  # not its axes
    ]
    columns = TelemetryColumns.from_packets([telemetry_packet(seq) for seq in range(4)], replies)
    assert columns.is_answered.tolist() == [False, True, True, False]
    assert np.array_equal(columns.proxy[:, 0], [math.nan, 0.01, math.nan, math.nan], equal_nan=True)
    assert columns.normal[1] == (-1.0,)
    assert columns.slice(columns.is_answered).proxy.shape == (2, 1)


# --- Scenes --------------------------------------------------------------------------------------


def test_a_scene_follows_an_answer_and_never_goes_before_it() -> None:
    model = Kept()
    node = EnvironmentNode(model)
    assert [type(packet) for packet in node.step(0, [query(0)])] == [EnvironmentReply]
    assert model.opened.asked == 0
    assert node.wake_ns == 0
    assert node.step(0, []) == [Scene(0, 0, (BALL,), {"hand": (0.01,)})]
    assert node.wake_ns is None


def test_a_scene_waits_for_a_moment_without_an_answer_but_not_for_ever() -> None:
    node = EnvironmentNode(Floor())
    sent = [scenes(node.step(tick * MS, [query(tick)])) for tick in range(200)]
    assert [tick for tick, packets in enumerate(sent) if packets] == [100]


def test_a_scene_is_sent_when_it_has_changed_at_most_30_times_a_second() -> None:
    model = Kept()
    node = EnvironmentNode(model)
    sent = []
    for tick in range(1000):
        moved = replace(BALL, position=(tick * 1e-4, 0.0, 0.0))
        model.opened.objects = (moved,)
        sent += scenes(answer(node, tick * MS))
    assert [scene.seq for scene in sent] == list(range(30))
    assert model.opened.asked == 30


def test_a_scene_that_stays_is_repeated_once_a_second_and_with_another_proxy() -> None:
    node = EnvironmentNode(Floor())
    times = [s.time_ns // MS for tick in range(2500) for s in scenes(answer(node, tick * MS))]
    assert times == [0, 986, 1972]  # of the moments at which it is asked for
    (free,) = scenes(answer(node, 2540 * MS, 0.0))
    assert free.proxies == {}


def test_what_does_not_fit_is_left_out_and_said_once() -> None:
    many = tuple(SceneObject(f"ball {place}", "sphere") for place in range(MAX_LENGTH + 6))
    node = EnvironmentNode(Floor(objects=many))
    _, scene, event = answer(node, 0)
    assert isinstance(scene, Scene)
    assert isinstance(event, Event)
    assert scene.objects == many[:MAX_LENGTH]
    assert (event.event, event.data) == ("scene_cut", {"left_out": "6"})
    assert answer(node, 1100 * MS)[2:] == []
    path = tuple((float(place), 0.0, 0.0) for place in range(MAX_LENGTH))
    long = tuple(SceneObject(f"path {place}", "path", points=path) for place in range(MAX_LENGTH))
    (cut,) = scenes(answer(EnvironmentNode(Floor(objects=long)), 0))
    assert 0 < len(cut.objects) < MAX_LENGTH
    assert len(encode(cut)) <= MAX_SCENE_BYTES


NO_OBJECTS = [
    (7,),
    (replace(BALL, position=(0.0, 0.0)),),
    (replace(BALL, digest="abc"),),
    (replace(BALL, position=np.zeros(3)),),
]


WRONG: list[dict[str, Any]] = [
    {"size": (math.nan,)},
    {"points": ((0.0, math.inf, 0.0),)},
    {"name": "\x1b[2J"},
    {"file": "a\nb"},
]


@pytest.mark.parametrize("changes", WRONG)
def test_an_object_without_finite_numbers_and_printable_names_cannot_be_made(
    changes: dict[str, Any],
) -> None:
    with pytest.raises(ValueError, match=r"finite|printable"):
        replace(BALL, **changes)


class Misdrawn(OpenFloor):
    """A floor whose scene cannot be made, or not be sent."""

    def scene(self) -> tuple[Any, ...]:
        return (replace(BALL, **self.objects[0]),)


@pytest.mark.parametrize("changes", [*WRONG, {"position": np.zeros(3)}])
def test_what_is_no_scene_is_said_once_and_costs_no_answer(
    changes: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Floor, "open", lambda model, axes: Misdrawn(model, axes))
    node = EnvironmentNode(Floor(objects=(changes,)))
    reply, event = answer(node, 0)
    assert isinstance(reply, EnvironmentReply)
    assert isinstance(event, Event)
    assert (event.event, event.is_fault) == ("scene_failed", True)
    assert len(answer(node, 1100 * MS)) == 1


def test_other_parameters_open_a_new_environment_whose_scene_is_told() -> None:
    node = EnvironmentNode(Floor(objects=(object(),)))
    answer(node, 0)
    node.set(Floor(), Impairment(0.0))
    assert scenes(answer(node, 40 * MS)) == [Scene(0, 40 * MS, (BALL,), {"hand": (0.01,)})]


# --- The contract --------------------------------------------------------------------------------


def test_the_contract_asks_for_contacts_and_scenes() -> None:
    held = check(Floor()).held
    assert held["contact"]
    assert held["scene"]
    assert all(held.values())
    assert not {"contact", "scene"} & set(check(Wall(), axes=[1]).held)


@pytest.mark.parametrize(
    ("told", "axes"),
    [
        (((0.01,), (-2.0,)), 1),
        (((math.nan,), (-1.0,)), 1),
        (((0.0, 0.0), (-1.0,)), 1),
        (((0.0,) * 3, (-0.5, 0.0, 0.0)), 3),
        ("no", 1),
    ],
)
def test_the_contract_finds_a_wrong_contact(told: Any, axes: int) -> None:
    assert not check(Floor(told=told), axes=[axes]).held["contact"]


@pytest.mark.parametrize(
    "objects", [*NO_OBJECTS, (BALL, BALL), (replace(BALL, orientation=(1.0, 1.0, 0.0, 0.0)),)]
)
def test_the_contract_finds_a_wrong_scene(objects: tuple[Any, ...]) -> None:
    assert not check(Floor(objects=objects), axes=[1]).held["scene"]


def test_the_contract_finds_a_contact_that_changes_answers() -> None:
    class Softened(OpenFloor):
        def contact(self, user: str) -> None:
            self.model = Floor(stiffness=0.5 * self.model.stiffness)

    class Softening(Floor):
        def open(self, axes: int) -> OpenFloor:
            return Softened(self, axes)

    assert not check(Softening(), axes=[1]).held["pure"]
