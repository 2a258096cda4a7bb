"""Observations of a graph in which all is well but for what a test changes."""

import json
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from typing import Any

from builders import telemetry_packet

from forcebound.graph.graph import GraphConfig
from forcebound.graph.loader import load
from forcebound.messages.control import (
    BounderReport,
    ControllerStatus,
    DeviceStatus,
    EnvironmentStatus,
    ProcessStatus,
    RecorderStatus,
)
from forcebound.messages.topology import ONE_HAND
from forcebound.observe.doctor import examine
from forcebound.observe.findings import Finding
from forcebound.observe.observation import Observations, RecordingSeen, Seen
from forcebound.recordings.telemetry import TelemetryColumns
from forcebound.roles import Fact

PERIOD_NS = 1_000_000
TICKS = 2000
SERVING = "here/1/a"
PUNCTUAL = [Fact("core", "on core 1", False), Fact("fifo", "SCHED_FIFO priority 50", False)]
#: By the topic that it receives: the class of a process's status, and what must be given of it.
STATUS: dict[str, Callable[..., ProcessStatus]] = {
    "force_command": partial(
        DeviceStatus,
        engaged=True,
        law="certified",
        bounder=BounderReport(hold_limit=1.02e-3, longest_hold_limit=1.02e-3),
        realtime=PUNCTUAL,
    ),
    "device_state": ControllerStatus,
    "environment_query": partial(EnvironmentStatus, name=SERVING),
    "telemetry": partial(RecorderStatus, recording="complete"),
}


def telemetry(
    ticks: int = TICKS,
    unanswered: range = range(0),
    loop_delay: float = 1.4e-3,
    lost_every: int = 0,
    asked: float = 8.0,
    applied: float = 8.0,
) -> TelemetryColumns:
    """Return telemetry in which ``unanswered`` ticks have no force."""
    packets = []
    for tick in range(ticks):
        is_answered = tick not in unanswered
        packets.append(
            telemetry_packet(
                tick,
                elapsed=1.0 + tick * 1e-3,
                commanded_force=(asked if is_answered else 0.0,),
                applied_force=(applied if is_answered else 0.0,),
                force_limit=applied,
                device_seq=max(0, tick - 1) if is_answered else None,
                loop_delay=loop_delay if is_answered else None,
                deadline_misses=tick // lost_every if lost_every else 0,
            )
        )
    return TelemetryColumns.from_packets(packets)


HEALTHY = telemetry()


def process(*topics: str, grown: int = TICKS, pid: int = 7, **status: Any) -> Seen[Any]:
    """Return a process that has received ``grown`` packets of each topic between two answers."""
    made = STATUS[topics[0]]
    first = made(received=dict.fromkeys(topics, 5))
    last = made(received=dict.fromkeys(topics, 5 + grown), **status)
    return Seen("running", pid, 0, "S", first, last, 2.0)


def silent(state: str, kernel_state: str = "", pid: int | None = 7) -> Seen[Any]:
    return Seen(state, pid, 0, kernel_state, None, None)


PROCESSES: Mapping[str, Seen[Any]] = {
    "device": process("force_command"),
    "controller": process("device_state", "environment_reply", environment=SERVING),
    "environment": process("environment_query"),
    "recorder": process("telemetry"),
}
LAUNCHER = Seen[Any]("running", 6, 0, "S", None, None, 2.0)


def graph(*words: str) -> GraphConfig:
    return load("stiff_wall.yaml", words)


def healthy(config: GraphConfig | None = None, **processes: Seen[Any]) -> Observations:
    """Return a graph in which all is well but for some processes."""
    return Observations(
        config=graph() if config is None else config,
        graph=ONE_HAND,
        processes={**PROCESSES, **processes},
        telemetry=HEALTHY,
        phase="running",
        launcher=LAUNCHER,
        recording=RecordingSeen("/data/run.mcap", 300_000.0, 50_000_000_000),
        core=1,
        cores=2,
    )


def with_processes(processes: Mapping[str, Seen[Any]]) -> Observations:
    return replace(healthy(), processes={**PROCESSES, **processes})


def kinds(findings: list[Finding]) -> list[str]:
    return [finding.kind for finding in findings]


def only(seen: Observations) -> Finding:
    """Return the only finding, which can be put in words."""
    findings = examine(seen)
    assert len(findings) == 1, findings
    document = findings[0].document()
    json.dumps(document)
    assert document["seen"]
    return findings[0]


def commands(finding: Finding) -> list[str]:
    given = (finding.command, *(cause.command for cause in finding.causes))
    return [command for command in given if command]


def codes(finding: Finding) -> list[str]:
    return [cause.code for cause in finding.causes]
