"""The controller node, fed by hand: queries, commands, and which environment serves."""

import dataclasses

from builders import MS

from forcebound.graph.loader import load
from forcebound.haptics.controllers.direct import DirectController
from forcebound.messages.control import EnvironmentDied
from forcebound.messages.packets import (
    DeviceState,
    EnvironmentQuery,
    EnvironmentReply,
    Event,
    ForceCommand,
)
from forcebound.nodes.controller import ControllerNode
from forcebound.run.build import dead_lease_ns, lease_ns


def test_the_controller_asks_about_each_state_and_commands_each_answer_with_its_echo() -> None:
    node = ControllerNode(DirectController())
    state = DeviceState(41, 1000, 0.5, (0.01,), (0.2,), (0.0,))
    (query,) = node.step(1500, [state])
    assert query == EnvironmentQuery(0, 1500, 41, 1000, 0.5, (0.01,), (0.2,), None)
    reply = EnvironmentReply(7, 1700, 41, 1000, 0, 1500, (3.0,), "e")
    event, command = node.step(1800, [reply])
    assert isinstance(event, Event)
    assert (event.event, event.data) == ("environment_serves", {"environment": "e"})
    assert command == ForceCommand(0, 1800, 41, 1000, (3.0,), 1000)
    assert node.step(1900, [command]) == []


def reply_of(name: str, query: EnvironmentQuery) -> EnvironmentReply:
    """What an environment with this name answers."""
    echo = (query.device_seq, query.device_time_ns, query.seq, query.time_ns)
    return EnvironmentReply(query.seq, query.time_ns, *echo, (1.0,), name)


def ask(node: ControllerNode, time_ns: int) -> EnvironmentQuery:
    """The query that a controller makes at a time."""
    tick = time_ns // MS
    state = DeviceState(tick, time_ns, 0.5, (0.01,), (0.2,), (0.0,))
    queries = [p for p in node.step(time_ns, [state]) if isinstance(p, EnvironmentQuery)]
    (query,) = queries
    return query


def test_the_first_environment_that_answers_serves_and_another_one_is_refused() -> None:
    node = ControllerNode(DirectController(), lease_ns=1000 * MS)
    first = ask(node, 0)
    assert first.environment is None
    node.step(1 * MS, [reply_of("one", first)])
    query = ask(node, 2 * MS)
    assert query.environment == "one"
    (event,) = node.step(3 * MS, [reply_of("two", query)])
    assert isinstance(event, Event)
    assert (event.event, event.is_fault) == ("environment_refused", True)
    assert "two" in event.message
    assert "one" in event.message
    assert node.step(4 * MS, [reply_of("two", query)]) == []  # told once a second, counted always
    assert node.status().rejected == {"second_environment": 2}


def test_another_environment_serves_once_the_one_that_did_has_been_silent() -> None:
    node = ControllerNode(DirectController(), lease_ns=1000 * MS)
    node.step(1 * MS, [reply_of("one", ask(node, 0))])
    assert ask(node, 1001 * MS).environment == "one"
    lost, query = node.step(1002 * MS, [DeviceState(2, 1002 * MS, 0.0, (0.0,), (0.0,), (0.0,))])
    assert isinstance(lost, Event)
    assert isinstance(query, EnvironmentQuery)
    assert lost.event == "environment_lost"
    assert query.environment is None
    _, command = node.step(1003 * MS, [reply_of("two", query)])
    assert isinstance(command, ForceCommand)
    assert node.status().environment == "two"


def test_the_lease_of_an_environment_that_is_gone_is_shorter_and_the_next_one_has_a_whole_one() -> (
    None
):
    node = ControllerNode(DirectController(), lease_ns=1000 * MS, dead_lease_ns=200 * MS)
    node.step(1 * MS, [reply_of("host/1/a", ask(node, 0))])
    node.handle(EnvironmentDied("host/12/"))
    assert ask(node, 300 * MS).environment == "host/1/a"
    node.step(301 * MS, [reply_of("host/1/a", ask(node, 301 * MS))])
    node.handle(EnvironmentDied("host/1/"))
    assert ask(node, 501 * MS).environment == "host/1/a"  # the force must be at zero before
    lost, query = node.step(502 * MS, [DeviceState(2, 502 * MS, 0.0, (0.0,), (0.0,), (0.0,))])
    assert isinstance(lost, Event)
    assert isinstance(query, EnvironmentQuery)
    assert (lost.event, lost.is_fault) == ("environment_lost", True)
    assert "host/1/a is gone" in lost.message
    assert query.environment is None
    node.step(503 * MS, [reply_of("host/2/b", query)])
    assert ask(node, 1503 * MS).environment == "host/2/b"


def test_the_lease_outlasts_the_age_limit_so_that_the_force_is_zero_between_environments() -> None:
    config = load("stiff_wall.yaml")
    servo = dataclasses.replace(config.only.servo, age_limit=3.0)
    assert lease_ns(config.with_hand(servo=servo).only) >= 6_000 * MS
    assert lease_ns(config.only) > 1e9 * config.only.servo.age_limit
    assert dead_lease_ns(config.only) > 1e9 * config.only.servo.age_limit
