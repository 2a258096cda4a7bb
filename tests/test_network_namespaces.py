"""Two network namespaces as two machines: the graph in one, the environment in the other.

What must hold is judged by the device's own telemetry. It takes root and iproute2.
"""

import os
import secrets
import shutil
import signal
import subprocess
import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import pytest
from live_graph import PROCESSES_OF_THEIR_OWN, check_always, check_return, check_silence, live_graph
from remote_environment import key_folders, serving, write_launch_file
from waiting import PATIENCE

from forcebound.messages.packets import Telemetry

pytestmark = PROCESSES_OF_THEIR_OWN

GRAPH_IPV4, ENVIRONMENT_IPV4 = "10.231.7.1", "10.231.7.2"
GRAPH_IPV6, ENVIRONMENT_IPV6 = "fd42:7::1", "fd42:7::2"
SAFE = "graph_key: device-lab, environment_keys: [server-lab]"


def ip(*words: str) -> None:
    """Run ``ip`` of iproute2."""
    done = subprocess.run(
        ["ip", *words], capture_output=True, text=True, timeout=PATIENCE, check=False
    )
    if done.returncode != 0:
        raise OSError(f"ip {' '.join(words)}: {done.stderr.strip()}")


@dataclass(frozen=True)
class Machines:
    """Two namespaces and a wire between them."""

    graph: str
    environment: str
    wire: str

    def at(self, name: str) -> list[str]:
        """Return what a command begins with that runs on a machine."""
        return ["ip", "netns", "exec", name]

    def plug(self, state: str) -> None:
        """Take the wire out (``down``) of the graph's machine, or put it in (``up``)."""
        ip("-n", self.graph, "link", "set", self.wire, state)
        if state == "up" and Path("/proc/net/if_inet6").exists():  # it goes with the link
            ip("-n", self.graph, "addr", "replace", f"{GRAPH_IPV6}/64", "dev", self.wire, "nodad")


@pytest.fixture
def machines() -> Iterator[Machines]:
    if shutil.which("ip") is None:
        pytest.skip("ip of iproute2 is missing")
    if os.geteuid() != 0:
        pytest.skip("network namespaces need root")
    tag = secrets.token_hex(3)
    machines = Machines(f"fbg-{tag}", f"fbe-{tag}", f"fbg{tag}")
    wire_end = f"fbe{tag}"
    try:
        try:
            for name in (machines.graph, machines.environment):
                ip("netns", "add", name)
            ends = ("peer", "name", wire_end, "netns", machines.environment)
            ip("link", "add", machines.wire, "netns", machines.graph, "type", "veth", *ends)
        except OSError as error:
            pytest.skip(f"no network namespaces here: {error}")
        for name, wire, ipv4, ipv6 in (
            (machines.graph, machines.wire, GRAPH_IPV4, GRAPH_IPV6),
            (machines.environment, wire_end, ENVIRONMENT_IPV4, ENVIRONMENT_IPV6),
        ):
            ip("-n", name, "link", "set", "lo", "up")
            ip("-n", name, "addr", "add", f"{ipv4}/24", "dev", wire)
            if Path("/proc/net/if_inet6").exists():
                ip("-n", name, "addr", "add", f"{ipv6}/64", "dev", wire, "nodad")
            ip("-n", name, "link", "set", wire, "up")
        yield machines
    finally:
        for name in (machines.graph, machines.environment):
            with suppress(OSError):
                ip("netns", "del", name)


@pytest.mark.parametrize(
    ("address", "listens"),
    [
        pytest.param(GRAPH_IPV4, "graph", marks=pytest.mark.slow),
        pytest.param(ENVIRONMENT_IPV4, "environment", marks=pytest.mark.slow),
        pytest.param(f"'[{GRAPH_IPV6}]'", "graph", marks=pytest.mark.slow),
        (f"'[{ENVIRONMENT_IPV6}]'", "environment"),
    ],
)
def test_an_environment_on_another_machine_serves(
    machines: Machines, tmp_path: Path, address: str, listens: str
) -> None:
    if ":" in address and not Path("/proc/net/if_inet6").exists():
        pytest.skip("this machine has no IPv6")
    keys = key_folders(tmp_path, "device-lab", "server-lab")
    file = write_launch_file(tmp_path, "a.yaml", f"address: {address}, listens: {listens}, {SAFE}")
    variables = {"FORCEBOUND_KEYS": str(keys["device-lab"])}
    with (
        serving(file, machines.at(machines.environment), keys["server-lab"]) as environment,
        live_graph(str(file), prefix=machines.at(machines.graph), variables=variables) as graph,
    ):
        assert set(graph.status()["nodes"]) == {"controller", "device", "recorder"}
        graph.wait(0.5)
        ended = graph.end()
        environment.end()
    assert ended.exit_status == 0, ended.log
    check_always(ended.columns)
    assert "server-lab (key " in ended.log
    assert "device-lab (key " in environment.log
    assert len(ended.events("environment_serves")) >= 1


def test_delay_loss_and_an_outage_far_away_are_stable_and_told(
    machines: Machines, tmp_path: Path
) -> None:
    keys = key_folders(tmp_path, "device-lab", "server-lab")
    file = write_launch_file(
        tmp_path,
        "far.yaml",
        f"address: {GRAPH_IPV4}, {SAFE}",
        "arguments: { delay: 20 ms }\n"
        "links:\n"
        "  environment_query: { loss: 10 % }\n"
        "  environment_reply:\n"
        "    loss: 10 %\n"
        "    outages: [{ start: 8 s, duration: 1 s }]\n",
        "delayed_wall.yaml",
    )
    variables = {"FORCEBOUND_KEYS": str(keys["device-lab"])}
    with (
        serving(file, machines.at(machines.environment), keys["server-lab"]),
        live_graph(str(file), prefix=machines.at(machines.graph), variables=variables) as graph,
    ):
        graph.wait(1.0)
        before_ns = time.monotonic_ns()
        answered_ns: list[int] = []

        def is_outage(telemetry: Telemetry) -> bool:  # and no moment in which this machine was busy
            if telemetry.device_seq is not None or not answered_ns:
                answered_ns[:] = [telemetry.time_ns]
            return telemetry.time_ns - answered_ns[0] > 0.5e9

        graph.wait_for_telemetry(is_outage, "the outage")
        graph.wait_until_in_contact()
        ended = graph.end()
    assert ended.exit_status == 0, ended.log
    columns = ended.columns
    check_always(columns)
    since = columns.time_ns > before_ns
    silent = columns.time_ns[since & (columns.device_seq < 0)]
    longest = 0.0 if silent.size == 0 else float(silent[-1] - silent[0]) * 1e-9
    assert longest > 0.8, "the outage of 1 s, without the age limit and the delay"
    assert ended.summary["loop_delay_ms"]["p50"] >= 40.0
    counts = ended.summary["links"]["environment_reply"]
    assert counts["lost"] / counts["sent"] > 0.05
    assert ended.faults["force_released"] >= 1


def test_a_wire_pulled_in_contact_leaves_no_force_until_it_is_back(
    machines: Machines, tmp_path: Path
) -> None:
    keys = key_folders(tmp_path, "device-lab", "server-lab")
    file = write_launch_file(tmp_path, "a.yaml", f"address: {GRAPH_IPV4}, {SAFE}")
    variables = {"FORCEBOUND_KEYS": str(keys["device-lab"])}
    with (
        serving(file, machines.at(machines.environment), keys["server-lab"]) as environment,
        live_graph(str(file), prefix=machines.at(machines.graph), variables=variables) as graph,
    ):
        machines.plug("down")
        harm_ns = time.monotonic_ns()
        graph.wait(2.0)
        machines.plug("up")
        graph.wait_until_in_contact()
        assert graph.node("controller")["restarts"] == 0
        assert environment.process.poll() is None
        ended = graph.end()
    assert ended.exit_status == 0, ended.log
    check_always(ended.columns)
    gap = check_silence(ended.columns, harm_ns)
    assert ended.columns.time_ns[gap[-1]] - ended.columns.time_ns[gap[0]] > 1.7e9
    check_return(ended.columns, gap)
    assert ended.faults["force_released"] >= 1
    assert ended.faults["environment_lost"] == 1
    assert "process_ended" not in ended.faults
    assert "silent for 300 ms" in ended.log  # both sides have noticed
    assert "silent for 300 ms" in environment.log


def test_environments_swap_and_the_hand_is_free_between_them(
    machines: Machines, tmp_path: Path
) -> None:
    keys = key_folders(tmp_path, "device-lab", "server-lab")
    file = write_launch_file(tmp_path, "a.yaml", f"address: {GRAPH_IPV4}, local: true, {SAFE}")
    variables = {"FORCEBOUND_KEYS": str(keys["device-lab"])}
    with live_graph(str(file), prefix=machines.at(machines.graph), variables=variables) as graph:
        run = ("--run", str(graph.run_dir))
        with serving(file, machines.at(machines.environment), keys["server-lab"]) as environment:
            graph.until(lambda: "not serving: " in environment.log, "the refused one to say so")
            graph.until(lambda: "rejected environment" in graph.log, "the graph to say so")
            stopped = graph.order("stop", "environment", *run)
            assert stopped.returncode == 0, stopped.stderr
            graph.until(lambda: graph.log.count("serves now") == 2, "the remote one to serve")
            graph.wait_until_in_contact()
            environment.end()
            left_ns = time.monotonic_ns()
        graph.wait_until_released()
        started = graph.order("start", "environment", *run)
        assert started.returncode == 0, started.stderr
        graph.wait_until_in_contact()
        ended = graph.end()
    assert ended.exit_status == 0, ended.log
    check_always(ended.columns)
    # The remote one is there before the command that stops the local one has ended.
    stopped_ns = ended.events("process_ended")[0].time_ns
    for harm_ns in (stopped_ns, left_ns):
        check_return(ended.columns, check_silence(ended.columns, harm_ns))
    names = [event.data["environment"] for event in ended.events("environment_serves")]
    assert len(names) == len(set(names)) == 3
    assert ended.faults["environment_refused"] >= 1
    assert ended.faults["environment_lost"] == 2
    assert "process_ended" not in ended.faults


@pytest.mark.slow
def test_insecure_runs_without_keys_beyond_this_machine(machines: Machines, tmp_path: Path) -> None:
    remote = f"address: {GRAPH_IPV4}, insecure: true"
    file = write_launch_file(tmp_path, "a.yaml", remote)
    with (
        serving(file, machines.at(machines.environment)) as environment,
        live_graph(str(file), prefix=machines.at(machines.graph)) as graph,
    ):
        ended = graph.end()
        environment.process.send_signal(signal.SIGINT)
        assert environment.process.wait(PATIENCE) == 0
    assert ended.exit_status == 0, ended.log
    check_always(ended.columns)
