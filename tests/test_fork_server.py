"""Fork servers: what they fork are processes as any, and nobody's end leaves one behind."""

import os
import signal
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import pytest
from live_graph import PROCESSES_OF_THEIR_OWN, live_graph

import forcebound as fb
from forcebound.errors import ConfigError
from forcebound.run.fork_server import PROGRAM, fork_server

pytestmark = PROCESSES_OF_THEIR_OWN


def server_of(launcher: int) -> int:
    """The fork server of a launcher, which is its child."""
    for folder in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            parent = folder.joinpath("stat").read_text().rpartition(")")[2].split()[1]
            name = folder.joinpath("comm").read_text()
            if int(parent) == launcher and name == "fb server\n":
                return int(folder.name)
    raise AssertionError("there is no fork server")


def test_a_forked_process_gives_output_and_status_as_one_that_was_started() -> None:
    with fork_server() as server:
        shown, refused, killed = (
            server.start([*PROGRAM, *words], own_session=True)
            for words in (["--version"], ["launch", "nothing"], ["view", "--wait", "--no-open"])
        )
        assert len(os.listdir(f"/proc/{server.pid}/task")) == 1
        for process in (shown, refused, killed):
            status = Path(f"/proc/{process.pid}/status").read_text()
            assert f"PPid:\t{os.getpid()}\n" in status
        assert shown.stdout
        assert refused.stdout
        assert shown.stdout.read().startswith(b"forcebound, version")
        assert shown.wait(10.0) == 0
        assert b"no launch file" in refused.stdout.read()
        assert refused.wait(10.0) == 2
        with pytest.raises(subprocess.TimeoutExpired):
            killed.wait(0.1)
        killed.kill()
        assert killed.wait(10.0) == -signal.SIGKILL
        for process in (shown, refused, killed):
            if process.stdout:
                process.stdout.close()


def test_a_server_that_has_ended_starts_nothing() -> None:
    with fork_server() as server:
        os.kill(server.pid, signal.SIGKILL)
        with pytest.raises(OSError):  # noqa: PT011  # one of several
            server.start([*PROGRAM, "--version"], own_session=True)


def test_a_graph_goes_on_without_its_server_and_a_node_starts_by_itself() -> None:
    with live_graph("stiff_wall") as graph:
        os.kill(server_of(graph.process.pid), signal.SIGKILL)
        graph.signal("environment", signal.SIGKILL)
        graph.until(lambda: graph.node("environment").restarts == 1, "a restart")
        graph.wait_until_in_contact()
        assert "starts by itself" in graph.log


def test_two_launches_of_a_program_have_the_force_and_a_wrong_one_says_why() -> None:
    for _ in range(2):
        with fb.launch("stiff_wall") as graph:
            graph.wait(0.3)
            assert graph.figures().peak_force > 0.0
    with pytest.raises(ConfigError, match="no launch file"):
        fb.launch("nothing")


PROGRAM_WITH_GRAPH = """
import os, signal, sys
import forcebound as fb
with fb.launch("stiff_wall") as graph:
    graph.wait(0.2)
    print(os.getpid(), flush=True)
    sys.stdin.read()
"""


@pytest.mark.parametrize("victim", ["program", "server"])
def test_the_end_of_a_program_ends_its_graph(victim: str, tmp_path: Path) -> None:
    with subprocess.Popen(
        [sys.executable, "-c", PROGRAM_WITH_GRAPH],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "TMPDIR": str(tmp_path)},  # its recording stays there
    ) as program:
        assert program.stdout is not None
        pid = int(program.stdout.readline())
        if victim == "server":
            os.kill(server_of(pid), signal.SIGKILL)
            assert program.poll() is None
        program.kill()
