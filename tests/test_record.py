"""Recording a graph that runs already, from the command line."""

import json
import signal
import subprocess
import sys
from pathlib import Path
from typing import cast

import numpy as np
import pytest
from click.testing import CliRunner
from launch_texts import written
from live_graph import SURFACE, LiveGraph, live_graph
from waiting import TIMEOUT

from forcebound.cli import main
from forcebound.graph.loader import load
from forcebound.haptics.hands.paths import TrajectoryHand
from forcebound.lab.replay import duration_of, graph_of
from forcebound.messages.events import PARAMETERS_SET
from forcebound.messages.packets import EnvironmentQuery, EnvironmentReply, Event
from forcebound.observe.recorder import free_name
from forcebound.recordings.recording import Recorder, Recording, read
from forcebound.results.surface import stiffness_of_run
from forcebound.run.results import RunResult
from forcebound.run.run_directory import RunDocument
from forcebound.run.virtual import run_virtual


def test_a_new_recording_has_a_name_of_its_own(tmp_path: Path) -> None:
    RunDocument(0, None, "", [], file="launch/stiff_wall.yaml law:=none").write(tmp_path)
    names = set()
    for _ in range(3):
        name = free_name(tmp_path, tmp_path)
        name.touch()
        names.add(name)
    assert len(names) == 3
    assert all(name.name.startswith("stiff_wall-") and name.suffix == ".mcap" for name in names)


def test_any_hand_of_a_later_recording_is_followed_from_its_beginning(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    hand = load("stiff_wall").only.operator
    run_virtual(load("stiff_wall"), 0.3, path)
    whole = read(path)
    later = whole.packets("telemetry")[100:]
    with Recorder(path, whole.metadata) as recorder:
        for packet in later:
            recorder.write(packet)
    part = read(path)
    config = graph_of(part, feeds=("hand",))
    assert hand is not None
    assert isinstance(config.only.operator, TrajectoryHand)
    then = 0.1 + part.telemetry.elapsed[0]
    assert config.only.operator.target(0.1)[0] == pytest.approx(hand.target(then)[0], abs=1e-4)
    assert duration_of(part, config) == pytest.approx(0.2, abs=2e-3)


PHASED = (
    """\
forcebound: 1
include: stiff_wall.yaml
phases:
"""
    + 100
    * """\
  - {name: hard, duration: 0.5 s}
  - {name: soft, duration: 0.5 s, set: {environment.stiffness: 8 N/mm}}
"""
)


def interrupted(graph: LiveGraph, file: Path) -> tuple[int, str]:
    """Exit status and output of a recording that Ctrl-C ends once it has begun."""
    command = [sys.executable, "-u", "-m", "forcebound", "record", "phased", "-o", str(file)]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdout=pipe, stderr=subprocess.STDOUT, text=True) as process:
        assert process.stdout is not None
        begun = process.stdout.readline()
        change = "changed: environment.stiffness"
        before = graph.log.count(change)
        graph.until(lambda: graph.log.count(change) > before + 2, "three changes by phases")
        process.send_signal(signal.SIGINT)
        out, _ = process.communicate(timeout=TIMEOUT)
    return process.returncode, begun + out


def check_environments(recording: Recording) -> None:
    """Check that the figures know the stiffness with which the environment answered each query.

    From its first word on: before, it may still be about to read what the launcher has written.
    """
    events = cast("list[Event]", recording.packets("event"))
    columns = recording.telemetry
    known = stiffness_of_run(columns, events, recording.launch)
    assert known is not None
    queries = cast("list[EnvironmentQuery]", recording.packets("environment_query"))
    where = {query.seq: query.position[0] for query in queries}
    first_ns = min(event.time_ns for event in events if event.event == PARAMETERS_SET)
    felt = set()
    for reply in cast("list[EnvironmentReply]", recording.packets("environment_reply")):
        depth = where.get(reply.query_seq, 0.0) - SURFACE
        if depth > 0.0 and reply.time_ns > first_ns:
            after = int(np.searchsorted(columns.time_ns[:-1], reply.time_ns))
            stiffness = reply.force[0] / depth
            assert stiffness == pytest.approx(known[after], rel=1e-6) or stiffness == pytest.approx(
                known[max(after - 1, 0)], rel=1e-6
            )
            felt.add(round(stiffness))
    assert felt == {8_000, 10_000}


def check_full_disk(file: Path) -> None:
    """Check that a recording that cannot go on ends, says so, and keeps what came before."""
    limited = f"ulimit -f 64; exec {sys.executable} -m forcebound record phased -o {file}"
    done = subprocess.run(
        ["bash", "-c", limited], capture_output=True, text=True, timeout=TIMEOUT, check=False
    )
    assert done.returncode == 1
    assert f"recording stopped: File too large; {file} has what came before" in done.stderr
    assert not read(file).complete


@pytest.mark.live
@pytest.mark.xdist_group("processes")
def test_a_part_of_a_run_is_recorded_while_it_goes_on(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    launched = str(written(tmp_path, PHASED, "phased.yaml"))
    with live_graph(launched) as graph:
        monkeypatch.setenv("XDG_RUNTIME_DIR", str(graph.runtime))
        file = graph.folder / "part.mcap"
        graph.do("param", "set", "device.law:=none")
        status, said = interrupted(graph, file)
        assert status == 0
        assert said.startswith(f"recording {launched} to {file}")
        assert said.endswith(f"ticks: {file}\n")
        assert "Traceback" not in said
        part = read(file)
        check_environments(part)
        assert part.launch["device"]["law"] == "none"
        assert part.energy_before != 0.0  # the hand was in the wall, under another law
        since_law = RunResult.from_recording(file).columns.true_energy
        assert (since_law == part.telemetry.true_energy - part.energy_before).all()
        kinds = [event.event for event in cast("list[Event]", part.packets("event"))]
        assert "phase" in kinds
        assert "law_changed" not in kinds  # a phase leaves the law as it is

        refused = CliRunner().invoke(main, ["record", "-o", str(file)])
        assert refused.exit_code == 2
        assert "exists: choose another name, or add --overwrite" in refused.output
        done = graph.order(
            "record", "phased", "-o", str(file), "--overwrite", "--duration", "300ms", "--json"
        )
        told = json.loads(done.stdout)
        assert told["ended"] == "duration"
        assert told["graph"] == launched
        recording = read(file)
        assert recording.complete
        assert len(recording.packets("telemetry")) == told["packets"]["telemetry"]
        assert recording.telemetry.elapsed[0] > 0.0  # it began later than the run
        cannot = CliRunner().invoke(main, ["replay", str(file), "--verify"])
        assert cannot.exit_code == 2
        assert "no other ledger begins in it (a new law)" in cannot.output
        check_full_disk(graph.folder / "full.mcap")
        with_end = graph.folder / "end.mcap"
        words = ["record", "phased", "-o", str(with_end), "--json"]
        command = [sys.executable, "-m", "forcebound", *words]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
            graph.until(
                lambda: with_end.exists() and with_end.stat().st_size > 100_000, "some ticks"
            )
            graph.end()
            out, _ = process.communicate(timeout=TIMEOUT)
        assert process.returncode == 0
        assert json.loads(out)["ended"] == "graph ended"
        recording = read(with_end)
        assert recording.complete
        assert not recording.telemetry.applied_force[-1].any()  # it has the end of the run
