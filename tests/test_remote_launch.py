"""A graph and an environment over TCP on this machine: the output of both."""

import re
import signal
from pathlib import Path

from live_graph import PROCESSES_OF_THEIR_OWN, live_graph
from remote_environment import serving, write_launch_file
from waiting import TIMEOUT, free_port, until

from forcebound.network.keys import new_key

pytestmark = PROCESSES_OF_THEIR_OWN


def test_an_interrupt_while_an_environment_is_awaited_ends_without_a_result() -> None:
    with live_graph("remote_wall", f"port:={free_port()}", is_alone=False) as graph:
        graph.until(lambda: "waiting for a remote environment" in graph.log, "it to wait")
        graph.process.send_signal(signal.SIGINT)
        status, out = graph.outcome()
        assert status == 130
        assert out == ""
        assert graph.log.splitlines()[-1] == "forcebound: interrupted"
        assert not graph.record.exists()  # it would hold nothing, and stand in the way of the next


def test_an_environment_with_a_key_that_is_none_ends_at_once(tmp_path: Path) -> None:
    keys = tmp_path / "keys"
    new_key("here", keys)
    new_key("there", keys)
    secret = keys / "here.key_secret"
    secret.write_text(re.sub('"[^"]*"', f'"{"#" * 40}"', secret.read_text()))
    remote = f"address: 127.0.0.1, port: {free_port()}, graph_key: there, environment_keys: [here]"
    file = write_launch_file(tmp_path, "a.yaml", remote)
    with serving(file, keys=keys) as environment:
        assert environment.process.wait(TIMEOUT) == 2
        assert f"{secret}: its public-key is not 40 characters of Z85" in environment.log


def test_the_logs_of_graph_and_environment_can_be_matched(tmp_path: Path, run_dir: Path) -> None:
    port = free_port()
    remote = f"address: 127.0.0.1, port: {port}, listens: environment"
    file = write_launch_file(tmp_path, "a.yaml", remote)
    where = f"127.0.0.1 port {port}, with the key this-user"
    with serving(file, runtime=run_dir) as environment:
        until(
            lambda: f"listening at {where}-environment" in environment.log,
            "its address",
        )
        name = re.findall(r"this environment is (\S+)", environment.log)[0]
        with live_graph(str(file), variables={"XDG_RUNTIME_DIR": str(run_dir)}) as graph:
            until(lambda: f"serving this graph now, as {name}" in environment.log, "its start")
            ended = graph.end()
        environment.end()
    assert f"connecting to {where}-graph" in ended.log
    assert f"environment {name} serves now" in ended.log
    connections = re.findall(r"connected from .*", environment.log)  # a busy machine may reconnect
    assert connections
    assert all(re.fullmatch(r"connected from \S+", line) for line in connections)
    answered = re.findall(rf"queries answered by {name}: (\d+)", environment.log)
    assert sum(map(int, answered)) > 10
