"""The supervisor's decisions: histories of events and actions, without processes."""

import signal

import pytest
from run_starts import LIMITS, NODES, READY, RUNNING, Step

from forcebound.run.actions import (
    Action,
    Announce,
    Ended,
    Engage,
    Engaged,
    Interrupted,
    Kill,
    Reported,
    RunPhase,
    Terminate,
    describe_status,
)
from forcebound.run.lifecycle import Lifecycle

STOPPED: list[Step] = [
    (1010, Ended("device", 0), [Terminate("controller"), Terminate("environment")]),
    (1011, Ended("environment", 0), []),
    (1012, Ended("controller", 0), [Terminate("recorder")]),
    (1013, Ended("recorder", 0), []),
]

HISTORIES: dict[str, tuple[list[Step], str | None]] = {
    "a run of its full duration": (
        [*RUNNING, (1002, None, []), (1003, None, [Terminate("device")]), *STOPPED],
        None,
    ),
    "an interrupt stops in order": (
        [*RUNNING, (500, Interrupted(), [Terminate("device")]), *STOPPED],
        None,
    ),
    "an interrupt after the planned end kills nobody": (
        [
            *RUNNING,
            (1002, None, []),
            (1003, None, [Terminate("device")]),
            (1004, Interrupted(), []),
            *STOPPED,
        ],
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
            (4, Engaged("device"), []),
            (100, None, [Terminate("device")]),
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
    "only the first failure is reported": (
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
    "a recorder that answers still writes what came": (
        [
            *RUNNING,
            (1003, None, [Terminate("device")]),
            *STOPPED[:-1],
            (1060, READY[-1], []),
            (1109, None, []),
            (1110, None, [Kill("recorder")]),
            (1113, Ended("recorder", -9), []),
        ],
        "recorder did not stop in time and was killed",
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
        assert lifecycle.phase is RunPhase.OVER
        assert lifecycle.deadline_ns is None
    else:
        assert lifecycle.phase is RunPhase.STOPPING


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
    assert lifecycle.phase is RunPhase.OVER
    assert lifecycle.failure is None


def test_the_force_engages_once() -> None:
    lifecycle = Lifecycle(("device",), None, 0, LIMITS)
    assert lifecycle.advance(1, Reported("device", ())) == [Engage("device")]
    assert lifecycle.advance(2, Reported("device", ())) == []
    lifecycle.advance(3, Engaged("device"))
    assert lifecycle.advance(4, Engaged("device")) == []
    assert lifecycle.advance(5, Reported("device", ())) == []


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
    assert actions == [Engage("device")]
    lifecycle, _ = waiting_for_afar()
    assert lifecycle.advance(4, Interrupted()) == [Terminate("device")]


def test_what_is_missing_on_this_machine_is_not_waited_for_without_end() -> None:
    lifecycle = Lifecycle(LOCAL, 1000, 0, LIMITS, REMOTE_TOPICS)
    lifecycle.advance(1, Reported("controller", ("environment_reply", "device_state")))
    lifecycle.advance(2, Reported("device", ("force_command",)))
    lifecycle.advance(3, Reported("recorder", ()))
    assert lifecycle.advance(100, None) == [Terminate("device")]
    assert lifecycle.failure is not None


@pytest.mark.parametrize("starved", ["controller", "recorder"])
def test_the_rate_is_suspected_only_where_the_loop_is_starved(starved: str) -> None:
    lifecycle = Lifecycle(NODES, 1000, 0, LIMITS)
    for node in NODES:
        lifecycle.advance(1, Reported(node, ("telemetry",) if node == starved else ()))
    lifecycle.advance(100, None)
    assert lifecycle.failure is not None
    assert ("rate of the device" in lifecycle.failure.message) == (starved == "controller")
