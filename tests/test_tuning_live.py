"""Parameters of live graphs: changes for suspended, stopped, waiting and remote nodes."""

import json
import signal
from pathlib import Path

import pytest
from live_graph import PROCESSES_OF_THEIR_OWN, live_graph
from remote_environment import serving, write_launch_file
from waiting import free_port

pytestmark = PROCESSES_OF_THEIR_OWN


def test_a_change_while_the_environment_is_away_is_recorded_when_it_has_it(tmp_path: Path) -> None:
    with live_graph(str(write_launch_file(tmp_path, "a.yaml"))) as graph:
        run = ("--run", str(graph.run_dir))
        graph.signal("environment", signal.SIGSTOP)
        kept = graph.order("param", "set", "environment.stiffness:=9 N/mm", *run)
        assert kept.exit_code == 1
        assert "environment did not answer; the change is kept" in kept.stderr
        graph.signal("environment", signal.SIGCONT)
        graph.until(lambda: "changed: environment.stiffness = 9 N/mm" in graph.log, "the change")

        graph.do("stop", "environment")
        kept = graph.do("param", "set", "environment.stiffness:=8 N/mm")
        assert kept.stdout == "environment.stiffness: 8 N/mm\n"
        assert "forcebound start environment" in kept.stderr
        graph.do("start", "environment")

        changed = graph.order("param", "list", "--changed", *run)
        assert changed.stdout == "environment.stiffness: 8 N/mm\n"
        graph.signal("environment", signal.SIGSTOP)
        graph.do("stop", "environment")
        ended = graph.end()
    assert ended.exit_status == 0, ended.log
    told = [(e.node, e.data["environment.stiffness"]) for e in ended.events("parameter_set")]
    assert told == [("environment", "9000.0"), ("launcher", "8000.0")]
    assert ended.log.count("environment stopped on request, with exit status 0") == 2
    assert "process_ended" not in ended.faults


FRAGILE = """
import os
from dataclasses import dataclass
from forcebound.haptics.environments import StatelessEnvironment
from forcebound.quantities import Stiffness

@dataclass(frozen=True)
class Fragile(StatelessEnvironment):
    stiffness: Stiffness = 10_000.0

    def force(self, user, position, velocity, elapsed):
        if elapsed > 0.0 and self.stiffness > 11_000.0:
            os._exit(3)  # as a library in C may
        return tuple(self.stiffness * max(x - 0.01, 0.0) for x in position)
"""


def test_a_node_that_fails_by_a_change_goes_on_with_the_parameters_before(tmp_path: Path) -> None:
    (tmp_path / "fragile.py").write_text(FRAGILE)
    file = tmp_path / "fragile.yaml"
    file.write_text(
        "forcebound: 1\ndescription: Fragile.\ninclude: stiff_wall.yaml\n"
        "environment: {kind: fragile.py, stiffness: 10 N/mm}\n"
    )
    with live_graph(str(file)) as graph:
        graph.do("param", "set", "environment.stiffness:=9 N/mm")
        run = ("--run", str(graph.run_dir))
        graph.order("param", "set", "environment.stiffness:=12 N/mm", *run)  # it may not answer
        graph.until(lambda: len(graph.log.split("was restarted")) > 1, "a restart")
        graph.wait_until_in_contact()
        assert graph.node("environment").restarts == 1
        changed = graph.order("param", "list", "--changed", *run)
        assert changed.stdout == "environment.stiffness: 9 N/mm\n"
        ended = graph.end()
    assert ended.exit_status == 0, ended.log
    set_to = [e.data["environment.stiffness"] for e in ended.events("parameter_set")]
    assert set_to[0] == "9000.0"
    assert set_to[-1] == "9000.0"
    assert ended.faults["process_ended"] == 1


@pytest.mark.slow
def test_a_stand_by_is_told_from_the_environment_that_serves(tmp_path: Path, run_dir: Path) -> None:
    remote = f"address: 127.0.0.1, port: {free_port()}, local: true"
    file = write_launch_file(tmp_path, "a.yaml", remote)
    variables = {"XDG_RUNTIME_DIR": str(run_dir)}
    with (
        live_graph(str(file), variables=variables) as graph,
        serving(file, runtime=run_dir) as there,
    ):
        graph.until(lambda: "waiting until it leaves" in there.log, "a stand-by elsewhere")
        [elsewhere] = set(run_dir.glob("forcebound-*")) - {graph.run_dir}
        run, far = ("--run", str(graph.run_dir)), ("--run", str(elsewhere))
        refused = graph.order("param", "set", "links.environment_reply.delay:=15 ms", *far)
        assert refused.exit_code == 2
        assert "on the machine of the graph" in refused.stderr
        listed = graph.order("param", "get", "links", *far).stdout.splitlines()
        of_graph = {line.split(".")[1] for line in listed if "# belongs to another machine" in line}
        assert of_graph == {"device_state", "environment_reply", "force_command"}
        waits = graph.order("param", "set", "environment.stiffness:=9 N/mm", *far)
        assert waits.exit_code == 0, waits.stderr
        assert "not this environment, which waits" in waits.stderr
        served = graph.order("param", "set", "environment.stiffness:=9 N/mm", *run)
        assert (served.exit_code, served.stderr) == (0, "")

        seen = {}
        for where in (run, far):
            found = json.loads(graph.order("doctor", "--json", *where).stdout)["findings"]
            seen[where] = {finding["kind"]: finding["severity"] for finding in found}
        assert seen[run]["waiting_environment"] == "note"
        assert seen[far]["remote_connected"] == "note"

        graph.do("stop", "environment")
        graph.wait_until_in_contact()  # with the other one
        graph.do("start", "environment")
        graph.until(lambda: "not serving" in graph.log, "a stand-by here")
        waits = graph.do("param", "set", "environment.stiffness:=7 N/mm")
        assert "not the environment of this machine" in waits.stderr
        left = graph.order("stop", "environment", *run)
        assert "serves as before" in left.stdout
        assert graph.end().exit_status == 0
