"""A device that is lost and returns: only when the user says so, and with a force that is new."""

import math
import signal
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from addresses import LAUNCHER_SOCKET
from builders import telemetry_packet
from live_graph import LiveGraph, live_graph
from run_starts import running
from test_emulators_live import program
from waiting import until

from forcebound.errors import RunError
from forcebound.haptics.devices.truth_file import SUFFIX, TruthFile
from forcebound.messages.control import ResumeDevice
from forcebound.messages.packets import Telemetry
from forcebound.observe.control import resume_device
from forcebound.recordings.telemetry import TelemetryColumns
from forcebound.roles import LOST
from forcebound.run.actions import (
    Announce,
    Ended,
    Engage,
    Engaged,
    Interrupted,
    Reported,
    RunPhase,
    Start,
    Terminate,
)
from forcebound.run.lifecycle import ADVICE, resume_command

HOME = (0.0, -0.0693)  # m, of the tip
NEAR = 2e-3  # m; friction keeps a hand from its aim

ADVISED = Announce("device_lost", "device", ADVICE.format(resume_command("hand")), is_fault=True)
STARTED = Announce("process_started", "device", "device was restarted")


def test_a_lost_device_waits_for_the_word_and_engages_again() -> None:
    lifecycle = running()
    assert lifecycle.advance(499, ResumeDevice()) == []
    assert lifecycle.advance(500, Ended("device", LOST)) == [ADVISED]
    assert (lifecycle.phase, lifecycle.state("device")) == (RunPhase.RUNNING, "lost")
    assert lifecycle.advance(600) == []
    assert lifecycle.advance(700, ResumeDevice()) == [Start("device"), STARTED]
    assert lifecycle.restarts.counts == {"device": 1}
    assert lifecycle.advance(701, Reported("device", ("force_command",))) == []
    assert lifecycle.returning
    assert not lifecycle.engaging
    assert lifecycle.advance(702, Reported("device", ())) == [Engage("device")]
    assert lifecycle.engaging
    assert lifecycle.advance(703, Engaged("device")) == []
    assert not lifecycle.returning
    assert lifecycle.state("device") == "running"


def test_a_device_that_cannot_be_opened_again_is_lost_again() -> None:
    lifecycle = running()
    lifecycle.advance(500, Ended("device", LOST))
    lifecycle.advance(501, ResumeDevice())
    assert lifecycle.advance(502, Ended("device", LOST)) == [ADVISED]
    actions = lifecycle.advance(503, Interrupted())
    assert actions == [Terminate("controller"), Terminate("environment")]


def test_a_device_that_was_killed_or_crashed_ends_the_run() -> None:
    for status in (-signal.SIGKILL, 1):
        lifecycle = running()
        lifecycle.advance(500, Ended("device", status))
        assert lifecycle.phase is RunPhase.STOPPING
        assert lifecycle.failure is not None


def test_counts_go_on_when_a_device_returns() -> None:
    def packet(seq: int, time_ns: int, engagement: float, misses: int) -> Telemetry:
        return telemetry_packet(
            seq,
            time_ns=time_ns,
            elapsed=seq * 1e-9,
            engagement=engagement,
            device_seq=seq - 1 if seq else None,
            deadline_misses=misses,
            rejected={"too_old": misses},
        )

    lives = [(0, 0, 0.0, 0), (1, 10, 1.0, 3), (0, 50, 0.0, 0), (1, 60, 1.0, 2), (0, 90, 1.0, 0)]
    columns = TelemetryColumns.from_packets([packet(*life) for life in lives])
    assert columns.seq.tolist() == [0, 1, 2, 3, 4]
    assert columns.device_seq.tolist() == [-1, 0, -1, 2, -1]
    assert columns.deadline_misses.tolist() == [0, 3, 3, 5, 5]
    assert columns.rejected == {"too_old": 5}
    assert columns.elapsed == pytest.approx([0.0, 1e-9, 41e-9, 51e-9, 81e-9])


def wait_for_loss(graph: LiveGraph) -> None:
    graph.until(lambda: graph.node("device").state == "lost", "the loss")


def put_home(link: Path) -> None:
    """Wait for the emulated hand to have the arm in its home pose, as a user would hold it."""
    truth = TruthFile(Path(f"{link}{SUFFIX}"))

    def is_home() -> bool:
        found = truth.look()
        return found is not None and math.dist(found.truth.position, HOME) < NEAR

    until(is_home, "the home pose")
    truth.close()


def wait_for_force(graph: LiveGraph) -> None:
    graph.wait_for_telemetry(lambda t: t.engagement == 1.0, "an engaged force")


@pytest.mark.live
@pytest.mark.xdist_group("processes")
def test_a_live_graph_goes_on_after_a_spoiled_reply_a_silence_and_a_pulled_plug(
    tmp_path: Path,
) -> None:
    link = tmp_path / "board"
    # Half of the limit is how long a board may be silent, such as that of a busy machine.
    words = (f"device:={link}", "on_loss:=wait", "watchdog_limit:=4 s")
    with live_graph_at(link, words) as (graph, board):
        wait_for_loss(graph)
        put_home(link)
        graph.do("device", "resume")
        wait_for_force(graph)
        board.send_signal(signal.SIGSTOP)
        wait_for_loss(graph)
        board.kill()
        with pytest.raises(RunError, match="still lost"):
            resume_device(graph.run_dir)  # as the command does
        with program(link):
            until(link.exists, "the port")
            resume_device(graph.run_dir)
            wait_for_force(graph)
            ended = graph.end()
            recorded = ended.recording.packets("telemetry")
    assert ended.exit_status == 0
    assert ended.faults["device_lost"] == 3
    packets = [packet for packet in recorded if isinstance(packet, Telemetry)]
    begins = [after for before, after in pairwise(packets) if after.seq < before.seq]
    assert len(begins) == 2
    for begin in begins:
        assert begin.engagement == 0.0
        assert not any(begin.applied_force)
    assert np.nanmin(ended.columns.true_energy) >= 0.0  # unknown where it was just written


@contextmanager
def live_graph_at(
    link: Path, words: tuple[str, ...]
) -> Iterator[tuple[LiveGraph, "subprocess.Popen[str]"]]:
    """Start a board whose first fault is a reply cut short, and a graph on it."""
    with program(link, "--fault", "short") as board:
        until(link.exists, "the port")
        with live_graph("haply_2diy", *words, is_alone=False) as graph:
            graph.until(lambda: list(graph.runtime.glob(f"*/{LAUNCHER_SOCKET}")), "the launcher")
            yield graph, board
