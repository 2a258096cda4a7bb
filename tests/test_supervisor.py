"""The supervisor with a few real processes; ``test_lifecycle.py`` tests its decisions.

No test decides by timing: each waits for something in bounded time and fails if it never comes.
"""

import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from live_graph import children_of
from waiting import TIMEOUT, until

from forcebound.errors import ConfigError, RunError
from forcebound.graph.loader import load
from forcebound.messages.control import Configure, ConfigureNode, Engage, GetStatus, ProcessState
from forcebound.messages.topology import ONE_HAND
from forcebound.network import sockets
from forcebound.observe import control
from forcebound.observe.control import ask_launcher, start_node, stop_node
from forcebound.run.actions import TimeLimits
from forcebound.run.live import run_live
from forcebound.run.screen import Screen
from forcebound.run.supervisor import Supervisor

NODES = ("environment", "controller", "device", "recorder")

FAKE_NODE = """
import os, signal, sys
from forcebound.network import sockets
from forcebound.network.sockets import Network
from forcebound.messages.control import *
from forcebound.messages.topology import ONE_HAND, endpoint
REQUESTS = (*OF_NODES, Engage, EnvironmentDied)
name, run_dir, mode = sys.argv[1:]
if mode == "starts no more" and os.path.exists(f"{run_dir}/engaged"):
    signal.pause()
with Network() as network:
    address = endpoint(run_dir, ONE_HAND.nodes[name])
    server = network.control_server(address, REQUESTS)
    if mode == "stubborn":
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
    else:
        signal.signal(signal.SIGTERM, lambda number, frame: os._exit(0))
    print(name, "is there", flush=True)
    def answer(request):
        if isinstance(request, Engage):
            open(f"{run_dir}/engaged", "w").close()
            return Engaged()
        return NodeStatus(received={"device_state": int(mode != "deaf")})
    while True:
        sockets.wait([server.descriptor], 20_000_000)
        server.serve(answer)
        is_engaged = os.path.exists(f"{run_dir}/engaged")
        if mode == "dies" or (mode in ("dies later", "starts no more") and is_engaged):
            sys.stderr.write("out of order\\n")
            sys.exit(3)
"""

PATIENT = TimeLimits(*[round(TIMEOUT * 1e9)] * 5)


SILENT = """import sys
from dataclasses import dataclass
from forcebound.haptics.environments import StatelessEnvironment

@dataclass(frozen=True)
class Silent(StatelessEnvironment):
    def force(self, user, position, velocity, elapsed):
        if "node" in sys.argv:
            raise ValueError("not in a graph")
        return tuple(0.0 for _ in position)
"""


@pytest.fixture(autouse=True)
def no_child_is_left() -> Iterator[None]:
    before = children_of(os.getpid())
    cores = os.sched_getaffinity(0)
    yield
    assert children_of(os.getpid()) <= before
    assert os.sched_getaffinity(0) == cores


def supervise(
    run_dir: Path,
    modes: dict[str, str],
    limits: TimeLimits = PATIENT,
    duration_ns: int | None = 50_000_000,
) -> tuple[bool, list[tuple[str, str]]]:
    said: list[tuple[str, str]] = []
    commands = {
        name: [sys.executable, "-c", FAKE_NODE, name, str(run_dir), mode]
        for name, mode in modes.items()
    }

    class Kept(Screen):
        def show(self, name: str, line: str) -> None:
            said.append((name, line))

    supervisor = Supervisor(commands, run_dir, duration_ns, limits, Kept())
    return supervisor.run(), said


@pytest.mark.live
def test_processes_are_started_engaged_and_stopped(run_dir: Path) -> None:
    interrupted, said = supervise(run_dir, {"device": "good", "controller": "good"})
    assert not interrupted
    assert set(said) == {("device", "device is there"), ("controller", "controller is there")}


@pytest.mark.live
def test_the_message_of_a_death_holds_the_last_words(run_dir: Path) -> None:
    with pytest.raises(
        RunError, match=r"(?s)controller ended unexpectedly.*status 3.*out of order"
    ):
        supervise(run_dir, {"device": "good", "controller": "dies"})


@pytest.mark.live
def test_a_run_ends_while_a_node_that_died_starts_again(run_dir: Path) -> None:
    def is_restarted() -> bool:
        if not (run_dir / "engaged").exists():
            return False
        return bool(ask_launcher(run_dir, GetStatus()).nodes["environment"].restarts)

    def user() -> None:
        try:
            until(is_restarted, "a restart")
        finally:
            os.kill(os.getpid(), signal.SIGTERM)

    thread = threading.Thread(target=user)
    thread.start()
    modes = {"device": "good", "environment": "starts no more"}
    interrupted, said = supervise(run_dir, modes, duration_ns=None)
    thread.join()
    assert interrupted
    assert ("environment", "out of order") in said
    assert said.count(("environment", "environment is there")) == 1


@pytest.mark.live
def test_the_launcher_answers_stops_starts_and_restarts(run_dir: Path) -> None:
    """A second thread plays the user, since the launcher takes the main one for its signals."""
    modes = {"device": "good", "controller": "good", "environment": "good"}
    seen: dict[str, Any] = {}

    def node(name: str) -> ProcessState:
        return ask_launcher(run_dir, GetStatus()).nodes[name]

    def phase() -> object:
        return ask_launcher(run_dir, GetStatus()).phase

    def user() -> None:
        until(lambda: (run_dir / "engaged").exists(), "an engaged force")
        until(lambda: phase() == "running", "that the launcher knows it")
        before = node("controller")
        stop_node(run_dir, "environment")
        seen["stopped"] = node("environment")
        start_node(run_dir, "environment")
        seen["started"] = node("environment")
        assert before.pid is not None
        os.kill(before.pid, signal.SIGKILL)
        until(lambda: node("controller").restarts == 1, "a restart")
        until(lambda: node("controller").state == "running", "its answer")
        seen["pids differ"] = node("controller").pid != before.pid
        for name in ("device", "operator"):
            with pytest.raises(ConfigError) as refused:
                stop_node(run_dir, name)
            seen[name] = str(refused.value)
        with pytest.raises(ConfigError) as refused:
            ask_launcher(run_dir, Engage())
        seen["engage"] = str(refused.value)
        passed = ask_launcher(run_dir, ConfigureNode("environment", Configure(1, {})))
        seen["passed on"] = passed.phase
        with pytest.raises(ConfigError) as refused:
            ask_launcher(run_dir, ConfigureNode("operator", Configure(1, {})))
        seen["not passed on"] = str(refused.value)

    def user_who_ends_the_run() -> None:
        try:
            user()
        except BaseException as error:
            seen["error"] = repr(error)
        finally:
            os.kill(os.getpid(), signal.SIGTERM)

    thread = threading.Thread(target=user_who_ends_the_run)
    thread.start()
    interrupted, said = supervise(run_dir, modes, duration_ns=600 * 10**9)
    thread.join()
    assert "error" not in seen, seen
    assert interrupted
    assert seen["stopped"] == ProcessState("stopped")
    assert seen["started"].state == "running"
    assert seen["pids differ"]
    assert "a run ends without its device" in seen["device"]
    assert "no node 'operator' in this graph" in seen["operator"]
    assert "status, stop_node, start_node" in seen["engage"]
    assert seen["passed on"] == "running"
    assert "does not run 'operator'" in seen["not passed on"]
    assert said.count(("environment", "environment is there")) == 2
    assert said.count(("controller", "controller is there")) == 2


@pytest.mark.live
def test_a_launcher_that_hangs_is_told_from_one_that_is_not_there(
    run_dir: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(control, "ANSWER_TIMEOUT", 0.1)
    with pytest.raises(ConfigError, match=r"no launcher answers in"):
        ask_launcher(run_dir, GetStatus())
    (run_dir / ONE_HAND.nodes["launcher"].socket).touch()
    with pytest.raises(RunError, match=r"has not answered for 0.1 s"):
        ask_launcher(run_dir, GetStatus())


@pytest.mark.live
def test_a_process_whose_log_nobody_reads_goes_on_and_drops_lines() -> None:
    program = (
        "import logging, os, sys\n"
        "from forcebound.run.worker import never_wait_for_a_reader\n"
        "logging.basicConfig(level=logging.INFO)\n"
        "never_wait_for_a_reader()\n"
        "for number in range(20_000):\n"
        "    logging.warning('line %06d of a log that nobody reads', number)\n"
        "os.write(int(sys.argv[1]), b'survived')\n"
    )
    ours, theirs = os.pipe()
    with subprocess.Popen(
        [sys.executable, "-c", program, str(theirs)],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        pass_fds=[theirs],
        env={**os.environ, "PYTHONUNBUFFERED": "1"},
    ) as process:
        os.close(theirs)
        try:
            assert sockets.wait((ours,), round(TIMEOUT * 1e9)) == [ours]
            assert os.read(ours, 100) == b"survived"
            assert process.wait(TIMEOUT) == 0
            assert process.stdout is not None
            lines = process.stdout.read().decode().splitlines()
        finally:
            os.close(ours)
            process.kill()
    assert 100 < len(lines) < 20_000
    assert all(line.startswith("WARNING:root:line ") for line in lines[:-1])
    assert "Traceback" not in "".join(lines)


@pytest.mark.live
def test_who_is_not_ready_is_named_with_what_is_missing(run_dir: Path) -> None:
    for limit in (2, 10, 50):  # s; on a slow machine they do not answer before
        limits = replace(PATIENT, start_ns=limit * 10**9)
        with pytest.raises(RunError, match=f"not ready after {limit} s: ") as ended:
            supervise(run_dir, {"device": "good", "controller": "deaf"}, limits)
        if "does not answer" not in str(ended.value):
            break
    ended.match(r"controller has received nothing.*is the rate of the device")


@pytest.mark.live
def test_who_does_not_stop_is_killed(run_dir: Path) -> None:
    limits = replace(PATIENT, stop_ns=2 * 10**9)
    with pytest.raises(RunError, match="controller did not stop in time and was killed"):
        supervise(run_dir, {"device": "good", "controller": "stubborn"}, limits)


@pytest.mark.live
def test_a_live_run_leaves_its_samples_and_nothing_else(
    run_dir: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(run_dir))
    (result,) = run_live(load("stiff_wall.yaml"), 1.0).values()
    assert result.summary["samples"] > 0
    assert result.summary["law"] == "certified"
    # Too old is an answer after the machine stood still for the age limit; nothing else may be.
    assert set(result.summary["rejected_packets"]) <= {"too_old"}
    assert list(run_dir.iterdir()) == []


@pytest.mark.live
def test_a_start_that_fails_leaves_no_recording_in_the_way(run_dir: Path, tmp_path: Path) -> None:
    (tmp_path / "silent.py").write_text(SILENT)
    file = tmp_path / "silent.yaml"
    file.write_text("include: stiff_wall.yaml\nenvironment: {kind: silent.py}\n")
    config = load(file)
    record = tmp_path / "run.mcap"
    with pytest.raises(RunError, match="not ready after"):
        run_live(config, 0.5, record, TimeLimits(start_ns=3 * 10**9))
    assert not record.exists()
