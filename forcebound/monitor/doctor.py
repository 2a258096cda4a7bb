"""What is wrong with a running graph, now, and what to do about it?

:func:`examine` judges what :mod:`forcebound.monitor.observation` saw, and touches nothing. Each
rule gives findings; a cause is told once, and not again by all that follows from it: of the chain
device, controller, environment, controller, device only the first hop that is broken is named.

To add a rule: a function from observations to findings, and its name in ``RULES``.
"""

from collections.abc import Callable, Iterator
from typing import TypeAlias

import numpy as np

from forcebound import realtime
from forcebound.bounding import LAWS
from forcebound.config.graph import GraphConfig
from forcebound.messages.packets import LINKS, TOPICS
from forcebound.monitor.advice import NOTICES, REASONS, UNKNOWN_REASON
from forcebound.monitor.findings import Finding, Severity
from forcebound.monitor.observation import SUSPENDED, Observations, ProcessSeen
from forcebound.process import COMPLETE

NEAR_AGE_LIMIT = 0.7  # of it; beyond, a little more delay takes the force away
LATE_PERIODS = 3.0  # above the delay that is injected; an idle machine needs less than 1.5
LOST_TICKS_SHARE = 0.01  # of all ticks, from which on it is a problem
NOW = 0.2  # s without an answer that make it "now"
LIMITED_SHARE = 0.5  # of the ticks with a force in which the law makes it smaller
UNBOUNDED = 1.0 - 1e-9  # of the force asked; below, it was made smaller, not merely rounded
WAITING_RATE = 5.0  # refused answers in 1/s: those of several that wait, each knocks once a second
SMALL_DISK = 200_000_000  # B
SHORT_TIME = 600.0  # s until the disk is full


def examine(seen: Observations) -> list[Finding]:
    """Return what there is to say about a running graph, problems first."""
    findings = [finding for rule in RULES for finding in rule(seen)]
    return sorted(findings, key=lambda finding: finding.severity != "problem")


def _launcher(seen: Observations) -> Iterator[Finding]:
    launcher = seen.launcher
    if launcher is None:
        text = "no launcher: the nodes were started by hand, and nobody starts them anew"
        yield Finding("note", "no_launcher", "launcher", text)
    elif not launcher.answers:
        yield _silent("launcher", launcher)
    elif seen.phase in ("starting", "engaging"):
        yield Finding("note", "starting", "launcher", f"the run is {seen.phase}: no force yet")
    elif seen.phase == "stopping":
        yield Finding("note", "stopping", "launcher", "the run comes to its end")


def _processes(seen: Observations) -> Iterator[Finding]:
    for name, process in seen.processes.items():
        if process.state == "starting":
            text = "starts, and does not answer yet" + _restarts(process)
            yield Finding("note", "process_starting", name, text, "wait a second and ask again")
        elif process.state in ("restarting", "ended"):
            text = "is dead" + _restarts(process)
            action = "the launcher starts it anew; the launcher's log says why it died"
            action = action if process.state == "restarting" else "the launcher's log says why"
            yield Finding("problem", "process_dead", name, text, action)
        elif process.state in ("stopped", "stopping"):
            is_missed = name != "environment" or _delivered(seen, "force_command") == 0
            text = f"is {process.state} on request"
            severity: Severity = "problem" if is_missed else "note"
            action = f"forcebound start {name}"
            yield Finding(severity, "process_stopped", name, text, action)
        elif not process.answers:
            yield _silent(name, process)
        elif process.restarts:
            text = f"was started anew {process.restarts} times in this run"
            yield Finding("note", "restarts", name, text, "the launcher's log says why it died")


def _silent(name: str, process: ProcessSeen) -> Finding:
    if process.kernel_state in SUSPENDED:
        text = f"does not answer: process {process.pid} is suspended (SIGSTOP, Ctrl-Z, debugger)"
        action = f"kill -CONT {process.pid}"
        return Finding("problem", "suspended", name, text, action)
    if process.pid is None:
        action = "is it alive? It may be gone, suspended, or in an endless loop"
        return Finding("problem", "no_answer", name, "does not answer", action)
    text = f"does not answer: process {process.pid} is in state {process.kernel_state or '?'}"
    action = f"it computes without an end, or waits for something; see top -p {process.pid}"
    return Finding("problem", "no_answer", name, text, action)


def _restarts(process: ProcessSeen) -> str:
    return f"; started anew {process.restarts} times in this run" if process.restarts else ""


def _chain(seen: Observations) -> Iterator[Finding]:
    if _delivered(seen, "force_command"):
        return  # what comes at the end has come all the way
    for topic in LINKS:
        _, sender, receiver = TOPICS[topic]
        assert sender is not None
        assert receiver is not None
        sending, receiving = seen.processes.get(sender), seen.processes.get(receiver)
        if sending is not None and not sending.answers:
            return  # has been said
        if receiving is None:
            continue  # on another machine
        if not receiving.answers:
            return
        if sending is None and receiving.status("remote", "connected") is False:
            return  # has a finding of its own
        if receiving.growth("received", topic) == 0:
            yield _nothing_comes(seen, topic, sender, receiver)
            return
        if not _delivered(seen, topic):
            lost = receiving.rate("links", topic, "lost")
            lost += receiving.rate("links", topic, "corrupted")
            came = receiving.rate("received", topic)
            text = f"nothing gets through to the {receiver}: {came:.3g} packets/s come,"
            text += f" {lost:.3g}/s are lost on purpose (links.{topic})"
            action = f"forcebound param get links.{topic}, then such as"
            action += f" forcebound param set links.{topic}.loss:=0"
            yield Finding("problem", "hop_broken", f"link {topic}", text, action)
            return


def _delivered(seen: Observations, topic: str) -> int:
    """How many packets of a topic have reached the node that they are for."""
    receiver = seen.processes.get(TOPICS[topic].receiver or "")
    if receiver is None or not receiver.answers:
        return 0
    if receiver.status("links", topic) is not None:
        return receiver.growth("links", topic, "delivered")
    return receiver.growth("received", topic)


def _nothing_comes(seen: Observations, topic: str, sender: str, receiver: str) -> Finding:
    process = seen.processes[receiver]
    never = not process.status("received", topic)
    text = f"{receiver} has received nothing" + (" so far" if never else " now")
    text += f" (0 packets in {process.interval:.1f} s)"
    action = f"see what the {sender} says in the log"
    sending = seen.processes.get(sender)
    if sending is None:
        action = f"is the {sender} running? It is not on this machine, or not in this run directory"
    elif topic == "environment_reply":
        queries = sending.rate("received", "environment_query")
        text += f", and the {sender} gets {queries:.3g} queries/s"
        if sending.status("failures"):
            text += f"; its code has failed to answer {sending.status('failures')} times"
            action = "its log says how; then try forcebound check environment FILE"
        else:
            action = "does it compute for longer than that (environment.compute_delay)? See its log"
    elif topic == "force_command" and sending.growth("rejected", "second_environment"):
        action = "the controller refuses all answers: they are of an environment not wanted"
    return Finding("problem", "hop_broken", f"link {topic}", text, action)


def _environments(seen: Observations) -> Iterator[Finding]:
    controller, environment = seen.processes.get("controller"), seen.processes.get("environment")
    own = None if environment is None else environment.status("name")
    if controller is None and environment is not None:
        yield from _serves_elsewhere(environment)
    if controller is None or not controller.answers:
        return
    serving = controller.status("environment")
    refused = controller.rate("rejected", "second_environment")
    another = f"another, {own}," if own is not None and own != serving else "another one"
    if refused > WAITING_RATE:
        text = f"two environments answer: {serving} serves, {refused:.2g} answers/s of {another}"
        action = REASONS["second_environment"].action
        yield Finding("problem", "second_environment", "controller", f"{text} are refused", action)
    elif refused:
        text = f"{serving} serves; {another} waits, and takes over when that has been silent"
        yield Finding("note", "waiting_environment", "controller", text)
    elif own is not None and serving is not None and own != serving:
        text = f"{serving} serves, not {own} of this launcher"
        yield Finding("note", "other_environment", "controller", text)


def _serves_elsewhere(environment: ProcessSeen) -> Iterator[Finding]:
    """What an environment for a graph on another machine knows of it."""
    remote = environment.status("remote")
    if remote is None or not remote["connected"]:
        return  # has been said
    queries = environment.rate("received", "environment_query")
    own, other = environment.status("name"), environment.status("refused_for")
    text = f"connected with the graph, {queries:.3g} queries/s come; "
    text += f"{own} serves" if other is None else f"{other} serves, and {own} waits"
    if queries:
        yield Finding("note", "remote_connected", "remote link of the environment", text)


def _remote(seen: Observations) -> Iterator[Finding]:
    for name, process in seen.processes.items():
        remote = process.status("remote")
        if remote is None:
            continue
        where = f"remote link of the {name}"
        connected = bool(remote["connected"])
        if not connected:
            does = "listens at" if remote["listens"] else "connects to"
            text = f"nobody is there; it {does} {remote['address']} port {remote['port']}"
            text += f" and {int(remote['port']) + 1}"
            served = name == "controller" and _delivered(seen, "force_command") > 0
            action = "start the other end: forcebound node environment FILE"
            if name == "environment":
                action = "start the other end: forcebound launch FILE"
            severity: Severity = "note" if served else "problem"
            yield Finding(severity, "remote_not_connected", where, text, action)
        for kind, advice in NOTICES.items():
            count, growth = (
                int(remote["counts"].get(kind, 0)),
                process.growth("remote", "counts", kind),
            )
            if growth or (count and not connected):
                text = f"{advice.meaning} ({kind}: {count} times, {growth} just now)"
                yield Finding("problem", f"remote_{kind}", where, text, advice.action)
            elif count:
                text = f"{advice.meaning} ({kind}: {count} times, not now)"
                yield Finding("note", f"remote_{kind}", where, text, advice.action)


def _rejected(seen: Observations) -> Iterator[Finding]:
    injected = any(
        link.jitter or link.reorder or link.duplicate or link.trace
        for link in seen.config.links.values()
    )
    for name, process in seen.processes.items():
        for reason in process.status("rejected") or ():
            rate = process.rate("rejected", reason)
            if not rate or reason == "second_environment":  # which has a finding of its own
                continue
            advice = REASONS.get(reason, UNKNOWN_REASON)
            text = f"refuses {rate:.3g} packets/s as {reason}: {advice.meaning}"
            severity: Severity = "note" if injected and reason == "not_newer" else "problem"
            yield Finding(severity, f"rejected_{reason}", name, text, advice.action)


def _force(seen: Observations) -> Iterator[Finding]:
    telemetry = seen.telemetry
    device = seen.processes.get("device")
    if telemetry.time_ns.size == 0:
        if device is not None and device.answers and seen.phase not in ("starting", "stopping"):
            text = "answers, but sends no telemetry"
            yield Finding("problem", "no_telemetry", "device", text, "does it hang in its driver?")
        return
    unanswered = (telemetry.device_seq < 0) & (telemetry.elapsed > 0.0)
    if not unanswered.any():
        return
    limit = f"{seen.config.device.servo.age_limit * 1e3:g} ms"
    without = f"no answer younger than the age limit of {limit}"
    recent = telemetry.time_ns >= telemetry.time_ns[-1] - NOW * 1e9
    if unanswered[recent].all():
        answered = np.flatnonzero(~unanswered)
        start = int(answered[-1]) + 1 if answered.size else 0
        silence = (telemetry.time_ns[-1] - telemetry.time_ns[start]) * 1e-9
        text = f"no force: for {silence:.1f} s and more {without}"
        action = "repair the link or process named here; delays need a larger device.age_limit"
        yield Finding("problem", "no_force", "device", text, action)
        return
    text = f"no force in {unanswered.mean():.1%} of {unanswered.size} ticks: {without}"
    action = "less delay or loss, or a larger device.age_limit; force returns over the engage ramp"
    yield Finding("problem", "force_gaps", "device", text, action)


def _delay(seen: Observations) -> Iterator[Finding]:
    delays = seen.telemetry.loop_delay[~np.isnan(seen.telemetry.loop_delay)]
    if delays.size == 0:
        return
    servo = seen.config.device.servo
    p50, p99 = np.percentile(delays, (50, 99)).tolist()
    text = f"loop delay p50 {p50 * 1e3:.1f} ms, p99 {p99 * 1e3:.1f} ms"
    if p99 > NEAR_AGE_LIMIT * servo.age_limit:
        text += f": near the age limit of {servo.age_limit * 1e3:g} ms, beyond which no force is"
        action = "less delay (forcebound param get links), or a larger device.age_limit"
        yield Finding("problem", "delay_near_age_limit", "loop", text, action)
        return
    injected = _injected_delay(seen.config)
    if injected is None or seen.config.remote is not None:
        return
    if p50 > injected + LATE_PERIODS / servo.rate:
        text += f", of which {injected * 1e3:.1f} ms at most are injected; the period is"
        text += f" {1e3 / servo.rate:g} ms"
        yield Finding("problem", "late_loop", "loop", text, _punctuality(seen))


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
    duration = (telemetry.time_ns[-1] - telemetry.time_ns[0]) * 1e-9
    share = lost / (lost + telemetry.time_ns.size)
    text = f"loses {lost / duration:.3g} ticks/s, {share:.1%} of all: costs force, never safety"
    severity: Severity = "problem" if share >= LOST_TICKS_SHARE else "note"
    yield Finding(severity, "ticks_lost", "device", text, _punctuality(seen))


def _punctuality(seen: Observations) -> str:
    """Return the likely causes of lateness, with what to do about each."""
    device = seen.processes.get("device")
    told = () if device is None else device.status("realtime") or ()
    facts = [realtime.Fact(fact["code"], fact["data"]) for fact in told]
    causes = [fact.sentence for fact in facts if fact.is_hindrance]
    if seen.neighbours:
        others = ", ".join(seen.neighbours)
        causes.append(f"core {seen.core} is shared with {others}: set realtime.cores")
    if seen.load > seen.cores:
        causes.append(
            f"the load is {seen.load:.1f} on {seen.cores} cores: end what is not needed, or keep it"
            " off the core (taskset, isolcpus)"
        )
    unknown = "cause unknown; forcebound bench servo shows what this machine can do"
    return "; ".join(causes) or unknown


def _links(seen: Observations) -> Iterator[Finding]:
    for process in seen.processes.values():
        for topic in process.status("links") or ():
            came = process.growth("links", topic, "sent")
            lost = process.growth("links", topic, "lost")
            corrupted = process.growth("links", topic, "corrupted")
            if not 0 < lost + corrupted < came:  # if it is all, the chain is broken there
                continue
            text = f"loses {lost} and damages {corrupted} of {came} packets, on purpose"
            action = f"forcebound param get links.{topic}"
            yield Finding("note", "injected_loss", f"link {topic}", text, action)


def _recorder(seen: Observations) -> Iterator[Finding]:
    recorder, recording = seen.processes.get("recorder"), seen.recording
    if recorder is None or not recorder.answers:
        return
    state = recorder.status("recording") or COMPLETE
    if state != COMPLETE:
        text = f"recording {state}; the graph goes on without ({recording.path})"
        action = "make room, then start the run again: this recording ends here"
        yield Finding("problem", "not_recording", "recorder", text, action)
    elif recording.free is not None:
        left = recording.free / recording.rate if recording.rate else float("inf")
        if recording.free < SMALL_DISK or left < SHORT_TIME:
            text = f"{recording.free / 1e6:.0f} MB are left for {recording.path}, which grows by"
            text += f" {recording.rate / 1e6:.2g} MB/s"
            text += f": full in {left / 60.0:.0f} min" if recording.rate else ""
            yield Finding("problem", "disk_nearly_full", "recorder", text, "make room")
    if seen.telemetry.time_ns.size and not recorder.growth("received", "telemetry"):
        text = f"receives no telemetry ({recorder.interval:.1f} s), though the device sends it"
        yield Finding("problem", "recorder_deaf", "recorder", text, "start the run again")


def _law(seen: Observations) -> Iterator[Finding]:
    law = seen.config.device.servo.law
    if law == "none":
        text = "law none: nothing protects the hand from what environment and network do"
        yield Finding("note", "no_law", "device", text, "device.law: certified, in the launch file")
        return
    asked = np.linalg.norm(seen.telemetry.commanded_force, axis=1)
    applied = np.linalg.norm(seen.telemetry.applied_force, axis=1)
    pushing = asked > 0.0
    if not pushing.any():
        return
    limited = (applied < UNBOUNDED * asked) & pushing
    share = limited.sum() / pushing.sum()
    if share > LIMITED_SHARE:
        text = f"law {law} limits the force in {share:.0%} of the ticks with one: of"
        text += f" {asked[limited].mean():.2g} N asked it shows {applied[limited].mean():.2g} N"
        action = "less delay or stiffness lets more force through"
        if not (LAWS.is_shipped(law) and LAWS[law].is_certified):
            action += "; this law is not certified"
        yield Finding("note", "law_limits", "device", text, action)


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
