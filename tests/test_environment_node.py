"""The environment node, fed by hand: answers, computation time, and code that fails."""

import logging
import math
from typing import Any

import numpy as np
import pytest
from builders import MS, query
from msgspec.structs import replace

from forcebound.haptics.environments import StatelessEnvironment
from forcebound.haptics.environments.walls import Wall
from forcebound.messages.codec import decode, encode
from forcebound.messages.packets import EnvironmentReply, Event, Vector
from forcebound.network.chances import ComputationTime
from forcebound.network.impairment import Impairment
from forcebound.nodes.environment import EnvironmentNode


def test_an_environment_that_does_not_serve_says_so_and_answers_once_a_second() -> None:
    node = EnvironmentNode(Wall(), name="two")
    answers = 0
    events = []
    for tick in range(2500):
        asked = replace(query(tick), environment="one")
        packets = node.step(tick * MS, [asked])
        answers += sum(isinstance(p, EnvironmentReply) for p in packets)
        events += [p for p in packets if isinstance(p, Event)]
    assert answers == 3
    assert [event.event for event in events] == ["environment_refused"]
    assert "one" in events[0].message


def test_an_environment_whose_queries_change_their_mind_says_so_now_and_then() -> None:
    node = EnvironmentNode(Wall(), name="two")
    events: list[Event] = []
    for tick in range(1000):
        asked = replace(query(tick), environment=("one", "two", None, "three")[tick % 4])
        events += [p for p in node.step(tick * MS, [asked]) if isinstance(p, Event)]
    assert 2 <= len(events) <= 6
    last = replace(query(2000), environment="four")
    (told,) = (p for p in node.step(2000 * MS, [last]) if isinstance(p, Event))
    assert "four serves this graph" in told.message


@pytest.mark.parametrize("serving", [None, "two"])
def test_an_environment_answers_when_nobody_serves_or_it_does(serving: str | None) -> None:
    node = EnvironmentNode(Wall(), name="two")
    node.step(0, [replace(query(0), environment="one")])
    *_, reply = node.step(1, [replace(query(1), environment=serving)])
    assert isinstance(reply, EnvironmentReply)
    assert reply.environment == "two"


def test_the_environment_answers_at_once_when_it_needs_no_time() -> None:
    node = EnvironmentNode(Wall(stiffness=1000.0))
    (reply,) = node.step(5 * MS, [query(3)])
    assert isinstance(reply, EnvironmentReply)
    assert reply.force == pytest.approx((1.0,))
    assert reply == EnvironmentReply(0, 5 * MS, 3, 3 * MS, 3, 3 * MS, reply.force, "environment")
    assert node.wake_ns is None


@pytest.mark.parametrize("key", ["position", "velocity", "elapsed"])
def test_a_query_that_is_not_finite_is_counted_and_not_answered(key: str) -> None:
    node = EnvironmentNode(Wall())
    for number in (math.nan, math.inf):
        assert (
            node.step(0, [replace(query(0), **{key: number if key == "elapsed" else (number,)})])
            == []
        )
    assert node.status().rejected == {"not_finite": 2}
    assert node.answered == 0


def test_while_it_computes_it_answers_nothing_and_then_the_newest() -> None:
    node = EnvironmentNode(Wall(), ComputationTime(Impairment(0.003)))
    assert node.step(0, [query(0)]) == []
    assert node.wake_ns == 3 * MS
    assert node.step(1 * MS, [query(1)]) == []
    assert node.step(2 * MS, [query(2)]) == []
    (reply,) = node.step(3 * MS, [])
    assert isinstance(reply, EnvironmentReply)
    assert reply.query_seq == 0
    assert node.wake_ns == 6 * MS
    (reply,) = node.step(6 * MS, [])
    assert isinstance(reply, EnvironmentReply)
    assert reply.query_seq == 2
    assert node.wake_ns is None


class OfNumpy(StatelessEnvironment):
    """An environment that answers with numbers of numpy."""

    def force(self, user: str, position: Vector, velocity: Vector, elapsed: float) -> Any:
        return (np.float32(1),)


def test_an_answer_of_numpy_numbers_can_be_sent() -> None:
    (reply,) = EnvironmentNode(OfNumpy()).step(0, [query(0)])
    answer = decode(encode(reply), EnvironmentReply)
    assert isinstance(answer, EnvironmentReply)
    assert answer.force == (1.0,)


class Broken(StatelessEnvironment):
    """An environment of a user who makes mistakes: an axis forgotten, an error raised."""

    def force(self, user: str, position: Vector, velocity: Vector, elapsed: float) -> Vector:
        return position[1:] if len(position) > 1 else (1 / 0,)


def test_an_environment_that_fails_is_silent_and_counted(caplog: pytest.LogCaptureFixture) -> None:
    node = EnvironmentNode(Broken())
    two_axes = replace(query(0), position=(0.0, 0.0), velocity=(0.0, 0.0))
    with caplog.at_level(logging.ERROR):
        (event,) = node.step(0, [two_axes])
        assert isinstance(event, Event)
        assert (event.event, event.is_fault) == ("environment_failed", True)
        assert "expected 2 entries, got 1" in caplog.text
        assert node.step(1, [query(1)]) == []
    assert node.status().failures == 2
    assert len(caplog.records) == 1
