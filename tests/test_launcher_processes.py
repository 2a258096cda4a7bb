"""The launcher as a process of its own: killed, interrupted, robbed of its nodes."""

import json
import os
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest
from addresses import LAUNCHERS
from live_graph import PROCESSES_OF_THEIR_OWN, LiveGraph, is_alive, live_graph
from waiting import until

from forcebound.lab.replay import device_of
from forcebound.lab.verification import verify
from forcebound.recordings.recording import read

pytestmark = PROCESSES_OF_THEIR_OWN


@pytest.fixture
def graph() -> Iterator[LiveGraph]:
    with live_graph("stiff_wall.yaml", prefix=()) as graph:  # as the command does
        yield graph


def pids_of(graph: LiveGraph) -> dict[str, int]:
    pids = {name: graph.pid(name) for name in graph.status().nodes}
    assert set(pids) == {"environment", "controller", "device", "recorder"}
    return pids


def run_dirs(graph: LiveGraph) -> list[Path]:
    return list(graph.runtime.glob("forcebound-*"))


def check_last_force(graph: LiveGraph) -> None:
    """Check that force was given, and that the last one recorded is zero."""
    force = read(graph.record).telemetry.applied_force
    assert force.any()
    assert not force[-1].any()


def test_nothing_survives_a_launcher_that_is_killed(graph: LiveGraph) -> None:
    pids = pids_of(graph)
    graph.process.kill()
    until(lambda: not any(map(is_alive, pids.values())), "the processes to be gone")
    until(lambda: run_dirs(graph) == [], "the run directory to be gone")
    check_last_force(graph)
    recording = read(graph.record)
    assert recording.complete
    assert verify(recording, device_of(recording)).is_same  # its forces follow from its inputs


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupt_ends_the_run_with_zero_force_and_a_result(
    graph: LiveGraph, number: int
) -> None:
    pids = pids_of(graph)
    graph.process.send_signal(number)
    status, out = graph.outcome()
    assert status == 0, graph.log
    assert json.loads(out)["samples"] > 0
    check_last_force(graph)
    assert not any(map(is_alive, pids.values()))
    assert run_dirs(graph) == []


@pytest.mark.parametrize("is_killed", [False, True])
def test_a_suspended_recorder_ends_with_the_run_and_completes_its_file(
    graph: LiveGraph, is_killed: bool
) -> None:
    pids = pids_of(graph)
    os.kill(pids["recorder"], signal.SIGSTOP)
    graph.wait(0.5)
    graph.process.send_signal(signal.SIGKILL if is_killed else signal.SIGINT)
    status, _ = graph.outcome()
    assert status == (-signal.SIGKILL if is_killed else 0), graph.log
    until(lambda: not any(map(is_alive, pids.values())), "the processes to be gone")
    until(lambda: run_dirs(graph) == [], "the run directory to be gone")
    assert read(graph.record).complete


def test_a_signal_while_the_result_is_computed_leaves_nothing(graph: LiveGraph) -> None:
    graph.process.send_signal(signal.SIGINT)
    until(lambda: not list(graph.runtime.glob(LAUNCHERS)), "the end of the run")
    graph.process.send_signal(signal.SIGTERM)
    status, _ = graph.outcome()
    assert status in (0, 130), graph.log  # 0: it was done already
    assert "Traceback" not in graph.log
    assert run_dirs(graph) == []
    assert read(graph.record).complete


@pytest.mark.parametrize("victim", ["device", "recorder"])
def test_a_device_or_recorder_that_dies_ends_the_run_and_is_named(
    graph: LiveGraph, victim: str
) -> None:
    pids = pids_of(graph)
    os.kill(pids[victim], signal.SIGKILL)
    status, out = graph.outcome()
    assert status == 1
    assert f"{victim} ended unexpectedly, with signal SIGKILL" in graph.log
    assert "Traceback" not in graph.log
    assert not any(map(is_alive, pids.values()))
    assert run_dirs(graph) == []
    if victim == "device":
        assert json.loads(out)["samples"] > 0
        assert read(graph.record).complete
