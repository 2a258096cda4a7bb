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

import numpy as np
import pytest
from live_graph import (
    AGE_LIMIT,
    PROCESSES_OF_THEIR_OWN,
    SLACK,
    Ended,
    check_always,
    check_return,
    check_silence,
    live_graph,
)
from remote_environment import key_folders, serving, write_hands, write_launch_file
from waiting import TIMEOUT

from forcebound.messages.packets import Telemetry

pytestmark = PROCESSES_OF_THEIR_OWN

GRAPH_IPV4, ENVIRONMENT_IPV4 = "10.231.7.1", "10.231.7.2"
GRAPH_IPV6, ENVIRONMENT_IPV6 = "fd42:7::1", "fd42:7::2"
SAFE = "graph_key: device-lab, environment_keys: [server-lab]"


def ip(*words: str) -> None:
    """Run ``ip`` of iproute2."""
    done = subprocess.run(
        ["ip", *words], capture_output=True, text=True, timeout=TIMEOUT, check=False
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
        assert set(graph.status().nodes) == {"controller", "device", "recorder"}
        graph.wait(0.5)
        ended = graph.end()
        environment.end()
    assert ended.exit_status == 0, ended.log
    check_always(ended.columns)
    assert "server-lab (key " in ended.log
    assert "device-lab (key " in environment.log
    assert ended.served


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
        "  environment_reply: { loss: 10 % }\n",
        "delayed_wall.yaml",
    )
    variables = {"FORCEBOUND_KEYS": str(keys["device-lab"])}
    with (
        serving(file, machines.at(machines.environment), keys["server-lab"]),
        live_graph(str(file), prefix=machines.at(machines.graph), variables=variables) as graph,
    ):
        graph.wait(1.0)
        graph.do("outage", "1 s", "environment_reply")
        graph.wait(1.0)
        graph.wait_until_in_contact()
        ended = graph.end()
    assert ended.exit_status == 0, ended.log
    columns = ended.columns
    check_always(columns)
    cut_ns = ended.events("parameter_set")[-1].time_ns
    begin_ns, end_ns = cut_ns + round((AGE_LIMIT + SLACK) * 1e9), cut_ns + 1_000_000_000
    during = (columns.time_ns > begin_ns) & (columns.time_ns < end_ns)
    assert during.any()
    assert not columns.applied_force[during].any()
    assert columns.applied_force[columns.time_ns > end_ns].any()
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
        graph.until(lambda: "silent for 300 ms" in graph.log, "the graph to notice")
        graph.until(lambda: "silent for 300 ms" in environment.log, "the other side to notice")
        graph.until(lambda: "has been silent for" in graph.log, "the end of the lease")
        plugged_ns = time.monotonic_ns()
        machines.plug("up")
        graph.wait_until_in_contact()
        assert graph.node("controller").restarts == 0
        assert environment.process.poll() is None
        ended = graph.end()
    assert ended.exit_status == 0, ended.log
    check_always(ended.columns)
    gap = check_silence(ended.columns, harm_ns)
    assert ended.columns.time_ns[gap[-1] + 1] > plugged_ns
    check_return(ended.columns, gap)
    assert ended.faults["force_released"] >= 1
    assert ended.faults["environment_lost"] >= 1
    assert "process_ended" not in ended.faults


def check_no_force_without_environment(ended: Ended) -> None:
    """Check that there is no force from the loss of an environment until the next one serves."""
    serving = ended.events("environment_serves")
    losses = ended.events("environment_lost")
    assert len(losses) >= 2
    for lost in losses:
        next_ns = min(event.time_ns for event in serving if event.time_ns >= lost.time_ns)
        times_ns = ended.columns.time_ns
        between = (times_ns >= lost.time_ns) & (times_ns <= next_ns)
        assert not ended.columns.applied_force[between].any()


def test_environments_swap_and_the_hand_is_free_between_them(
    machines: Machines, tmp_path: Path
) -> None:
    keys = key_folders(tmp_path, "device-lab", "server-lab")
    file = write_launch_file(tmp_path, "a.yaml", f"address: {GRAPH_IPV4}, local: true, {SAFE}")
    variables = {"FORCEBOUND_KEYS": str(keys["device-lab"])}
    with live_graph(str(file), prefix=machines.at(machines.graph), variables=variables) as graph:
        with serving(file, machines.at(machines.environment), keys["server-lab"]) as environment:
            graph.until(lambda: "not serving: " in environment.log, "the refused one to say so")
            graph.until(lambda: "rejected environment" in graph.log, "the graph to say so")
            graph.do("stop", "environment")
            graph.until(lambda: "serving this graph now" in environment.log, "it to serve")
            graph.wait_until_in_contact()
            environment.end()
            left_ns = time.monotonic_ns()
        graph.wait_until_released()
        graph.do("start", "environment")
        graph.wait_until_in_contact()
        ended = graph.end()
    assert ended.exit_status == 0, ended.log
    check_always(ended.columns)
    check_return(ended.columns, check_silence(ended.columns, left_ns))
    check_no_force_without_environment(ended)
    assert len(ended.served) == 3
    assert ended.faults["environment_refused"] >= 1
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
        assert environment.process.wait(TIMEOUT) == 0
    assert ended.exit_status == 0, ended.log
    check_always(ended.columns)


def test_a_hand_on_another_machine_shares_the_environment_of_this_one(
    machines: Machines, tmp_path: Path
) -> None:
    keys = key_folders(tmp_path, "right-lab", "world-lab")
    remote = f"address: {ENVIRONMENT_IPV4}, graph_key: right-lab, environment_keys: [world-lab]"
    file = write_hands(tmp_path, left="", right=remote)
    here, there = machines.at(machines.graph), machines.at(machines.environment)
    left_keys = {"FORCEBOUND_KEYS": str(keys["world-lab"])}
    right_keys = {"FORCEBOUND_KEYS": str(keys["right-lab"])}
    words = str(file), "--hand"
    with live_graph(*words, "left", prefix=here, variables=left_keys) as left:
        assert "environment" in left.status().nodes  # it serves before the other hand is there
        with live_graph(*words, "right", prefix=there, variables=right_keys) as right:
            assert set(right.status().nodes) == {"right/controller", "right/device", "recorder"}
        left.until(lambda: "right: right-lab" in left.log and " has gone" in left.log, "its end")
        left.wait_until_in_contact()
        with live_graph(*words, "right", prefix=there, variables=right_keys) as again:
            left.wait_until_in_contact()
            ended_again = again.end()
        ended = left.end()
    for one in (ended, ended_again):
        assert one.exit_status == 0, one.log
        check_always(one.columns)
        assert len(one.served) == 1
    assert ended.served == ended_again.served
    assert not ended.events("process_ended")
    assert ended.recording.hands == ("left",)


def test_energy_goes_between_bounders_on_two_machines_whichever_restarts(
    machines: Machines, tmp_path: Path
) -> None:
    keys = key_folders(tmp_path, "leader-lab", "follower-lab")
    file = tmp_path / "arms.yaml"
    file.write_text(
        "forcebound: 1\ninclude: leader_follower_remote.yaml\nrealtime: { policy: other }\n"
        f"arguments: {{ address: {{ default: {ENVIRONMENT_IPV4} }} }}\n"
        "hands:\n  follower: { device: { rate: 500 Hz } }\n  leader: { device: { rate: 500 Hz }, "
        "remote: { graph_key: leader-lab, environment_keys: [follower-lab] } }\n"
    )
    here = {"FORCEBOUND_KEYS": str(keys["follower-lab"])}
    there = {"FORCEBOUND_KEYS": str(keys["leader-lab"])}
    words = str(file), "listens:=environment", "--hand"
    at_follower, at_leader = machines.at(machines.environment), machines.at(machines.graph)

    def is_paid(telemetry: Telemetry) -> bool:
        return (telemetry.received_energy or 0.0) > 1e-4

    def has_given(telemetry: Telemetry) -> bool:
        return (telemetry.given_energy or 0.0) > 1e-4

    def check(ended: Ended) -> None:
        assert ended.exit_status == 0, ended.log
        columns = ended.columns
        kept = columns.true_energy + columns.received_energy - columns.given_energy
        assert np.nanmin(kept) >= -1e-9

    with live_graph(*words, "follower", prefix=at_follower, variables=here, is_alone=False) as one:
        one.wait_until_engaged()
        with live_graph(
            *words, "leader", prefix=at_leader, variables=there, is_alone=False
        ) as leader:
            one.wait_for_telemetry(is_paid, "energy of the leader")
            leader.signal("leader/device", signal.SIGKILL)
            assert leader.outcome()[0] == 1
        with live_graph(
            *words, "leader", prefix=at_leader, variables=there, is_alone=False
        ) as again:
            again.wait_until_engaged()
            again.wait_for_telemetry(has_given, "energy that the new leader gave")
            one.signal("environment", signal.SIGKILL)  # the link ends in its process
            one.until(lambda: one.node("environment").restarts == 1, "the environment")
            again.until(lambda: again.log.count(" serves now") == 2, "the new environment")
            again.wait(0.5)
            check(again.end())
        check(one.end())
