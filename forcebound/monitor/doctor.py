"""Diagnosis of a running graph: what is wrong with it, where, and the likely causes.

:func:`examine` judges what :mod:`forcebound.monitor.observation` saw, and touches nothing. Each
rule gives findings. A cause is named once, and not again by all that follows from it: of the chain
device, controller, environment, controller, device only the first hop that is broken is named.

To add a rule: a function from observations to findings, its name in ``RULES``, and the text of its
findings in :mod:`forcebound.monitor.texts`.
"""

from collections.abc import Callable, Iterator
from typing import TypeAlias

import numpy as np

from forcebound import realtime
from forcebound.analysis.bounder import (
    causes_of_little_force,
    is_limited,
    limited_ticks,
    magnitudes,
)
from forcebound.config.graph import GraphConfig
from forcebound.config.resolved import to_document
from forcebound.messages.packets import LINKS, TOPICS
from forcebound.monitor.findings import Fact, Finding, Severity
from forcebound.monitor.observation import SUSPENDED, Observations, ProcessSeen
from forcebound.monitor.texts import REASONS
from forcebound.network.notices import KINDS
from forcebound.process import COMPLETE

NEAR_AGE_LIMIT = 0.7  # of it; beyond, a little more delay takes the force away
LATE_PERIODS = 3.0  # above the delay that is injected; an idle machine needs less than 1.5
LOST_TICKS_SHARE = 0.01  # of all ticks, from which on it is a problem
NOW = 0.2  # s without an answer that make it "now"
WAITING_RATE = 5.0  # rejected replies in 1/s: of several that wait, each tries once a second
SMALL_DISK = 200_000_000  # B
SHORT_TIME = 600.0  # s until the disk is full


def examine(seen: Observations) -> list[Finding]:
    """Return the findings about a running graph, problems first."""
    findings = [finding for rule in RULES for finding in rule(seen)]
    return sorted(findings, key=lambda finding: finding.severity != "problem")


def _launcher(seen: Observations) -> Iterator[Finding]:
    if seen.launcher is None:
        yield Finding("note", "no_launcher", "launcher")
    elif not seen.launcher.answers:
        yield _silent("launcher", seen.launcher)
    elif seen.phase in ("starting", "engaging"):
        yield Finding("note", "starting", "launcher", {"phase": seen.phase})
    elif seen.phase == "stopping":
        yield Finding("note", "stopping", "launcher")


def _processes(seen: Observations) -> Iterator[Finding]:
    for name, process in seen.processes.items():
        data = {"node": name, "state": process.state, "restarts": process.restarts or None}
        if process.state == "starting":
            yield Finding("note", "process_starting", name, data)
        elif process.state == "lost":
            yield Finding("problem", "device_lost", name, data)
        elif process.state in ("restarting", "ended"):
            yield Finding("problem", "process_dead", name, data)
        elif process.state in ("stopped", "stopping"):
            is_missed = name != "environment" or not _delivered(seen, "force_command")
            yield Finding("problem" if is_missed else "note", "process_stopped", name, data)
        elif not process.answers:
            yield _silent(name, process)
        elif process.restarts:
            yield Finding("note", "restarts", name, data)


def _silent(name: str, process: ProcessSeen) -> Finding:
    is_suspended = process.kernel_state in SUSPENDED
    data = {"pid": process.pid, "kernel_state": process.kernel_state or None}
    return Finding("problem", "suspended" if is_suspended else "no_answer", name, data)


def _chain(seen: Observations) -> Iterator[Finding]:
    if _delivered(seen, "force_command"):
        return  # what arrives at the end has passed every hop
    for topic in LINKS:
        sender, receiver = str(TOPICS[topic].sender), str(TOPICS[topic].receiver)
        sending, receiving = seen.process(sender), seen.process(receiver)
        if sender in seen.processes and not sending.answers:
            return  # has a finding of its own
        if receiver not in seen.processes:
            continue  # on another machine
        if not receiving.answers:
            return
        if sender not in seen.processes and receiving.status("remote", "connected") is False:
            return  # has a finding of its own
        if not receiving.growth("received", topic):
            yield _nothing_arrives(seen, topic, sender, receiver)
            return
        if not _delivered(seen, topic):
            lost = sum(receiving.rate("links", topic, fate) for fate in ("lost", "corrupted"))
            arriving = receiving.rate("received", topic)
            data = {"receiver": receiver, "received": arriving, "lost": lost}
            causes = (Fact("injected_loss", {"topic": topic}),)
            yield Finding("problem", "hop_broken", f"link {topic}", data, causes)
            return


def _delivered(seen: Observations, topic: str) -> int:
    """Return how many packets of a topic have reached the node that they are for."""
    receiver = seen.process(str(TOPICS[topic].receiver))
    if not receiver.answers:
        return 0
    if receiver.status("links", topic) is not None:
        return receiver.growth("links", topic, "delivered")
    return receiver.growth("received", topic)


def _nothing_arrives(seen: Observations, topic: str, sender: str, receiver: str) -> Finding:
    receiving, sending = seen.process(receiver), seen.process(sender)
    data = {
        "receiver": receiver,
        "silence": receiving.interval,
        "earlier": receiving.status("received", topic) or 0,
        "sender": sender,
    }
    cause = "sender_silent"
    if sender not in seen.processes:
        cause = "sender_elsewhere"
    elif topic == "environment_reply":
        data["queries"] = sending.rate("received", "environment_query")
        data["failures"] = sending.status("failures") or None
        cause = "environment_fails" if data["failures"] else "environment_slow"
    elif topic == "force_command" and sending.growth("rejected", "second_environment"):
        cause = "replies_rejected"
    causes = (Fact(cause, {"sender": sender}),)
    return Finding("problem", "hop_broken", f"link {topic}", data, causes)


def _environments(seen: Observations) -> Iterator[Finding]:
    controller, environment = seen.process("controller"), seen.process("environment")
    own = environment.status("name")
    if "controller" not in seen.processes:
        yield from _serves_elsewhere(environment)
    if not controller.answers:
        return
    serving = controller.status("environment")
    rejected = controller.rate("rejected", "second_environment")
    data = {"serving": serving, "rate": rejected, "other": own if own != serving else None}
    if rejected > WAITING_RATE:
        yield Finding("problem", "second_environment", "controller", data)
    elif rejected:
        yield Finding("note", "waiting_environment", "controller", data)
    elif None not in (own, serving) and own != serving:
        data = {"serving": serving, "own": own}
        yield Finding("note", "other_environment", "controller", data)


def _serves_elsewhere(environment: ProcessSeen) -> Iterator[Finding]:
    """Say what an environment knows of its graph, which is on another machine."""
    queries = environment.rate("received", "environment_query")
    if not environment.status("remote", "connected") or not queries:
        return  # has a finding of its own
    own, other = environment.status("name"), environment.status("refused_for")
    data = {"queries": queries, "serving": other or own, "waiting": own if other else None}
    yield Finding("note", "remote_connected", "remote link of the environment", data)


def _remote(seen: Observations) -> Iterator[Finding]:
    for name, process in seen.processes.items():
        remote = process.status("remote")
        if remote is None:
            continue
        where = f"remote link of the {name}"
        if not remote["connected"]:
            is_served = name == "controller" and _delivered(seen, "force_command") > 0
            data = {
                "listens_at" if remote["listens"] else "connects_to": remote["address"],
                "port": remote["port"],
                "other_end": "launch" if name == "environment" else "node environment",
            }
            severity: Severity = "note" if is_served else "problem"
            yield Finding(severity, "remote_not_connected", where, data)
        for kind in (name for name, kind in KINDS.items() if kind.is_problem):
            count = remote["counts"].get(kind, 0)
            recent = process.growth("remote", "counts", kind)
            if count:
                severity = "problem" if recent or not remote["connected"] else "note"
                data = {"count": count, "recent": recent}
                yield Finding(severity, f"remote_{kind}", where, data)


def _rejected(seen: Observations) -> Iterator[Finding]:
    is_reordered = any(
        link.jitter or link.reorder or link.duplicate or link.trace
        for link in seen.config.links.values()
    )
    for name, process in seen.processes.items():
        for reason in process.status("rejected") or ():
            rate = process.rate("rejected", reason)
            if not rate or reason == "second_environment":  # which has a finding of its own
                continue
            is_expected = is_reordered and reason == "not_newer"
            kind = f"rejected_{reason if reason in REASONS else 'unknown'}"
            data = {"rate": rate, "reason": reason}
            yield Finding("note" if is_expected else "problem", kind, name, data)


def _force(seen: Observations) -> Iterator[Finding]:
    telemetry = seen.telemetry
    if telemetry.time_ns.size == 0:
        if seen.process("device").answers and seen.phase not in ("starting", "stopping"):
            yield Finding("problem", "no_telemetry", "device")
        return
    unanswered = (telemetry.device_seq < 0) & (telemetry.elapsed > 0.0)
    if not unanswered.any():
        return
    data = {"age_limit": seen.config.device.servo.age_limit}
    recent = telemetry.time_ns >= telemetry.time_ns[-1] - NOW * 1e9
    if unanswered[recent].all():
        answered = np.flatnonzero(~unanswered)
        start = int(answered[-1]) + 1 if answered.size else 0
        silence = float(telemetry.time_ns[-1] - telemetry.time_ns[start]) * 1e-9
        yield Finding("problem", "no_force", "device", {**data, "silence": silence})
        return
    gaps = {"share": float(unanswered.mean()), "ticks": unanswered.size}
    yield Finding("problem", "force_gaps", "device", {**data, **gaps})


def _delay(seen: Observations) -> Iterator[Finding]:
    delays = seen.telemetry.loop_delay[~np.isnan(seen.telemetry.loop_delay)]
    if delays.size == 0:
        return
    servo = seen.config.device.servo
    p50, p99 = np.percentile(delays, (50, 99)).tolist()
    data = {"p50": p50, "p99": p99}
    injected = _injected_delay(seen.config)
    if p99 > NEAR_AGE_LIMIT * servo.age_limit:
        data["age_limit"] = servo.age_limit
        yield Finding("problem", "delay_near_age_limit", "loop", data)
    elif injected is None or seen.config.remote is not None:
        return
    elif p50 > injected + LATE_PERIODS / servo.rate:
        data |= {"injected": injected, "period": 1.0 / servo.rate}
        yield Finding("problem", "late_loop", "loop", data, _lateness(seen))


def _injected_delay(config: GraphConfig) -> float | None:
    """Return what links and environment add to the loop at most, in s; None: hard to say."""
    ways = [config.links[topic] for topic in LINKS if topic in config.links]
    ways += [config.environment.computation] * 2  # a query may have to wait for the one before
    if any(not way.is_plain or way.loss for way in ways):
        return None
    return sum(way.delay + way.jitter for way in ways)


def _ticks(seen: Observations) -> Iterator[Finding]:
    telemetry = seen.telemetry
    if telemetry.time_ns.size < 2:
        return
    lost = int(telemetry.deadline_misses[-1] - telemetry.deadline_misses[0])
    if lost <= 0:
        return
    duration = float(telemetry.time_ns[-1] - telemetry.time_ns[0]) * 1e-9
    share = lost / (lost + telemetry.time_ns.size)
    data = {"rate": lost / duration, "share": share}
    severity: Severity = "problem" if share >= LOST_TICKS_SHARE else "note"
    yield Finding(severity, "ticks_lost", "device", data, _lateness(seen))


def _lateness(seen: Observations) -> tuple[Fact, ...]:
    """Return the likely causes of lateness."""
    facts = [realtime.Fact(**fact) for fact in seen.process("device").status("realtime") or ()]
    causes = [Fact(fact.code, fact.data) for fact in facts if fact.is_hindrance]
    if seen.neighbours:
        data = {"core": seen.core, "graphs": ", ".join(seen.neighbours)}
        causes.append(Fact("core_shared", data))
    if seen.load > seen.cores:
        causes.append(Fact("load", {"load": seen.load, "cores": seen.cores}))
    return tuple(causes) or (Fact("unknown"),)


def _links(seen: Observations) -> Iterator[Finding]:
    for process in seen.processes.values():
        for topic in process.status("links") or ():
            fates = ("sent", "lost", "corrupted")
            counts = {fate: process.growth("links", topic, fate) for fate in fates}
            # If all are lost, the chain is broken there.
            if 0 < counts["lost"] + counts["corrupted"] < counts["sent"]:
                data = {"topic": topic, **counts}
                yield Finding("note", "injected_loss", f"link {topic}", data)


def _recorder(seen: Observations) -> Iterator[Finding]:
    recorder, recording = seen.process("recorder"), seen.recording
    if not recorder.answers:
        return
    state = recorder.status("recording") or COMPLETE
    if state != COMPLETE:
        data = {"state": state, "path": recording.path}
        yield Finding("problem", "not_recording", "recorder", data)
    elif recording.free is not None:
        left = recording.free / recording.rate if recording.rate else None
        if recording.free < SMALL_DISK or (left is not None and left < SHORT_TIME):
            data = {"path": recording.path, "free": recording.free, "rate": recording.rate}
            yield Finding("problem", "disk_nearly_full", "recorder", {**data, "left": left})
    if seen.telemetry.time_ns.size and not recorder.growth("received", "telemetry"):
        yield Finding("problem", "recorder_deaf", "recorder", {"interval": recorder.interval})


def _law(seen: Observations) -> Iterator[Finding]:
    law = seen.config.device.servo.law
    if law == "none":
        yield Finding("note", "no_law", "device")
        return
    section = to_document(seen.config)["device"]
    if not is_limited(seen.telemetry, section):
        return
    limited, pushing = limited_ticks(seen.telemetry, section)
    commanded, applied = magnitudes(seen.telemetry, section)
    data = {
        "law": law,
        "share": float(limited.sum() / pushing.sum()),
        "commanded": float(commanded[limited].mean()),
        "applied": float(applied[limited].mean()),
    }
    device = seen.process("device")
    report = dict(device.status("bounder") or {})
    report["overruns"] = device.growth("bounder", "overruns")
    causes = causes_of_little_force(seen.telemetry, section, report)
    facts = tuple(Fact(cause.code, cause.data) for cause in causes)
    yield Finding("note", "law_limits", "device", data, facts)


Rule: TypeAlias = Callable[[Observations], Iterator[Finding]]

RULES: tuple[Rule, ...] = (
    _launcher,
    _processes,
    _chain,
    _remote,
    _environments,
    _force,
    _rejected,
    _delay,
    _ticks,
    _recorder,
    _links,
    _law,
)
