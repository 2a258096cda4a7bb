"""Observations of a graph in which all is well but for what a test changes."""

import json
from collections.abc import Mapping
from dataclasses import asdict, replace
from typing import Any

from builders import telemetry_packet

from forcebound.config.graph import GraphConfig
from forcebound.config.loader import load
from forcebound.monitor import wording
from forcebound.monitor.doctor import examine
from forcebound.monitor.findings import Finding
from forcebound.monitor.observation import Observations, ProcessSeen, RecordingSeen
from forcebound.telemetry import TelemetryColumns

PERIOD_NS = 1_000_000
TICKS = 2000
SERVING = "here/1/a"
PUNCTUAL = [
    {"code": "core", "data": {"core": 1}},
    {"code": "fifo", "data": {"priority": 50}},
    {"code": "memory_locked", "data": {}},
]


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


def process(*topics: str, grown: int = TICKS, pid: int = 7, **status: Any) -> ProcessSeen:
    """Return a process that has received ``grown`` packets of each topic between two answers."""
    first = {
        "received": dict.fromkeys(topics, 5),
        "rejected": {},
        "links": {},
        "realtime": PUNCTUAL,
    }
    last = {**first, "received": dict.fromkeys(topics, 5 + grown), **status}
    return ProcessSeen("running", pid, 0, "S", first, last, 2.0)


def silent(state: str, kernel_state: str = "", pid: int | None = 7) -> ProcessSeen:
    return ProcessSeen(state, pid, 0, kernel_state, None, None)


PROCESSES: Mapping[str, ProcessSeen] = {
    "device": process("force_command"),
    "controller": process("device_state", "environment_reply", environment=SERVING),
    "environment": process("environment_query", name=SERVING, failures=0),
    "recorder": process("telemetry", recording="complete"),
}
LAUNCHER = ProcessSeen("running", 6, 0, "S", {"phase": "running"}, {"phase": "running"}, 2.0)


def graph(*words: str) -> GraphConfig:
    return load("stiff_wall.yaml", words)


def healthy(config: GraphConfig | None = None, **processes: ProcessSeen) -> Observations:
    """Return a graph in which all is well but for some processes."""
    return Observations(
        config=graph() if config is None else config,
        processes={**PROCESSES, **processes},
        telemetry=HEALTHY,
        phase="running",
        launcher=LAUNCHER,
        recording=RecordingSeen("/data/run.mcap", 300_000.0, 50_000_000_000),
        core=1,
        cores=2,
    )


def with_processes(processes: Mapping[str, ProcessSeen]) -> Observations:
    return replace(healthy(), processes={**PROCESSES, **processes})


def kinds(findings: list[Finding]) -> list[str]:
    return [finding.kind for finding in findings]


def only(seen: Observations) -> Finding:
    """Return the only finding, which can be put in words."""
    findings = examine(seen)
    assert len(findings) == 1, findings
    json.dumps(asdict(findings[0]))
    assert wording.seen(findings[0])
    wording.advice(findings[0])
    return findings[0]


def codes(finding: Finding) -> list[str]:
    return [cause.code for cause in finding.causes]
