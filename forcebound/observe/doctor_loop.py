"""Diagnosis of a running graph: its force, delays, ticks, recording and law."""

import math
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from forcebound.graph.graph import GraphConfig
from forcebound.graph.names import LAW, parameter_name
from forcebound.graph.resolved import to_document
from forcebound.messages.control import DeviceStatus, RecorderStatus
from forcebound.messages.topology import LINKS, flat, node_name
from forcebound.observe.findings import Finding, note, problem
from forcebound.observe.observation import Observations
from forcebound.results.bounder import Cause, Limited
from forcebound.results.figures import OF_STATE
from forcebound.results.samples import Samples
from forcebound.results.state import Passivity, state
from forcebound.results.summary import figures_of
from forcebound.results.ticks import reads_and_writes
from forcebound.roles import DEVICE
from forcebound.run.process.recorder import COMPLETE
from forcebound.units import N

NEAR_AGE_LIMIT = 0.7  # of it; beyond, a little more delay takes the force away
LATE_PERIODS = 3.0  # above the delay that is injected; an idle machine needs less than 1.5
LOST_TICKS_SHARE = 0.01  # of all ticks, from which on it is a problem
NOW = 0.2  # s without an answer that make it "now"
SMALL_DISK = 200_000_000  # B
SHORT_TIME = 600.0  # s until the disk is full

LESS_DELAY = "less delay or loss on the links, or a larger device.age_limit"


def _force(seen: Observations) -> Iterator[Finding]:
    telemetry = seen.telemetry
    if telemetry.time_ns.size == 0:
        if seen.of(DeviceStatus).last is not None and seen.phase not in ("starting", "stopping"):
            words, action = "answers, but sends no telemetry", "does it hang in its driver?"
            yield problem("no_telemetry", seen.name(DEVICE), words, action)
        return
    unanswered = (telemetry.device_seq < 0) & (telemetry.elapsed > 0.0)
    if not unanswered.any():
        return
    limit = seen.config.only.servo.age_limit
    why = f"no answer younger than the age limit of {1e3 * limit:g} ms"
    recent = telemetry.time_ns >= telemetry.time_ns[-1] - NOW * 1e9
    if unanswered[recent].all():
        answered = np.flatnonzero(~unanswered)
        start = int(answered[-1]) + 1 if answered.size else 0
        silence = float(telemetry.time_ns[-1] - telemetry.time_ns[start]) * 1e-9
        words = f"no force: for {silence:.1f} s and more {why}"
        action = f"repair the link or process named here; else {LESS_DELAY}"
        yield problem("no_force", seen.name(DEVICE), words, action)
        return
    words = f"no force in {unanswered.mean():.1%} of {unanswered.size} ticks: {why}"
    action = f"{LESS_DELAY}; force returns over the engage ramp"
    yield problem("force_gaps", seen.name(DEVICE), words, action)


def _delay(seen: Observations) -> Iterator[Finding]:
    delays = seen.telemetry.loop_delay[~np.isnan(seen.telemetry.loop_delay)]
    if delays.size == 0:
        return
    servo = seen.config.only.servo
    p50, p99 = np.percentile(delays, (50, 99)).tolist()
    words = f"loop delay p50 {1e3 * p50:.1f} ms, p99 {1e3 * p99:.1f} ms"
    injected = _injected_delay(seen.config)
    if p99 > NEAR_AGE_LIMIT * servo.age_limit:
        words += f": near the age limit of {1e3 * servo.age_limit:g} ms"
        words += ", beyond which there is no force"
        command = f"forcebound param get {parameter_name(seen.hand, 'links')}"
        yield problem(
            "delay_near_age_limit", node_name(seen.hand, "loop"), words, LESS_DELAY, command
        )
    elif (
        injected is not None
        and seen.config.only.remote is None
        and p50 > injected + LATE_PERIODS / servo.rate
    ):
        words += f"; injected are at most {1e3 * injected:.1f} ms"
        words += f", the period is {1e3 / servo.rate:g} ms"
        yield problem("late_loop", node_name(seen.hand, "loop"), words, causes=_lateness(seen))
    elif p50 > LATE_PERIODS / servo.rate:
        words += ": costs stiffness, never passivity"
        yield note("delayed_loop", node_name(seen.hand, "loop"), words, "less delay on the links")


def _injected_delay(config: GraphConfig) -> float | None:
    """Return what links and environment add to the loop at most, in s; None: hard to say."""
    parts = [config.only.links[topic] for topic in LINKS if topic in config.only.links]
    parts += [config.environment.computation] * 2  # a query may have to wait for the one before
    if any(not part.is_plain or part.loss for part in parts):
        return None
    return sum(part.delay + part.jitter for part in parts)


def _ticks(seen: Observations) -> Iterator[Finding]:
    telemetry = seen.telemetry
    if telemetry.time_ns.size < 2:
        return
    lost = int(telemetry.deadline_misses[-1] - telemetry.deadline_misses[0])
    if lost <= 0:
        return
    rate = lost / (float(telemetry.time_ns[-1] - telemetry.time_ns[0]) * 1e-9)
    share = lost / (lost + telemetry.time_ns.size)
    words = f"loses {rate:.3g} ticks/s, {share:.1%} of all: costs force, never safety"
    report = problem if share >= LOST_TICKS_SHARE else note
    yield report("ticks_lost", seen.name(DEVICE), words, causes=_lateness(seen))


def _lateness(seen: Observations) -> tuple[Cause, ...]:
    """Return the likely causes of lateness."""
    device = seen.of(DeviceStatus).last
    facts = [] if device is None else device.realtime
    causes = [Cause(fact.code, fact.sentence) for fact in facts if fact.is_hindrance]
    busy = (reads_and_writes(seen.telemetry) or 0.0) * seen.config.only.servo.rate
    if busy > 1.0:
        advice = f"the device's own reads and writes take {busy:.2g} periods: a lower device.rate"
        causes.append(Cause("slow_device", advice))
    if seen.neighbours:
        graphs = ", ".join(seen.neighbours)
        advice = f"core {seen.core} is shared with {graphs}: set realtime.cores"
        causes.append(Cause("core_shared", advice))
    if seen.load > seen.cores:
        advice = (
            f"the load is {seen.load:.1f} on {seen.cores} cores: end what is not needed, or keep "
            "it off the core (taskset, isolcpus)"
        )
        causes.append(Cause("load", advice))
    unknown = "cause unknown, see what this machine can do"
    return tuple(causes) or (Cause("unknown", unknown, "forcebound doctor --measure"),)


def _recorder(seen: Observations) -> Iterator[Finding]:
    recorder, recording = seen.of(RecorderStatus), seen.recording
    telemetry = node_name(seen.hand, "telemetry")
    if recorder.last is None:
        return
    state = recorder.last.recording
    if state != COMPLETE:
        words = f"recording {state}; the graph goes on without ({recording.path})"
        action = "make room, then start the run again: this recording ends here"
        yield problem("not_recording", "recorder", words, action)
    elif recording.free is not None:
        left = recording.free / recording.rate if recording.rate else None
        if recording.free < SMALL_DISK or (left is not None and left < SHORT_TIME):
            words = (
                f"{1e-6 * recording.free:.0f} MB are left for {recording.path}, "
                f"{1e-6 * recording.rate:.2g} MB/s are written"
            )
            words += "" if left is None else f": full in {left / 60:.0f} min"
            yield problem("disk_nearly_full", "recorder", words, "make room")
    if seen.telemetry.time_ns.size and not recorder.received(telemetry):
        words = f"receives no {telemetry} ({recorder.interval:.1f} s)"
        yield problem("recorder_deaf", "recorder", words, "start the run again")


def _law(seen: Observations) -> Iterator[Finding]:
    law = seen.config.only.servo.law
    if law == "none":
        words = "law none: nothing protects the hand from what environment and network do"
        command = f"forcebound param set {parameter_name(seen.hand, LAW)}:=certified"
        yield note("no_law", seen.name(DEVICE), words, command=command)
        return
    run = _run(seen)
    force = Limited(seen.telemetry, run.device)
    if not force:
        return
    unit = run.launched.shown(N).unit
    share = float(force.limited.sum() / force.pushing.sum())
    commanded, applied = (float(one[force.limited].mean()) for one in (force.wanted, force.applied))
    words = (
        f"law {law} limits the force in {share:.0%} of the ticks with one: "
        f"of {commanded:.2g} {unit} commanded it applies {applied:.2g} {unit}"
    )
    yield note("law_limits", seen.name(DEVICE), words, causes=tuple(run.causes))


def _run(seen: Observations) -> Samples:
    """Return what was seen as a run, with the true energy since its law began, if that is known."""
    device, telemetry = seen.of(DeviceStatus), seen.telemetry
    before = [math.nan if one is None else one.energy_before for one in (device.first, device.last)]
    energy = telemetry.true_energy - (before[1] if before[0] == before[1] else math.nan)
    run = Samples(replace(telemetry, true_energy=energy), flat(to_document(seen.config)))
    run.report = None if device.last is None else device.last.bounder
    return run


def _state(seen: Observations) -> Iterator[Finding]:
    if not seen.telemetry.time_ns.size:
        return
    run = _run(seen)
    now = state(figures_of(run, OF_STATE), run.launched)
    if now.kind in (Passivity.NOT_PASSIVE, Passivity.UNCOVERED):
        yield problem(now.kind, seen.name(DEVICE), now.passivity.removesuffix("."))


LOOP_RULES: tuple[Callable[[Observations], Iterator[Finding]], ...] = (
    _force,
    _delay,
    _ticks,
    _recorder,
    _state,
    _law,
)
