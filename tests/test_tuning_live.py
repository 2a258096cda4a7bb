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
        assert kept.returncode == 1
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
    assert "was killed" in ended.log
    assert "process_ended" not in ended.faults


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
        assert refused.returncode == 2
        assert "on the machine of the graph" in refused.stderr
        listed = graph.order("param", "get", "links", *far).stdout.splitlines()
        of_graph = {line.split(".")[1] for line in listed if "# belongs to another machine" in line}
        assert of_graph == {"device_state", "environment_reply", "force_command"}
        waits = graph.order("param", "set", "environment.stiffness:=9 N/mm", *far)
        assert waits.returncode == 0, waits.stderr
        assert "not this environment, which waits" in waits.stderr
        served = graph.order("param", "set", "environment.stiffness:=9 N/mm", *run)
        assert (served.returncode, served.stderr) == (0, "")

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
