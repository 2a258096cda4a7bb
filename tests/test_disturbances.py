"""Live graphs in hard contact with a disturbed process, clock or link, judged by ground truth."""

import os
import shutil
import signal
import subprocess
import sys
import time
from collections import deque
from pathlib import Path

import numpy as np
import pytest
from live_graph import (
    PROCESSES_OF_THEIR_OWN,
    LiveGraph,
    check_always,
    check_return,
    check_silence,
    live_graph,
)
from remote_environment import write_launch_file
from waiting import TIMEOUT

from forcebound.messages.packets import Telemetry
from forcebound.network import sockets

pytestmark = PROCESSES_OF_THEIR_OWN
REST = 0.05e-3  # m, within which a hand moves that rests


def stop_the_device_for_50_ms(graph: LiveGraph) -> None:
    graph.signal("device", signal.SIGSTOP)
    sockets.wait((), 50_000_000)
    graph.signal("device", signal.SIGCONT)
    graph.wait(0.3)


def wait_until_the_hand_rests(graph: LiveGraph) -> None:
    """Wait for 50 samples in which the hand feels a force and hardly moves."""
    positions: deque[float] = deque(maxlen=50)

    def rests(telemetry: Telemetry) -> bool:
        positions.append(telemetry.position[0] if telemetry.applied_force[0] > 0.5 else np.inf)
        return len(positions) == 50 and max(positions) - min(positions) < REST

    graph.wait_for_telemetry(rests, "a hand at rest")


def test_a_device_that_stands_still_for_50_ms_gives_no_energy() -> None:
    with live_graph("stiff_wall.yaml") as graph:
        for _ in range(3):
            stop_the_device_for_50_ms(graph)
        ended = graph.end()
    assert ended.exit_status == 0, ended.log
    check_always(ended.columns)
    assert (np.diff(ended.columns.time_ns) > 45_000_000).sum() >= 3
    assert ended.summary["deadline_misses"] >= 3 * 45


def test_a_device_that_stands_still_is_without_force_by_its_watchdog(tmp_path: Path) -> None:
    file = tmp_path / "reporting.yaml"
    file.write_text("forcebound: 1\ninclude: stiff_wall.yaml\ndevice: {watchdog: reporting}\n")
    # A wall so soft that it needs no law: after whatever a busy machine did, the hand rests in it.
    with live_graph(str(file), "stiffness:=400 N/m", "law:=none") as graph:
        for _ in range(5):
            wait_until_the_hand_rests(graph)
            stop_the_device_for_50_ms(graph)
        ended = graph.end()
    columns = ended.columns
    assert columns.true_position is not None
    position = columns.true_position[:, 0]
    stalls = np.flatnonzero(np.diff(columns.time_ns) > 45_000_000)
    at_rest = [
        int(stall)
        for stall in stalls
        if columns.applied_force[stall, 0] > 0.5 and np.ptp(position[stall - 20 : stall + 1]) < REST
    ]
    assert at_rest, "the hand rests at none of the stalls"
    # With the force held, the leaning hand would go on resting; without, it sinks in.
    assert (position[np.add(at_rest, 1)] - position[at_rest] > 2 * REST).all()


SHIM = r"""
#define _GNU_SOURCE
#include <sys/syscall.h>
#include <sys/time.h>
#include <time.h>
#include <unistd.h>

/* Every half second the wall clock jumps by an hour, forth or back; no other clock does. */
static time_t jump(void)
{
    struct timespec now;
    syscall(SYS_clock_gettime, CLOCK_MONOTONIC, &now);
    return (now.tv_sec * 2 + now.tv_nsec / 500000000) % 2 ? 3600 : 0;
}

int clock_gettime(clockid_t clock, struct timespec *time)
{
    int status = syscall(SYS_clock_gettime, clock, time);
    if (status == 0 && (clock == CLOCK_REALTIME || clock == CLOCK_REALTIME_COARSE))
        time->tv_sec += jump();
    return status;
}

int gettimeofday(struct timeval *restrict time, void *restrict zone)
{
    struct timespec now;
    (void)zone;
    clock_gettime(CLOCK_REALTIME, &now);
    time->tv_sec = now.tv_sec;
    time->tv_usec = now.tv_nsec / 1000;
    return 0;
}

time_t time(time_t *where)
{
    struct timespec now;
    clock_gettime(CLOCK_REALTIME, &now);
    if (where)
        *where = now.tv_sec;
    return now.tv_sec;
}
"""


@pytest.mark.slow
def test_a_wall_clock_that_jumps_by_an_hour_is_not_felt(tmp_path: Path) -> None:
    compiler = shutil.which("cc")
    if compiler is None:
        pytest.skip("a C compiler (cc) is missing")
    source, shim = tmp_path / "jump.c", tmp_path / "jump.so"
    source.write_text(SHIM)
    subprocess.run([compiler, "-shared", "-fPIC", "-o", shim, source], check=True, timeout=TIMEOUT)
    variables = {"LD_PRELOAD": str(shim)}
    look = "import time\nend = time.monotonic() + 1.2\nseen = []\nwhile time.monotonic() < end:\n"
    look += "    seen.append(time.time())\nprint(max(seen) - min(seen))"
    seen = subprocess.run(
        [sys.executable, "-c", look],
        env={**os.environ, **variables},
        capture_output=True,
        check=True,
        timeout=TIMEOUT,
    )
    assert float(seen.stdout) > 3599.0, "the wall clock does not jump"
    file = write_launch_file(tmp_path, "a.yaml", rate="1 kHz")
    with live_graph(str(file), variables=variables) as graph:
        begin_ns = time.monotonic_ns()
        graph.wait(3.0)
        graph.wait_until_in_contact()
        ended = graph.end()
    assert ended.exit_status == 0, ended.log
    check_always(ended.columns)
    since = ended.columns.time_ns > begin_ns
    answered = ended.columns.device_seq >= 0
    assert answered[since].any()
    assert ended.columns.loop_delay[answered].min() >= 0.0
    assert "from_the_future" not in ended.summary["rejected_packets"]
    assert np.diff(ended.columns.time_ns).max() < TIMEOUT * 1e9
    assert "environment_lost" not in ended.faults


@pytest.mark.slow
def test_links_that_reorder_double_and_lose_everything_in_turn(tmp_path: Path) -> None:
    links = ("device_state", "environment_query", "environment_reply", "force_command")
    bad = "delay: 5 ms, jitter: 5 ms, reorder: 50 %, duplicate: 50 %"
    # Of a packet that is both doubled and lost, netem delivers one: no duplicate where all is lost.
    phases = ["phases:", "  - { name: good, duration: 3 s }"]
    for topic in links:
        phases += [
            f"  - name: {topic} is lost",
            "    duration: 700 ms",
            f"    set: {{ links.{topic}.loss: 100 %, links.{topic}.duplicate: 0 % }}",
            f"  - {{ name: after {topic}, duration: 1200 ms }}",
        ]
    more = "links:\n" + "".join(f"  {topic}: {{ {bad} }}\n" for topic in links)
    file = write_launch_file(tmp_path, "a.yaml", more=more + "\n".join(phases) + "\n", rate="1 kHz")
    with live_graph(str(file)) as graph:
        graph.wait(3.0 + 1.9 * len(links))
        ended = graph.end()
    assert ended.exit_status == 0, ended.log
    check_always(ended.columns)
    for topic in links:
        loss = f"links.{topic}.loss"
        lost_ns = next(
            event.time_ns
            for event in ended.events("parameter_set")
            if float(event.data.get(loss, 0.0)) == 1.0
        )
        check_return(ended.columns, check_silence(ended.columns, lost_ns))
    assert ended.faults["force_released"] >= len(links)
    told = {phase["name"]: phase for phase in ended.summary["phases"]}
    for topic in links:
        assert told[f"{topic} is lost"]["answered_share"] < 0.5
        assert told[f"{topic} is lost"]["true_energy_min_j"] >= -1e-9
        assert ended.summary["links"][topic]["lost"] > 0
        assert ended.summary["links"][topic]["duplicated"] > 0
