"""The doctor with live graphs: healthy, with a suspended node, with a link that loses everything.

How punctual a graph is depends on the machine that runs the tests, so findings that are of nothing
but time are not looked at.
"""

import json
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from live_graph import PROCESSES_OF_THEIR_OWN, LiveGraph, live_graph
from waiting import TIMEOUT

pytestmark = PROCESSES_OF_THEIR_OWN

OF_TIME = {
    "ticks_lost",
    "late_loop",
    "delay_near_age_limit",
    "force_gaps",
    "rejected_too_old",
    "no_answer",
}


@pytest.fixture
def calm(tmp_path: Path) -> str:
    """A graph that leaves the other tests their share of the machine."""
    file = tmp_path / "calm.yaml"
    text = "forcebound: 1\ninclude: stiff_wall.yaml\nrealtime: {policy: other}\n"
    file.write_text(f"{text}device: {{rate: 500 Hz}}\n")
    return str(file)


def examine(graph: LiveGraph) -> tuple[int, dict[str, dict[str, Any]]]:
    """Return the exit status of ``forcebound doctor``, and what it found by kind."""
    done = graph.order("doctor", "--run", str(graph.run_dir), "--json")
    assert done.stderr == ""
    document = json.loads(done.stdout)
    assert document["graph"] == str(graph.run_dir.resolve())
    assert document["is_well"] == (done.exit_code == 0)
    return done.exit_code, {finding["kind"]: finding for finding in document["findings"]}


def problems(found: dict[str, dict[str, Any]]) -> set[str]:
    return {kind for kind, finding in found.items() if finding["severity"] == "problem"}


def test_a_healthy_graph_then_a_suspended_environment_then_a_link_that_loses_all(
    calm: str,
) -> None:
    with live_graph(calm) as graph:
        status, found = examine(graph)
        assert problems(found) <= OF_TIME
        assert status == (1 if problems(found) else 0)

        pid = graph.pid("environment")
        graph.signal("environment", signal.SIGSTOP)
        graph.wait_until_released()
        status, found = examine(graph)
        assert status == 1
        assert problems(found) - OF_TIME == {"suspended", "no_force"}
        assert found["suspended"]["where"] == "environment"
        assert found["suspended"]["commands"] == [f"kill -CONT {pid}"]
        graph.signal("environment", signal.SIGCONT)
        graph.wait_until_in_contact()

        graph.do("param", "set", "links.environment_query.loss:=1")
        graph.wait_until_released()
        status, found = examine(graph)
        assert status == 1
        assert problems(found) - OF_TIME == {"hop_broken", "no_force"}
        assert found["hop_broken"]["where"] == "link environment_query"
        assert found["hop_broken"]["causes"] == ["injected_loss"]

        graph.do("param", "set", "links.environment_query.loss:=0")
        graph.wait_until_in_contact()
        graph.do("stop", "environment")
        done = graph.order("doctor", "--run", str(graph.run_dir))
        assert done.exit_code == 1
        assert "problem  environment: is stopped on request" in done.stdout
        assert "-> forcebound start environment" in done.stdout
        assert graph.end().exit_status == 0


def test_a_directory_of_no_graph_is_an_input_error(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "forcebound", "doctor", "--run", str(tmp_path)],
        capture_output=True,
        text=True,
        timeout=TIMEOUT,
        check=False,
    )
    assert done.returncode == 2
    assert "is not the run directory of a running graph" in done.stderr
