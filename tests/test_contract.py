"""The contract check of environments: every broken promise is found and located."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import count
from typing import Any

import numpy as np
import pytest

from forcebound.haptics.environments import Environment, EnvironmentModel, StatelessEnvironment
from forcebound.haptics.environments.contract import PROMISES, check
from forcebound.haptics.environments.walls import ActiveWall, Damper, Wall
from forcebound.haptics.parts.contract import Findings, Violation, vector_fault
from forcebound.messages.packets import Contact

Answer = Callable[[tuple[float, ...], tuple[float, ...], float], Any]


@dataclass(frozen=True)
class Answers(StatelessEnvironment):
    """An environment with given answers."""

    answer: Answer

    def force(self, user: str, position: Any, velocity: Any, elapsed: float) -> Any:
        return self.answer(position, velocity, elapsed)


def broken(environment: EnvironmentModel, promise: str, **how: Any) -> Violation:
    """The first violation; none of another promise."""
    report = check(environment, **how)
    assert not report.held[promise]
    found = [one for one in report.violations if one.promise == promise]
    assert len(found) <= 3
    return found[0]


def zeros(position: tuple[float, ...], velocity: tuple[float, ...], elapsed: float) -> Any:
    return (0.0,) * len(position)


def test_an_error_is_told_with_its_question_and_its_line() -> None:
    def far_fails(position: tuple[float, ...], *_: Any) -> Any:
        return tuple(1.0 / (x < 10.0) for x in position)

    violation = broken(Answers(far_fails), "answers")
    assert violation.got.startswith("ZeroDivisionError")
    assert f"{__file__}:" in violation.got
    assert violation.where == "force('', (10.0,), (0.0,), 0.0)"


def test_a_missing_axis_is_told_with_what_came() -> None:
    violation = broken(Answers(lambda *_: (0.0,)), "shape")
    assert violation.expected == "a tuple with 2 numbers in N, one per axis"
    assert violation.got == "1 entries: (0.0,) of type tuple"
    assert check(Answers(lambda *_: (0.0,)), axes=(1,)).held["shape"]


def test_infinity_is_refused() -> None:
    assert broken(Answers(lambda p, *_: (float("inf"),) * len(p)), "finite").got == "(inf,)"


def test_a_memory_is_found() -> None:
    counter = count()
    violation = broken(Answers(lambda p, *_: (float(next(counter)),) * len(p)), "pure")
    assert violation.expected.endswith("as before")


def test_what_is_no_value_is_found() -> None:
    class Plain(StatelessEnvironment):
        def force(self, user: str, position: Any, velocity: Any, elapsed: float) -> Any:
            return zeros(position, velocity, elapsed)

    assert broken(Plain(), "value").expected == "@dataclass(frozen=True)"

    @dataclass(frozen=True)
    class Local(StatelessEnvironment):
        """It cannot be pickled."""

        def force(self, user: Any, position: Any, velocity: Any, elapsed: float) -> Any:
            return zeros(position, velocity, elapsed)

    assert broken(Local(), "value").where == "pickle"


def test_a_force_that_was_not_stated_is_found_at_rest() -> None:
    violation = broken(Wall(stiffness=1000.0, position=0.0), "rest", at_rest={0.001: 0.0})
    assert violation.expected == "(0.0,) N"
    assert violation.got == "(1.0,)"
    assert check(Wall(stiffness=1000.0, position=0.0), at_rest={0.001: 1.0}).held["rest"]
    assert set(check(Damper()).held) == set(PROMISES) - {"rest", "contact", "scene", "resists"}


def along(axis: int, force: Callable[[float], float]) -> Answers:
    """An environment whose force is a function of the position along one axis."""
    return Answers(
        lambda p, *_: tuple(force(x) if i == axis else 0.0 for i, x in enumerate(p)),
    )


@pytest.mark.parametrize(
    ("axis", "force"),
    [
        (0, lambda x: -1000.0 * max(x - 0.01, 0.0)),  # a wall
        (0, lambda x: -min(5.0, 1000.0 * max(x - 0.0102, 0.0))),  # of a largest force
        (2, lambda x: 1000.0 * max(-x, 0.0)),  # a floor
        (0, lambda x: -1000.0 * (max(x - 0.01, 0.0) + min(x + 0.01, 0.0))),  # a room
    ],
)
def test_a_force_that_pulls_deeper_is_found(axis: int, force: Callable[[float], float]) -> None:
    assert "pulls deeper" in broken(along(axis, force), "resists").got
    opposite = check(along(axis, lambda x: -force(x)))
    assert opposite.held["resists"]


def magnet(position: tuple[float, ...], *_: Any) -> Any:
    """It draws to a place, more the nearer, from 20 mm on."""
    offset = (position[0] - 0.02, *position[1:])
    distance = math.hypot(*offset)
    pull = max(1.0 - distance / 0.02, 0.0) / distance if distance else 0.0
    return tuple(5.0 * pull * x for x in offset)


@pytest.mark.parametrize(
    "environment",
    [
        Answers(magnet),
        along(0, lambda x: -100.0 * x),  # an unstable balance: no free motion
        along(0, lambda x: 100.0 * (x - 0.3)),  # a spring to a place ahead
        along(0, lambda x: -1.0 if x > 0.0 else 0.0),  # wind beyond a border
        along(0, lambda x: 1000.0 * (x - 0.01) if x > 0.008 else 0.0),  # a wall that adheres
        along(0, lambda x: -2.0 * math.sin(600.0 * x)),  # detents
        along(0, lambda x: 500.0 * x if 0.0 < x < 0.004 else 0.0),  # a skin that breaks
        along(0, lambda x: 300.0 * x - 800.0 * max(x - 0.003, 0.0) + 900.0 * max(x - 0.006, 0.0)
              if x > 0.0 else 0.0),  # a dome that snaps through
        Answers(lambda p, v, t: tuple(-5.0 * x for x in v)),  # a damper that gives energy
        ActiveWall(),
    ],
)  # fmt: skip
def test_no_other_force_is_accused_of_pulling_deeper(environment: EnvironmentModel) -> None:
    assert check(environment, axes=(1, 3)).held.get("resists", True)


@dataclass(frozen=True)
class Slab(EnvironmentModel):
    """A slab of 2 mm that reports contacts: nobody knows from force alone that it is no magnet."""

    sign: float

    def open(self, axes: int) -> Environment:
        return TouchedSlab(self.sign)


class TouchedSlab(Environment):
    def __init__(self, sign: float) -> None:
        self.sign = sign
        self.touched: Contact | None = None

    def force(self, user: str, position: Any, velocity: Any, elapsed: float) -> Any:
        depth, still = 0.001 - abs(position[0] - 0.01), (0.0,) * (len(position) - 1)
        side = math.copysign(1.0, position[0] - 0.01)
        place = (position[0] + side * depth, *position[1:])
        self.touched = None if depth < 0.0 else Contact(place, (side, *still))
        return (-self.sign * side * 1e3 * max(depth, 0.0), *still)

    def contact(self, user: str) -> Contact | None:
        return self.touched


def test_a_pull_into_what_is_touched_is_found_however_thin_it_is() -> None:
    assert check(Slab(1.0)).held["resists"]
    assert "pulls deeper" in broken(Slab(-1.0), "resists").got


def test_the_same_check_asks_the_same_and_at_most_so_many() -> None:
    assert check(Wall(), axes=(1, 3), at_most=100).questions in range(50, 110)
    asked: list[list[Any]] = [[], []]
    for log in asked:

        def answer(position: Any, *rest: Any, log: list[Any] = log) -> Any:
            log.append((position, *rest))
            return (0.0,) * len(position)

        check(Answers(answer), axes=(2,))
    assert asked[0] == asked[1]


@pytest.mark.parametrize(
    ("force", "got"),
    [
        ((1.0, 2), None),
        ([1.0, np.float32(2.0)], None),
        (np.zeros(2), None),
        (np.zeros((2, 2)), "an entry [0.0, 0.0] of type list"),
        ("12", "'12' of type str"),
        (None, "None"),
        (1.0, "1.0 of type float"),
        ((1.0,), "1 entries"),
        ((1.0, True), "an entry True of type bool"),
        ((1.0, "2"), "an entry '2' of type str"),
        ({1.0, 2.0}, "of type set"),
    ],
)
def test_the_form_of_an_answer_is_named(force: object, got: str | None) -> None:
    fault = vector_fault(force, 2, "N")
    assert (fault is None) == (got is None)
    assert fault is None or (got or "") in fault[1]


def test_no_promise_about_answers_is_called_kept_if_there_are_none() -> None:
    def fails(*_: Any) -> Any:
        raise ValueError

    held = check(Answers(fails)).held
    assert not held["answers"]
    assert held["opens"]
    assert not {"shape", "finite", "pure"} & set(held)


def test_the_same_violation_is_reported_once() -> None:
    found = Findings()
    for _ in range(2):
        found.add("answers", "an answer", "none", "here")
    assert len(found.report({"answers": "answers"}, 2).violations) == 1
