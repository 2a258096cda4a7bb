"""The supervisor's decisions: histories of events and actions, without processes."""

import signal

import pytest

from forcebound.launch.actions import (
    Action,
    Announce,
    Ended,
    Engage,
    Engaged,
    Event,
    Interrupted,
    Kill,
    Reported,
    Start,
    StartRequested,
    StopRequested,
    Terminate,
    describe_status,
)
from forcebound.launch.lifecycle import Lifecycle, Limits, Phase

NODES = ("environment", "controller", "device", "recorder")
LIMITS = Limits(start_ns=100, engage_ns=10, stop_ns=20, recorder_stop_ns=50, kill_ns=5)

READY = [Reported(name, ()) for name in NODES]
RUNNING: list[tuple[int, Event | None, list[Action]]] = [
    *((1, event, []) for event in READY[:-1]),
    (2, READY[-1], [Engage()]),
    (3, Engaged(), []),
]
STOPPED: list[tuple[int, Event | None, list[Action]]] = [
    (1010, Ended("device", 0), [Terminate("controller"), Terminate("environment")]),
    (1011, Ended("environment", 0), []),
    (1012, Ended("controller", 0), [Terminate("recorder")]),
    (1013, Ended("recorder", 0), []),
]

HISTORIES: dict[str, tuple[list[tuple[int, Event | None, list[Action]]], str | None]] = {
    "a run of its full duration": (
        [*RUNNING, (1002, None, []), (1003, None, [Terminate("device")]), *STOPPED],
        None,
    ),
    "an interrupt stops in order": (
        [*RUNNING, (500, Interrupted(), [Terminate("device")]), *STOPPED],
        None,
    ),
    "an interrupt while starting stops in order": (
        [(1, READY[0], []), (2, Interrupted(), [Terminate("device")]), *STOPPED],
        None,
    ),
    "nobody engages before all are ready": (
        [
            (1, Reported("device", ()), []),
            (2, Reported("controller", ("environment_reply",)), []),
            (3, Reported("environment", ()), []),
            (4, Engaged(), []),
            (
                100,
                None,
                [Terminate("device")],
            ),
            *STOPPED,
        ],
        "not ready after 1e-07 s: controller has received nothing on environment_reply; "
        "recorder does not answer",
    ),
    "a device that does not engage": (
        [*RUNNING[:-1], (11, None, []), (12, None, [Terminate("device")]), *STOPPED],
        "device does not answer the request to engage",
    ),
    "the recorder dies while running": (
        [
            *RUNNING,
            (500, Ended("recorder", -9), [Terminate("device")]),
            (501, Ended("device", 0), [Terminate("controller"), Terminate("environment")]),
            (502, Ended("environment", 0), []),
            (503, Ended("controller", 0), []),
        ],
        "recorder ended unexpectedly, with signal SIGKILL",
    ),
    "a controller that dies before the force engages ends the run": (
        [*RUNNING[:-1], (3, Ended("controller", -9), [Terminate("device")])],
        "controller ended unexpectedly, with signal SIGKILL",
    ),
    "the device dies, and then the others are stopped": (
        [
            *RUNNING,
            (500, Ended("device", 1), [Terminate("controller"), Terminate("environment")]),
            *STOPPED[1:],
        ],
        "device ended unexpectedly, with exit status 1",
    ),
    "a node dies while starting": (
        [
            (1, READY[0], []),
            (2, Ended("recorder", 2), [Terminate("device")]),
            *STOPPED[:2],
            (1012, Ended("controller", 0), []),
        ],
        "recorder ended unexpectedly, with exit status 2",
    ),
    "a node that ends by itself without an error is missed all the same": (
        [*RUNNING, (500, Ended("recorder", 0), [Terminate("device")])],
        "recorder ended unexpectedly, with exit status 0",
    ),
    "only the first failure is told": (
        [
            *RUNNING,
            (500, Ended("recorder", 3), [Terminate("device")]),
            (501, Ended("device", 1), [Terminate("controller"), Terminate("environment")]),
        ],
        "recorder ended unexpectedly, with exit status 3",
    ),
    "a device that does not stop is killed, and only then the others are stopped": (
        [
            *RUNNING,
            (1003, None, [Terminate("device")]),
            (1022, None, []),
            (1023, None, [Kill("device")]),
            (1024, Ended("device", -9), [Terminate("controller"), Terminate("environment")]),
            (1025, Ended("controller", 0), []),
            (1026, Ended("environment", 0), [Terminate("recorder")]),
            (1027, Ended("recorder", 0), []),
        ],
        "device did not stop in time and was killed",
    ),
    "a process that cannot be killed is left": (
        [
            *RUNNING,
            (1003, None, [Terminate("device")]),
            (1023, None, [Kill("device")]),
            (1028, None, [Terminate("controller"), Terminate("environment")]),
            *STOPPED[1:],
        ],
        "device cannot be killed",
    ),
    "the recorder has more time than the others": (
        [
            *RUNNING,
            (1003, None, [Terminate("device")]),
            *STOPPED[:3],
            (1061, None, []),
            (1062, None, [Kill("recorder")]),
            (1063, Ended("recorder", -9), []),
        ],
        "recorder did not stop in time and was killed",
    ),
    "a node that fails while it stops": (
        [
            *RUNNING,
            (1003, None, [Terminate("device")]),
            (1004, Ended("device", 1), [Terminate("controller"), Terminate("environment")]),
            *STOPPED[1:],
        ],
        "device stopped with exit status 1",
    ),
    "a node that dies before its turn to stop": (
        [
            *RUNNING,
            (1003, None, [Terminate("device")]),
            (1004, Ended("environment", -15), []),
            (1005, Ended("device", 0), [Terminate("controller")]),
            (1006, Ended("controller", 0), [Terminate("recorder")]),
            (1007, Ended("recorder", 0), []),
        ],
        "environment stopped with signal SIGTERM",
    ),
    "impatience kills all but the device": (
        [
            *RUNNING,
            (500, Interrupted(), [Terminate("device")]),
            (501, Interrupted(), [Kill("controller"), Kill("environment"), Kill("recorder")]),
            (502, Interrupted(), []),
            (503, Ended("controller", -9), []),
            (504, Ended("environment", -9), []),
            (505, Ended("recorder", -9), []),
            (506, Ended("device", 0), []),
        ],
        "controller did not stop in time and was killed",
    ),
}


@pytest.mark.parametrize("history", HISTORIES)
def test_each_history_leads_to_its_actions(history: str) -> None:
    steps, failure = HISTORIES[history]
    lifecycle = Lifecycle(NODES, 1000, 0, LIMITS)
    for time_ns, event, actions in steps:
        assert lifecycle.advance(time_ns, event) == actions, (time_ns, event)
    told = None if lifecycle.failure is None else lifecycle.failure.message
    assert told == failure
    all_ended = {e.node for _, e, _ in steps if isinstance(e, Ended)} == set(NODES)
    if all_ended or "left" in history:
        assert lifecycle.phase is Phase.OVER
        assert lifecycle.deadline_ns is None
    else:
        assert lifecycle.phase is Phase.STOPPING


def test_without_a_duration_a_run_goes_on_until_interrupted() -> None:
    lifecycle = Lifecycle(NODES, None, 0, LIMITS)
    for time_ns, event, actions in RUNNING:
        assert lifecycle.advance(time_ns, event) == actions
    assert lifecycle.deadline_ns is None
    assert lifecycle.advance(10**18) == []
    assert lifecycle.advance(10**18, Interrupted()) == [Terminate("device")]
    assert lifecycle.interrupted


def test_a_device_that_is_killed_while_it_still_starts_is_no_failure() -> None:
    lifecycle = Lifecycle(("device",), None, 0, LIMITS)
    assert lifecycle.advance(1, Interrupted()) == [Terminate("device")]
    assert lifecycle.advance(1 + LIMITS.stop_ns) == [Kill("device")]
    assert lifecycle.advance(30, Ended("device", -signal.SIGKILL)) == []
    assert lifecycle.phase is Phase.OVER
    assert lifecycle.failure is None


def test_the_force_engages_once() -> None:
    lifecycle = Lifecycle(("device",), None, 0, LIMITS)
    assert lifecycle.advance(1, Reported("device", ())) == [Engage()]
    assert lifecycle.advance(2, Reported("device", ())) == []
    lifecycle.advance(3, Engaged())
    assert lifecycle.advance(4, Engaged()) == []
    assert lifecycle.advance(5, Reported("device", ())) == []


SECOND = 1_000_000_000  # ns


def running(duration_ns: int | None = None) -> Lifecycle:
    """Return a run whose force is engaged since 3 ns."""
    lifecycle = Lifecycle(NODES, duration_ns, 0, LIMITS)
    for time_ns, event, actions in RUNNING:
        assert lifecycle.advance(time_ns, event) == actions
    return lifecycle


def died(node: str, words: str) -> Announce:
    message = f"{node} ended unexpectedly, with {words}"
    return Announce("process_ended", node, message, is_fault=True, status=words)


def started(node: str) -> list[Action]:
    return [Start(node), Announce("process_started", node, f"{node} was restarted")]


def left(node: str, words: str = "exit status 0", *, is_fault: bool = False) -> Announce:
    message = f"{node} stopped on request, with {words}"
    return Announce("process_ended", node, message, is_fault, words)


@pytest.mark.parametrize("node", ["controller", "environment"])
@pytest.mark.parametrize(
    ("status", "words"), [(-9, "signal SIGKILL"), (1, "exit status 1"), (0, "exit status 0")]
)
def test_a_node_that_ends_by_itself_while_running_is_started_at_once(
    node: str, status: int, words: str
) -> None:
    lifecycle = running()
    assert lifecycle.advance(500, Ended(node, status)) == [died(node, words), *started(node)]
    assert lifecycle.phase is Phase.RUNNING
    assert lifecycle.failure is None
    assert lifecycle.restarts.counts == {node: 1}
    assert lifecycle.state(node) == "starting"
    assert lifecycle.silent == [node]
    assert lifecycle.advance(501, Reported(node, ("device_state",))) == []
    assert lifecycle.state(node) == "running"
    assert lifecycle.silent == []


def test_who_dies_again_starts_later_and_later() -> None:
    lifecycle = running()
    time_ns = SECOND
    for wait_ns in (0, SECOND // 5, SECOND // 2, SECOND):
        actions = lifecycle.advance(time_ns, Ended("environment", 1))
        assert actions[0] == died("environment", "exit status 1")
        if wait_ns:
            assert actions[1:] == []
            assert lifecycle.state("environment") == "restarting"
            time_ns += wait_ns
            assert lifecycle.deadline_ns == time_ns
            assert lifecycle.advance(time_ns - 1) == []
            actions = [actions[0], *lifecycle.advance(time_ns)]
        assert actions[1:] == started("environment")
        assert lifecycle.deadline_ns is None
        time_ns += 1


def test_who_dies_slowly_again_and_again_waits_at_most_two_seconds() -> None:
    lifecycle = running()
    time_ns = 0
    waits = []
    for _ in range(8):
        time_ns += 5 * SECOND
        actions = lifecycle.advance(time_ns, Ended("environment", 1))
        waits.append((lifecycle.deadline_ns or time_ns) - time_ns)
        time_ns += waits[-1]
        actions += lifecycle.advance(time_ns)
        assert actions[1:] == started("environment")
    assert waits == [0, SECOND // 5, SECOND // 2, SECOND, *[2 * SECOND] * 4]


def test_who_has_lived_long_enough_starts_at_once_again() -> None:
    lifecycle = running()
    for time_ns in (SECOND, 11 * SECOND, 21 * SECOND):
        actions = lifecycle.advance(time_ns, Ended("environment", 1))
        assert actions[1:] == started("environment")


def test_five_deaths_within_ten_seconds_end_the_run() -> None:
    lifecycle = running()
    for time_ns in (1, 2 * SECOND, 4 * SECOND, 6 * SECOND):
        lifecycle.advance(time_ns, Ended("environment", 3))
        lifecycle.advance(time_ns + SECOND)
        assert lifecycle.phase is Phase.RUNNING
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
    assert lifecycle.phase is Phase.RUNNING
    assert lifecycle.restarts.counts == {"controller": 4, "environment": 4}


@pytest.mark.parametrize("end", [None, Interrupted()])
def test_the_run_ends_in_time_while_a_node_is_down(end: Event | None) -> None:
    lifecycle = running(1000)
    lifecycle.advance(500, Ended("environment", 1))
    lifecycle.advance(501, Ended("environment", 1))  # and is down for 0.2 s
    assert lifecycle.deadline_ns == 1003
    assert lifecycle.advance(1003, end) == [Terminate("device")]
    assert lifecycle.advance(1004, Ended("device", 0)) == [Terminate("controller")]
    assert lifecycle.advance(SECOND) == [Kill("controller")]  # and no start of the environment
    assert lifecycle.advance(SECOND, Ended("controller", -9)) == [Terminate("recorder")]
    assert lifecycle.advance(SECOND, Ended("recorder", 0)) == []
    assert lifecycle.phase is Phase.OVER


def test_a_node_that_is_told_to_stop_before_it_can_listen_is_no_failure() -> None:
    lifecycle = running(1000)
    lifecycle.advance(500, Ended("environment", -9))
    lifecycle.advance(1003)
    lifecycle.advance(1004, Ended("device", 0))
    lifecycle.advance(1005, Ended("environment", -15))
    lifecycle.advance(1006, Ended("controller", 0))
    assert lifecycle.failure is None
    assert lifecycle.advance(1007, Ended("recorder", 0)) == []
    assert lifecycle.phase is Phase.OVER


def test_a_node_stops_on_request_and_stays_away_until_it_is_started() -> None:
    lifecycle = running()
    assert lifecycle.advance(500, StopRequested("environment")) == [Terminate("environment")]
    assert lifecycle.state("environment") == "stopping"
    assert lifecycle.advance(501, StopRequested("environment")) == []
    assert lifecycle.advance(502, Ended("environment", 0)) == [left("environment")]
    assert lifecycle.state("environment") == "stopped"
    assert lifecycle.advance(20 * SECOND) == []
    assert lifecycle.advance(20 * SECOND, StopRequested("environment")) == []
    assert lifecycle.advance(20 * SECOND, StartRequested("environment")) == started("environment")
    assert lifecycle.advance(20 * SECOND, StartRequested("environment")) == []
    assert lifecycle.restarts.counts == {}
    assert lifecycle.failure is None


def test_who_does_not_stop_on_request_is_killed_and_that_is_no_fault_either() -> None:
    lifecycle = running()
    lifecycle.advance(500, StopRequested("controller"))
    assert lifecycle.deadline_ns == 520
    assert lifecycle.advance(519) == []
    assert lifecycle.advance(520) == [Kill("controller")]
    assert lifecycle.deadline_ns is None
    assert lifecycle.advance(521) == []
    message = "controller did not stop in time on request and was killed"
    assert lifecycle.advance(522, Ended("controller", -9)) == [
        Announce("process_ended", "controller", message, is_fault=False, status="signal SIGKILL")
    ]
    assert lifecycle.phase is Phase.RUNNING
    assert lifecycle.advance(530, StartRequested("controller")) == started("controller")
    lifecycle.advance(531, Reported("controller", ()))
    actions = lifecycle.advance(540, Ended("controller", -9))  # by itself, now
    assert actions[0] == died("controller", "signal SIGKILL")


def test_who_is_asked_for_while_it_stops_starts_when_it_is_gone() -> None:
    lifecycle = running()
    lifecycle.advance(500, StopRequested("environment"))
    assert lifecycle.advance(501, StartRequested("environment")) == []
    assert lifecycle.advance(502, Ended("environment", 0)) == [
        left("environment"),
        *started("environment"),
    ]


def test_a_node_that_waits_for_its_restart_can_be_stopped_and_started() -> None:
    lifecycle = running()
    lifecycle.advance(500, Ended("environment", 1))
    lifecycle.advance(501, Ended("environment", 1))
    assert lifecycle.advance(502, StopRequested("environment")) == []
    assert lifecycle.state("environment") == "stopped"
    assert lifecycle.deadline_ns is None
    assert lifecycle.advance(SECOND) == []
    assert lifecycle.advance(SECOND, StartRequested("environment")) == started("environment")


@pytest.mark.parametrize("status", [0, -15, 1])
def test_the_end_of_the_run_while_a_node_stops_on_request_is_no_failure(status: int) -> None:
    lifecycle = running()
    lifecycle.advance(500, StopRequested("environment"))
    assert lifecycle.advance(501, Interrupted()) == [Terminate("device")]
    assert lifecycle.advance(502, Ended("environment", status)) == []
    assert lifecycle.advance(503, Ended("device", 0)) == [Terminate("controller")]
    assert lifecycle.advance(504, Ended("controller", 0)) == [Terminate("recorder")]
    assert lifecycle.advance(505, Ended("recorder", 0)) == []
    assert lifecycle.failure is None
    assert lifecycle.phase is Phase.OVER


def test_a_request_that_cannot_be_met_changes_nothing_and_says_why() -> None:
    lifecycle = Lifecycle(NODES[1:], None, 0, LIMITS)  # its environment is somewhere else
    for node, reason in {
        "device": "a run ends without its device",
        "recorder": "a run ends without its recorder",
        "environment": "does not run its environment; it runs controller, device, recorder",
        "dashboard": "no node 'dashboard' in this graph; its nodes are controller, device",
        "controller": "the run is starting; nodes stop and start only while it is running",
    }.items():
        assert reason in (lifecycle.refusal(node) or "")
        assert lifecycle.advance(1, StopRequested(node)) == []
        assert lifecycle.advance(1, StartRequested(node)) == []
    assert lifecycle.phase is Phase.STARTING
    assert running().refusal("controller") is None


@pytest.mark.parametrize(
    ("status", "words"), [(0, "exit status 0"), (-9, "signal SIGKILL"), (-99, "signal 99")]
)
def test_an_exit_status_is_told_in_words(status: int, words: str) -> None:
    assert describe_status(status) == words


# An environment on another machine

REMOTE_TOPICS = ("environment_reply", "force_command")
LOCAL = ("controller", "device", "recorder")


def waiting_for_afar() -> tuple[Lifecycle, list[Action]]:
    """A run whose own processes are ready but for what an environment far away brings."""
    lifecycle = Lifecycle(LOCAL, 1000, 0, LIMITS, REMOTE_TOPICS)
    lifecycle.advance(1, Reported("recorder", REMOTE_TOPICS))
    lifecycle.advance(2, Reported("device", ("force_command",)))
    return lifecycle, lifecycle.advance(3, Reported("controller", ("environment_reply",)))


def test_a_graph_waits_for_a_remote_environment_as_long_as_it_takes_and_says_so_once() -> None:
    lifecycle, actions = waiting_for_afar()
    (told,) = actions
    assert isinstance(told, Announce)
    assert told.event == "environment_awaited"
    assert not told.is_fault
    assert lifecycle.deadline_ns is None
    assert lifecycle.advance(10**12, Reported("device", ("force_command",))) == []
    for node in LOCAL:
        actions = lifecycle.advance(10**12, Reported(node, ()))
    assert actions == [Engage()]


def test_what_is_missing_on_this_machine_is_not_waited_for_without_end() -> None:
    lifecycle = Lifecycle(LOCAL, 1000, 0, LIMITS, REMOTE_TOPICS)
    lifecycle.advance(1, Reported("controller", ("environment_reply", "device_state")))
    lifecycle.advance(2, Reported("device", ("force_command",)))
    lifecycle.advance(3, Reported("recorder", ()))
    assert lifecycle.advance(100, None) == [Terminate("device")]
    assert lifecycle.failure is not None


def test_a_graph_that_waits_for_a_remote_environment_can_be_interrupted() -> None:
    lifecycle, _ = waiting_for_afar()
    assert lifecycle.advance(4, Interrupted()) == [Terminate("device")]
