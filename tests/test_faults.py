"""Faults against live processes, in hard contact, judged by the simulated device's ground truth."""

import os
import resource
import signal
import time

import pytest
from live_graph import (
    AGE_LIMIT,
    PROCESSES_OF_THEIR_OWN,
    Ended,
    check_always,
    check_return,
    check_silence,
    live_graph,
)

from forcebound.messages.control import ProcessState

pytestmark = PROCESSES_OF_THEIR_OWN


def check_survived(ended: Ended, harm_ns: int) -> int:
    """Check what every fault has in common; return when the device had an answer again, in ns."""
    assert ended.exit_status == 0, ended.log
    columns = ended.columns
    check_always(columns)
    gap = check_silence(columns, harm_ns)
    check_return(columns, gap)
    assert ended.faults["force_released"] >= 1
    assert "no answer younger than the age limit of 100 ms: zero force" in ended.log
    return int(columns.time_ns[gap[-1] + 1])


@pytest.mark.parametrize("victim", ["environment", "controller"])
def test_a_node_killed_in_contact_is_restarted_and_the_force_returns(victim: str) -> None:
    with live_graph("stiff_wall.yaml") as graph:
        graph.signal(victim, signal.SIGKILL)
        harm_ns = time.monotonic_ns()
        graph.until(lambda: graph.node(victim).restarts == 1, "its successor")
        graph.wait(2 * AGE_LIMIT)
        graph.wait_until_in_contact()
        ended = graph.end()
    if victim == "environment" or "force_released" in ended.faults:
        check_survived(ended, harm_ns)
    else:  # a second controller has answered within the age limit
        check_always(ended.columns)
    assert ended.faults["process_ended"] == 1
    [death] = ended.events("process_ended")
    if victim == "environment":
        losses = ended.events("environment_lost")
        assert losses
        for lost in [loss for loss in losses if loss.time_ns > death.time_ns][:1]:
            assert "is gone" in lost.message  # the launcher has said so: no lease has to run out
    assert death.node == "launcher"
    assert death.data == {"node": victim, "status": "signal SIGKILL"}
    [start] = ended.events("process_started")
    assert not start.is_fault
    assert f"{victim} ended unexpectedly, with signal SIGKILL" in ended.log
    assert f"{victim} was restarted" in ended.log


@pytest.mark.parametrize("victim", ["environment", "controller"])
def test_a_node_that_stands_still_for_two_seconds_leaves_no_force(victim: str) -> None:
    with live_graph("stiff_wall.yaml") as graph:
        graph.signal(victim, signal.SIGSTOP)
        harm_ns = time.monotonic_ns()
        graph.wait(2.0)
        continued_ns = time.monotonic_ns()
        graph.signal(victim, signal.SIGCONT)
        graph.wait_until_in_contact()
        assert graph.node(victim).restarts == 0
        ended = graph.end()
    assert check_survived(ended, harm_ns) > continued_ns
    assert "process_ended" not in ended.faults
    if victim == "environment":
        assert ended.faults["environment_lost"] >= 1


def test_an_environment_leaves_and_comes_back_by_command() -> None:
    with live_graph("stiff_wall.yaml") as graph:
        run = ("--run", str(graph.run_dir))
        for words, reason in {
            ("stop", "device"): "a run ends without its device",
            ("start", "wall"): "no node 'wall' in this graph; its nodes are",
        }.items():
            refused = graph.order(*words, *run)
            assert refused.exit_code == 2
            assert reason in refused.stderr
        graph.do("stop", "environment")
        harm_ns = time.monotonic_ns()
        assert graph.node("environment") == ProcessState("stopped")
        graph.wait(1.5)  # longer than the lease, and than any back-off of a first restart
        assert graph.node("environment").state == "stopped"
        graph.do("start", "environment")
        graph.wait_until_in_contact()
        ended = graph.end()
    check_survived(ended, harm_ns)
    assert ended.faults["environment_lost"] >= 1
    assert "process_ended" not in ended.faults
    [end] = ended.events("process_ended")
    assert end.data == {"node": "environment", "status": "exit status 0"}
    assert "environment stopped on request" in ended.log
    assert len(ended.served) == 2


def test_a_launcher_that_hangs_harms_nobody_and_makes_up_for_it_afterwards() -> None:
    with live_graph("stiff_wall.yaml") as graph:
        environment = graph.pid("environment")
        graph.process.send_signal(signal.SIGSTOP)
        graph.wait(0.5)
        os.kill(environment, signal.SIGKILL)
        harm_ns = time.monotonic_ns()
        graph.wait_until_released()
        graph.process.send_signal(signal.SIGCONT)
        graph.wait_until_in_contact()
        assert graph.node("environment").restarts == 1
        ended = graph.end()
    check_survived(ended, harm_ns)
    assert ended.faults["process_ended"] == 1


def test_a_recorder_that_cannot_write_leaves_a_result_that_says_so() -> None:
    with live_graph("stiff_wall.yaml") as graph:
        graph.until(lambda: graph.record.stat().st_size > 50_000, "something to save")
        # As a disk that is full from now on, but for this process alone.
        size = graph.record.stat().st_size + 20_000
        resource.prlimit(graph.pid("recorder"), resource.RLIMIT_FSIZE, (size, size))
        graph.until(lambda: "recording stopped" in graph.log, "the recorder to say so")
        graph.wait_until_in_contact()
        ended = graph.end()
    assert ended.exit_status == 0, ended.log
    assert ended.faults["recording_incomplete"] == 1
    assert ended.summary["samples"] > 0
    assert not ended.recording.complete
    assert "recording stopped: File too large; the run continues" in ended.log
    assert f"recording incomplete: using the readable part of {graph.record}" in ended.log
    assert ended.columns.true_energy.min() >= -1e-9
