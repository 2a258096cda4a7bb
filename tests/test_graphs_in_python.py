"""Graphs made in Python: ``fb.Graph``, its text, and what takes it in place of a launch file."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeAlias, cast

import numpy as np
import pytest
from launch_texts import written

import forcebound as fb
from forcebound.errors import ConfigError
from forcebound.graph.document import shipped
from forcebound.graph.graph import GraphConfig
from forcebound.haptics.controllers.direct import DirectController
from forcebound.haptics.devices.knob import Knob
from forcebound.haptics.devices.phantom import PhantomPremium15 as Phantom
from forcebound.haptics.environments.walls import Wall
from forcebound.haptics.hands.hands import PressingHand
from forcebound.testing import Pad

Parts: TypeAlias = dict[str, Any]  # of a graph or a hand, by the names of their fields
LATE, TOO_LATE = fb.Link(delay=0.002), fb.Link(delay=0.3)  # s


@pytest.fixture(autouse=True)
def no_part_stays() -> Iterator[None]:
    """The parts that a test makes are not known to other tests."""
    yield
    for kind in fb.environments.added:
        del fb.environments[kind]


def hand(axes: int = 1, **parts: Any) -> fb.Hand:
    """A hand that presses with the device of the paper."""
    usual: Parts = {"device": Phantom(axes=axes), "operator": PressingHand()}
    return fb.Hand(**{**usual, **parts})


def wall(stiffness: float = 10e3) -> Wall:
    return Wall(stiffness=stiffness, position=0.01)


def graph(**parts: Any) -> fb.Graph:
    usual: Parts = {"seed": 1, "duration": 0.3, "hands": {"hand": hand()}, "environment": wall()}
    return fb.Graph(**{**usual, **parts})


def at(values: Parts) -> Parts:
    """Values of a graph by their paths."""
    return values


def problems_of(make: Callable[[], object]) -> list[str]:
    with pytest.raises(fb.errors.ConfigError) as caught:
        make()
    return str(caught.value).splitlines()


def same(left: fb.Run, right: fb.Run) -> bool:
    """Whether two runs have the same telemetry, to the bit."""
    one, other = left.telemetry, right.telemetry
    return one.keys() == other.keys() and all(
        np.array_equal(one[name], other[name], equal_nan=one[name].dtype.kind == "f")
        for name in one
    )


# --- made and checked ----------------------------------------------------------------------------


def test_a_graph_has_defaults_for_all_but_device_environment_seed_and_duration() -> None:
    made = graph(hands={"hand": fb.Hand(device=Knob())})
    assert made.only.servo == fb.Servo(law="certified")
    assert made.only.operator is None
    assert isinstance(made.only.controller, DirectController)
    assert made.environment == fb.World(wall())  # an environment alone takes no time


@pytest.mark.parametrize(
    ("parts", "places"),
    [
        ({"hands": {"hand": hand(links={"environment_reply": TOO_LATE})}}, ["device.age_limit"]),
        ({"environment": fb.World(wall(), compute_delay=0.3)}, ["device.age_limit"]),
        (
            {"hands": {"hand": hand(servo=fb.Servo(energy_partner="other"))}},
            ["device.energy_partner"],
        ),
        ({"hands": {"left": hand(), "right": hand(axes=2)}}, ["right.device.axes"]),
        (
            {"hands": {n: hand(links={"environment_reply": TOO_LATE}) for n in ("left", "right")}},
            ["left.device.age_limit", "right.device.age_limit"],  # all of them
        ),
        (
            {"hands": {"left": hand(), "right": hand()}, "here": ("middle",)},
            ["no hand 'middle'; the hands are"],
        ),
    ],
    ids=["late link", "late world", "no partner", "axes", "two problems", "no such hand here"],
)
def test_what_does_not_go_together_is_refused_when_a_graph_is_made(
    parts: Parts, places: list[str]
) -> None:
    assert [line.partition(":")[0] for line in problems_of(lambda: graph(**parts))] == places


@pytest.mark.parametrize(
    ("make", "field"),
    [
        (lambda: fb.Link(delay=-1.0), "delay"),
        (lambda: fb.Link(loss=1.5), "loss"),
        (lambda: fb.Servo(rate=-1.0), "rate"),
        (lambda: fb.World(wall(), compute_delay=-1.0), "compute_delay"),
        (lambda: wall(-1.0), "stiffness"),
    ],
    ids=["delay", "loss", "rate", "compute_delay", "stiffness"],
)
def test_a_number_out_of_its_range_is_refused_where_it_is_given(
    make: Callable[[], object], field: str
) -> None:
    with pytest.raises(fb.errors.ConfigError) as caught:
        make()
    assert caught.value.field == field


@pytest.mark.parametrize(
    ("parts", "message"),
    [
        ({"hands": {"a b": hand()}}, "hands: expected a word of letters.*got 'a b'"),
        ({"hands": {"device": hand()}}, "hands: expected a word .* no section"),
        ({"hands": {"hand": hand(), "left": hand()}}, "'hand' is the name of an only hand"),
        ({"hands": {}}, "1 to 8 hands"),
        ({"hands": {f"h{number}": hand() for number in range(9)}}, "1 to 8 hands"),
        ({"hands": [hand()]}, "hands: expected a mapping"),
        ({"hands": {"hand": "x"}}, r"hands\.hand: expected a forcebound\.Hand, got 'x'"),
        ({"hands": {"hand": hand(links={"nonsense": LATE})}}, "unknown link 'nonsense'"),
        ({"hands": {"hand": hand(controller=Wall())}}, "controller: expected .*ControllerModel"),
        ({"seed": -1}, "seed must be >= 0"),
        ({"duration": 0.0}, "duration must be > 0 s"),
        ({"duration": "1 s"}, "duration: expected a number in s, got '1 s'"),
        ({"environment": None}, "environment: expected .*EnvironmentModel, got None"),
        ({"environment": Wall}, r"environment: .*a class: add \(\)"),
    ],
)
def test_what_no_graph_has_is_refused_when_it_is_made(parts: Parts, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        graph(**parts)


def test_what_no_part_of_a_graph_has_is_refused() -> None:
    with pytest.raises(ConfigError, match="unknown law 'nonsense'"):
        fb.Servo(law="nonsense")
    with pytest.raises(ConfigError, match="delay: expected a number in s, got '2 ms'"):
        fb.Link(delay=cast(Any, "2 ms"))
    with pytest.raises(ConfigError, match=r"expected a forcebound\.Graph, .* got 3"):
        fb.simulate(cast(Any, 3))
    for name, message in (
        ("environment.stifness", "unknown key in environment"),
        ("links.environment_query", "unknown parameter"),
        ("left.device.law", "left.device.law: unknown law"),
    ):
        with pytest.raises(ConfigError, match=message):
            fb.simulate(graph(phases=(fb.Phase("odd", 0.1, {name: 1.0}),)))


def test_another_part_is_checked_with_the_others() -> None:
    made = graph()
    assert replace(made, seed=2).seed == 2
    world = fb.World(wall(), compute_delay=0.3)
    (line,) = problems_of(lambda: replace(made, environment=world))
    assert "300 ms" in line


# --- its text ------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", shipped())
def test_the_text_of_a_graph_is_a_launch_file_of_the_same_graph(name: str, tmp_path: Path) -> None:
    made = fb.Graph.read(name)
    assert fb.Graph.read(written(tmp_path, made.yaml())) == made


def test_the_text_has_what_differs_from_the_defaults_alone(tmp_path: Path) -> None:
    made = graph(hands={"hand": hand(links={"force_command": LATE})})
    text = made.yaml()
    assert "force_command:" in text
    assert "hands:" not in text
    assert "jitter" not in text
    assert "realtime" not in text
    two = graph(hands={"left": hand(), "right": hand(servo=fb.Servo(law="none"))})
    assert fb.Graph.read(written(tmp_path, two.yaml())) == two


# --- read ----------------------------------------------------------------------------------------


def test_a_file_is_read_with_arguments_and_other_values_by_path() -> None:
    plain = fb.Graph.read("stiff_wall")
    made = fb.Graph.read("stiff_wall", law="none", delay="2 ms", **at({"operator.mass": 0.5}))
    assert (made.only.servo.law, made.only.links["environment_query"].delay) == ("none", 0.002)
    assert made.only.operator == replace(plain.only.operator, mass=0.5)  # type: ignore[type-var]
    assert isinstance(made, GraphConfig)
    (line,) = problems_of(lambda: fb.Graph.read("stiff_wall", lw="none"))
    assert "'law'" in line


# --- in place of a launch file -------------------------------------------------------------------


def test_a_graph_runs_as_its_file_does_to_the_bit() -> None:
    read = fb.Graph.read("stiff_wall", delay="2 ms")
    links = dict.fromkeys(read.only.links, LATE)
    made = graph(
        hands={
            "hand": fb.Hand(
                device=Phantom(hand_speed=3.0),
                servo=read.only.servo,
                operator=read.only.operator,
                links=links,
            )
        },
        seed=read.seed,
    )
    by_file = fb.simulate("stiff_wall", delay="2 ms", duration=0.3)
    assert same(fb.simulate(made), by_file)
    assert same(fb.simulate(read, duration=0.3), by_file)
    assert not same(fb.simulate(made, law="none"), by_file)


def test_a_run_of_a_graph_takes_other_values_by_their_paths() -> None:
    stiff = fb.simulate(graph(environment=wall(500.0)))
    soft = fb.simulate(graph(), **at({"environment.stiffness": "0.5 N/mm"}))
    assert same(stiff, soft)
    assert not same(stiff, fb.simulate(graph()))
    (line,) = problems_of(lambda: fb.simulate(graph(), **at({"environment.stiffnes": 1.0})))
    assert "'stiffness'" in line
    (line,) = problems_of(lambda: fb.simulate(graph(), **at({"environment.stiffness": "1 kg"})))
    assert line.startswith("argument environment.stiffness:=1 kg: ")


def test_the_law_of_an_only_hand_has_a_short_name_whatever_the_hand_is_called() -> None:
    for name, label in (("hand", "none"), ("left", "left: none")):
        assert fb.simulate(graph(hands={name: hand()}), law="none").label == label


def test_a_class_of_this_program_runs_in_virtual_time() -> None:
    force = fb.simulate(graph(environment=Pad(stiffness=10e3))).telemetry["commanded_force"]
    assert np.array_equal(force, fb.simulate(graph()).telemetry["commanded_force"])
    assert np.any(force)


def test_a_sweep_varies_parts_and_paths() -> None:
    made, stiffness = graph(), [500.0, 2000.0]  # N/m
    by_path = fb.sweep(
        made, workers=0, law=["none", "certified"], **at({"environment.stiffness": stiffness})
    )
    by_part = fb.sweep(
        made,
        workers=0,
        law=["none", "certified"],
        environment=[wall(stiffness[0]), wall(stiffness[1])],
    )
    assert by_path.errors == by_part.errors == []
    assert by_path["environment.stiffness"].tolist() == stiffness * 2
    assert by_path["law"].tolist() == ["none", "none", "certified", "certified"]
    force = by_path["peak_force"]
    assert force.tolist() == by_part["peak_force"].tolist()
    assert len({*force}) == 3  # the softer wall asks for less than the law lets through
    chosen = by_path.where(law="none", **at({"environment.stiffness": 500.0}))
    assert chosen["peak_force"].tolist() == [force[0]]


def test_a_sweep_of_several_hands_varies_a_value_of_one() -> None:
    made = graph(hands={"left": hand(), "right": hand()}, duration=0.1)
    runs = fb.sweep(made, workers=0, **at({"left.device.law": ["none", "certified"]}))
    assert runs["left.device.law"].tolist() == ["none", "certified"]
    assert {*runs["right.device.law"]} == {"certified"}


# --- live ----------------------------------------------------------------------------------------


def test_a_class_of_this_program_is_no_part_of_a_live_graph() -> None:
    (line,) = problems_of(lambda: fb.launch(graph(environment=Pad())))
    assert line.startswith("environment Pad: ")


FILE_OF_A_WORLD = '''
from dataclasses import dataclass
from forcebound.haptics.controllers.direct import DirectController
from forcebound.haptics.devices.knob import Knob
from forcebound.haptics.devices.phantom import PhantomPremium15 as Phantom
from forcebound.haptics.environments import StatelessEnvironment
from forcebound.haptics.environments.walls import Wall
from forcebound.haptics.hands.hands import PressingHand


@dataclass(frozen=True)
class Pad(StatelessEnvironment):
    """A soft wall."""

    stiffness: float = 800.0

    def force(self, user, position, velocity, elapsed):
        return (self.stiffness * max(position[0] - 0.01, 0.0),)
'''


@pytest.mark.live
def test_a_class_of_a_file_is_one(tmp_path: Path) -> None:
    file = written(tmp_path, FILE_OF_A_WORLD, "pad.py")
    pad: Any = fb.environments[str(file)]
    with fb.launch(graph(environment=pad(500.0))) as running:
        assert isinstance(running, fb.Running)
        running.set("environment.stiffness", 600.0)
        assert running.parameters["environment.stiffness"] == 600.0
        running.wait(0.2)
    assert running.run.document["environment"]["kind"].endswith("pad.py:Pad")
    assert [*running.run.hands] == ["hand"]
    assert running.run.figures.true_energy_min >= 0.0
