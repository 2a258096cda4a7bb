"""Restarts of nodes that die, and nodes that stop and start on request, without processes."""

import pytest
from run_starts import LIMITS, NODES, running

from forcebound.messages.control import StartNode, StopNode
from forcebound.run.actions import (
    Action,
    Announce,
    Ended,
    Interrupted,
    Kill,
    LifecycleEvent,
    Reported,
    RunPhase,
    Start,
    Terminate,
)
from forcebound.run.lifecycle import Lifecycle

SECOND = 1_000_000_000  # ns


def died(node: str, words: str) -> Announce:
    message = f"{node} ended unexpectedly, with {words}"
    return Announce("process_ended", node, message, is_fault=True, status=words)


def started(node: str) -> list[Action]:
    return [Start(node), Announce("process_started", node, f"{node} was restarted")]


def left(node: str, words: str = "exit status 0", *, is_fault: bool = False) -> Announce:
    message = f"{node} stopped on request, with {words}"
    return Announce("process_ended", node, message, is_fault, words)


@pytest.mark.parametrize(
    ("node", "status", "words"),
    [("controller", -9, "signal SIGKILL"), ("environment", 0, "exit status 0")],
)
def test_a_node_that_ends_by_itself_while_running_is_started_at_once(
    node: str, status: int, words: str
) -> None:
    lifecycle = running()
    assert lifecycle.advance(500, Ended(node, status)) == [died(node, words), *started(node)]
    assert lifecycle.phase is RunPhase.RUNNING
    assert lifecycle.failure is None
    assert lifecycle.restarts.counts == {node: 1}
    assert lifecycle.state(node) == "starting"
    assert lifecycle.silent == [node]
    assert lifecycle.advance(501, Reported(node, ("device_state",))) == []
    assert lifecycle.state(node) == "running"
    assert lifecycle.silent == []


@pytest.mark.parametrize(
    ("life_ns", "expected"),
    [
        (1, [0, SECOND // 5, SECOND // 2, SECOND]),  # a fifth death would end the run
        (5 * SECOND, [0, SECOND // 5, SECOND // 2, SECOND, *[2 * SECOND] * 4]),
        (10 * SECOND, [0, 0, 0]),
    ],
)
def test_who_dies_again_starts_later_and_later(life_ns: int, expected: list[int]) -> None:
    lifecycle = running()
    time_ns = 0
    waits = []
    for _ in expected:
        time_ns += life_ns
        actions = lifecycle.advance(time_ns, Ended("environment", 1))
        waits.append((lifecycle.deadline_ns or time_ns) - time_ns)
        if waits[-1]:
            assert lifecycle.state("environment") == "restarting"
            assert lifecycle.advance(time_ns + waits[-1] - 1) == []
        time_ns += waits[-1]
        actions += lifecycle.advance(time_ns)
        assert actions[1:] == started("environment")
    assert waits == expected


def test_five_deaths_within_ten_seconds_end_the_run() -> None:
    lifecycle = running()
    for time_ns in (1, 2 * SECOND, 4 * SECOND, 6 * SECOND):
        lifecycle.advance(time_ns, Ended("environment", 3))
        lifecycle.advance(time_ns + SECOND)
        assert lifecycle.phase is RunPhase.RUNNING
    assert lifecycle.advance(10 * SECOND, Ended("environment", 3)) == [
        died("environment", "exit status 3"),
        Terminate("device"),
    ]
    assert lifecycle.failure is not None
    assert lifecycle.failure.node == "environment"
    assert lifecycle.failure.message == (
        "environment ended unexpectedly 5 times within 10 s, the last time with exit status 3"
    )


def test_deaths_of_two_nodes_are_counted_apart() -> None:
    lifecycle = running()
    for time_ns in range(0, 4 * SECOND, SECOND):
        for node in ("controller", "environment"):
            lifecycle.advance(time_ns, Ended(node, 3))
            lifecycle.advance(time_ns + SECOND)
    assert lifecycle.phase is RunPhase.RUNNING
    assert lifecycle.restarts.counts == {"controller": 4, "environment": 4}


@pytest.mark.parametrize("end", [None, Interrupted()])
def test_the_run_ends_in_time_while_a_node_is_down(end: LifecycleEvent | None) -> None:
    lifecycle = running(1000)
    lifecycle.advance(500, Ended("environment", 1))
    lifecycle.advance(501, Ended("environment", 1))  # and is down for 0.2 s
    assert lifecycle.deadline_ns == 1003
    assert lifecycle.advance(1003, end) == [Terminate("device")]
    assert lifecycle.advance(1004, Ended("device", 0)) == [Terminate("controller")]
    assert lifecycle.advance(SECOND) == [Kill("controller")]  # and no start of the environment
    assert lifecycle.advance(SECOND, Ended("controller", -9)) == [Terminate("recorder")]
    assert lifecycle.advance(SECOND, Ended("recorder", 0)) == []
    assert lifecycle.phase is RunPhase.OVER


def test_a_node_that_is_told_to_stop_before_it_can_listen_is_no_failure() -> None:
    lifecycle = running(1000)
    lifecycle.advance(500, Ended("environment", -9))
    lifecycle.advance(1003)
    lifecycle.advance(1004, Ended("device", 0))
    lifecycle.advance(1005, Ended("environment", -15))
    lifecycle.advance(1006, Ended("controller", 0))
    assert lifecycle.failure is None
    assert lifecycle.advance(1007, Ended("recorder", 0)) == []
    assert lifecycle.phase is RunPhase.OVER


def test_a_node_stops_on_request_and_stays_away_until_it_is_started() -> None:
    lifecycle = running()
    assert lifecycle.advance(500, StopNode("environment")) == [Terminate("environment")]
    assert lifecycle.state("environment") == "stopping"
    assert lifecycle.advance(501, StopNode("environment")) == []
    assert lifecycle.advance(502, Ended("environment", 0)) == [left("environment")]
    assert lifecycle.state("environment") == "stopped"
    assert lifecycle.advance(20 * SECOND) == []
    assert lifecycle.advance(20 * SECOND, StopNode("environment")) == []
    assert lifecycle.advance(20 * SECOND, StartNode("environment")) == started("environment")
    assert lifecycle.advance(20 * SECOND, StartNode("environment")) == []
    assert lifecycle.restarts.counts == {}
    assert lifecycle.failure is None


def test_who_does_not_stop_on_request_is_killed_and_that_is_no_fault_either() -> None:
    lifecycle = running()
    lifecycle.advance(500, StopNode("controller"))
    assert lifecycle.deadline_ns == 520
    assert lifecycle.advance(519) == []
    assert lifecycle.advance(520) == [Kill("controller")]
    assert lifecycle.deadline_ns is None
    assert lifecycle.advance(521) == []
    message = "controller did not stop in time on request and was killed"
    assert lifecycle.advance(522, Ended("controller", -9)) == [
        Announce("process_ended", "controller", message, is_fault=False, status="signal SIGKILL")
    ]
    assert lifecycle.phase is RunPhase.RUNNING
    assert lifecycle.advance(530, StartNode("controller")) == started("controller")
    lifecycle.advance(531, Reported("controller", ()))
    actions = lifecycle.advance(540, Ended("controller", -9))  # by itself, now
    assert actions[0] == died("controller", "signal SIGKILL")


def test_who_is_asked_for_while_it_stops_starts_when_it_is_gone() -> None:
    lifecycle = running()
    lifecycle.advance(500, StopNode("environment"))
    assert lifecycle.advance(501, StartNode("environment")) == []
    assert lifecycle.advance(502, Ended("environment", 0)) == [
        left("environment"),
        *started("environment"),
    ]


def test_a_node_that_waits_for_its_restart_can_be_stopped_and_started() -> None:
    lifecycle = running()
    lifecycle.advance(500, Ended("environment", 1))
    lifecycle.advance(501, Ended("environment", 1))
    assert lifecycle.advance(502, StopNode("environment")) == []
    assert lifecycle.state("environment") == "stopped"
    assert lifecycle.deadline_ns is None
    assert lifecycle.advance(SECOND) == []
    assert lifecycle.advance(SECOND, StartNode("environment")) == started("environment")


@pytest.mark.parametrize("status", [0, -15, 1])
def test_the_end_of_the_run_while_a_node_stops_on_request_is_no_failure(status: int) -> None:
    lifecycle = running()
    lifecycle.advance(500, StopNode("environment"))
    assert lifecycle.advance(501, Interrupted()) == [Terminate("device")]
    assert lifecycle.advance(502, Ended("environment", status)) == []
    assert lifecycle.advance(503, Ended("device", 0)) == [Terminate("controller")]
    assert lifecycle.advance(504, Ended("controller", 0)) == [Terminate("recorder")]
    assert lifecycle.advance(505, Ended("recorder", 0)) == []
    assert lifecycle.failure is None
    assert lifecycle.phase is RunPhase.OVER


def test_a_request_that_cannot_be_met_changes_nothing_and_says_why() -> None:
    lifecycle = Lifecycle(NODES[1:], None, 0, LIMITS)  # its environment is somewhere else
    for node, reason in {
        "device": "a run ends without its device",
        "recorder": "a run ends without its recorder",
        "environment": "does not run its environment; it runs controller, device, recorder",
        "dashboard": "no node 'dashboard' in this graph; its nodes are controller, device",
        "controller": "the run is starting; nodes stop and start only while it is running",
    }.items():
        assert reason in (lifecycle.refusal(StopNode(node)) or "")
        assert lifecycle.advance(1, StopNode(node)) == []
        assert lifecycle.advance(1, StartNode(node)) == []
    assert lifecycle.phase is RunPhase.STARTING
    assert running().refusal(StopNode("controller")) is None
