"""Texts of findings, causes and notes: one table each, by code.

A text is a template that :func:`forcebound.monitor.wording.render` fills in: the names of the data
in braces. A number may name a unit after its format: ``{delay:.1f ms}`` writes 0.0123 s as
``12.3 ms``. A text may have further parts, each after a ``|``: such a part is left out if one of
its values is None or missing.

To add a finding: one line in :data:`FINDINGS`. To add a reason for a rejected packet: one line in
:data:`REASONS`. The remote link's are in :data:`forcebound.network.notices.KINDS`.
"""

from typing import NamedTuple

from forcebound import realtime
from forcebound.network.notices import KINDS


class Text(NamedTuple):
    """A finding or a fact in words."""

    seen: str = ""
    action: str = ""  # what to do; empty if there is nothing to do, or the command says it
    command: str = ""  # of a shell; capital letters stand for what the user knows


_LOG = "the launcher's log says why it ended"
_RESTARTED = "|; restarted {restarts} times in this run"
_LOOP_DELAY = "loop delay p50 {p50:.1f ms}, p99 {p99:.1f ms}"
_NO_ANSWER = "no answer younger than the age limit of {age_limit:g ms}"
_LESS_DELAY = "less delay or loss on the links, or a larger device.age_limit"
_ONE_ENVIRONMENT = "end one of the two; the other takes over after 1 s"
_ROOM = ("make room, or name another folder", "XDG_RUNTIME_DIR=FOLDER forcebound launch FILE")

# Of a graph.
FINDINGS: dict[str, Text] = {
    "no_launcher": Text("no launcher: an environment by itself, which none restarts"),
    "starting": Text("the run is {phase}: no force yet"),
    "stopping": Text("the run is ending"),
    "suspended": Text(
        "does not answer: process {pid} is suspended (SIGSTOP, Ctrl-Z, debugger)",
        command="kill -CONT {pid}",
    ),
    "no_answer": Text(
        "does not answer|: process {pid}| is in state {kernel_state}",
        "it computes without end, waits for something, is suspended or gone",
        "|top -p {pid}",
    ),
    "process_starting": Text(f"is starting{_RESTARTED}", "wait a second and ask again"),
    "process_dead": Text(f"has ended, its state is {{state}}{_RESTARTED}", _LOG),
    "device_lost": Text(
        "is lost: zero force; plug it in, switch it on, hold it in its home pose",
        command="forcebound device resume",
    ),
    "process_stopped": Text("is {state} on request", command="forcebound start {node}"),
    "restarts": Text("was restarted {restarts} times in this run", _LOG),
    "hop_broken": Text(
        "nothing gets through to the {receiver}"
        "|: no packet in {silence:.1f} s, {earlier} before"
        "|: {received:.3g} packets/s arrive, {lost:.3g}/s are lost on purpose"
        "|; the {sender} gets {queries:.3g} queries/s"
        "|; its code failed to answer {failures} times"
    ),
    "second_environment": Text(
        "two environments answer: {serving} serves, {rate:.2g} replies/s of another"
        "|, {other},| are rejected",
        _ONE_ENVIRONMENT,
    ),
    "waiting_environment": Text(
        "{serving} serves; another|, {other},| waits, and takes over when the first is silent"
    ),
    "other_environment": Text("{serving} serves, not {own} of this launcher"),
    "remote_connected": Text(
        "connected with the graph, {queries:.3g} queries/s; {serving} serves|, and {waiting} waits"
    ),
    "remote_not_connected": Text(
        "nobody is there|; it listens at {listens_at}|; it connects to {connects_to}| port {port}",
        "start the other end",
        "forcebound {other_end} FILE",
    ),
    "no_telemetry": Text("answers, but sends no telemetry", "does it hang in its driver?"),
    "no_force": Text(
        f"no force: for {{silence:.1f}} s and more {_NO_ANSWER}",
        f"repair the link or process named here; else {_LESS_DELAY}",
    ),
    "force_gaps": Text(
        f"no force in {{share:.1%}} of {{ticks}} ticks: {_NO_ANSWER}",
        f"{_LESS_DELAY}; force returns over the engage ramp",
    ),
    "delay_near_age_limit": Text(
        f"{_LOOP_DELAY}: near the age limit of {{age_limit:g ms}}, beyond which there is no force",
        _LESS_DELAY,
        "forcebound param get links",
    ),
    "late_loop": Text(
        f"{_LOOP_DELAY}; injected are at most {{injected:.1f ms}}, the period is {{period:g ms}}"
    ),
    "ticks_lost": Text("loses {rate:.3g} ticks/s, {share:.1%} of all: costs force, never safety"),
    "injected_loss": Text(
        "loses {lost} and damages {corrupted} of {sent} packets, on purpose",
        command="forcebound param get links.{topic}",
    ),
    "not_recording": Text(
        "recording {state}; the graph goes on without ({path})",
        "make room, then start the run again: this recording ends here",
    ),
    "disk_nearly_full": Text(
        "{free:.0f MB} are left for {path}, {rate:.2g MB/s} are written|: full in {left:.0f min}",
        "make room",
    ),
    "recorder_deaf": Text("receives no telemetry ({interval:.1f} s)", "start the run again"),
    "no_law": Text(
        "law none: nothing protects the hand from what environment and network do",
        command="forcebound param set device.law:=certified",
    ),
    "law_limits": Text(
        "law {law} limits the force in {share:.0%} of the ticks with one: "
        "of {commanded:.2g} N commanded it applies {applied:.2g} N"
    ),
}

# Of a machine.
FINDINGS |= {
    "fifo": Text("SCHED_FIFO is permitted: a node runs as soon as it has something to do"),
    "no_fifo": Text("SCHED_FIFO is not permitted: under load ticks are late", realtime.PERMIT_FIFO),
    "memory_lock": Text("may be locked: no tick waits for a page"),
    "no_memory_lock": Text(
        "at most {limit:.0f KiB} may be locked: now and then a tick waits for a page",
        realtime.PERMIT_LOCK,
    ),
    "rt_throttling": Text("SCHED_FIFO gets {share:.0%} of a core; the chain needs less than half"),
    "no_rt_time": Text(
        "SCHED_FIFO gets no time at all (sched_rt_runtime_us is 0)",
        command="sudo sysctl kernel.sched_rt_runtime_us=950000",
    ),
    "kernel": Text("{release}, PREEMPT_RT: wakes up within some 10 us"),
    "no_preempt_rt": Text(
        "{release}, without PREEMPT_RT: mostly punctual, rarely late by milliseconds",
        "if that is too late for you, a kernel with PREEMPT_RT (Debian: linux-image-rt-amd64)",
    ),
    "cores": Text("{cores} may be used"),
    "few_cores": Text("{cores} may be used, by all processes", "use a machine with 2 or more"),
    "load": Text("{load:.1f} processes wanted to run in the last minute"),
    "high_load": Text(
        "{load:.1f} processes wanted to run in the last minute: ticks may be late",
        "end what is not needed (top), or keep it off the highest core (taskset, isolcpus)",
    ),
    "governor": Text("{governor}"),
    "slow_governor": Text(
        "{governor}: the cores may be slow when a tick comes",
        command="sudo cpupower frequency-set -g performance",
    ),
    "timers": Text("of high resolution"),
    "coarse_timers": Text(
        "timers step by {resolution:g ms}: no servo of 1 kHz",
        "a kernel with CONFIG_HIGH_RES_TIMERS, not started with highres=off",
    ),
    "timer_slack": Text("{slack:g us} here; the nodes set theirs to 1 ns"),
    "clock_source": Text("{source}"),
    "slow_clock": Text(
        "{source}: each reading of the clock costs a microsecond or more",
        "if available_clocksource in this folder has tsc",
        "sudo sh -c 'echo tsc >/sys/devices/system/clocksource/clocksource0/current_clocksource'",
    ),
    "python": Text("{version}"),
    "libzmq": Text("{version}, with CURVE encryption"),
    "no_curve": Text(
        "{version}, without CURVE: no environment on another machine",
        command="pip install --force-reinstall --only-binary pyzmq pyzmq",
    ),
    "space": Text("{free:.1f GB} are free in {folder}"),
    "little_space": Text("{free:.0f MB} are free in {folder}: for minutes of recording", *_ROOM),
    "no_space": Text("{free:.1f MB} are free in {folder}: no run can begin", *_ROOM),
    "no_runtime_folder": Text("{folder} cannot be written: no run can begin", *_ROOM),
    "keys": Text("nothing wrong in {folder}"),
    "unsafe_keys": Text("{problem}", "{action}"),
    "port": Text("{port}"),
    "port_of_group": Text(
        "{port} may not be opened by this user",
        "join the group that may, then log in anew",
        "sudo usermod --append --groups {group} $USER",
    ),
    "port_of_nobody": Text(
        "{port} may be opened by root alone",
        "a rule of udev gives it to the group dialout, which you join; then plug it in anew",
        "sudo tee /etc/udev/rules.d/60-forcebound.rules <<< '{rule}';"
        " sudo udevadm control --reload; sudo usermod --append --groups dialout $USER",
    ),
}

# Reasons for a rejected packet, of codec, safety chain and controller: what it is, what to do.
_OTHER_SOFTWARE = "find the sender: a node of your own, or of another version of forcebound"
_ENCODER = "compare the sender with docs/protocol.md and its golden bytes"
REASONS: dict[str, Text] = {
    "malformed": Text("not one msgpack map with text keys", _OTHER_SOFTWARE),
    "version": Text("another version of the wire format", "use one version on both ends"),
    "keys": Text("a key is missing, unknown or twice, or another packet", _ENCODER),
    "value": Text("a value of a wrong type, range or length", _ENCODER),
    "unexpected": Text("a packet that the device takes from nobody", _OTHER_SOFTWARE),
    "wrong_length": Text(
        "a force with another number of axes than the device has",
        "let the environment answer with one number per axis",
    ),
    "not_finite": Text(
        "a force that is infinite or not a number",
        "look for a division by zero in the environment",
        "forcebound check environment FILE",
    ),
    "too_old": Text("an answer to a state older than device.age_limit", _LESS_DELAY),
    "not_newer": Text(
        "an answer that a newer one has overtaken, or a copy",
        "usual with jitter, reordering or duplicates; else a sender repeats itself",
    ),
    "from_the_future": Text(
        "an answer to a tick that has not been",
        "end those who still answer a former run, and environments that count ticks themselves",
    ),
    "wrong_echo": Text(
        "an answer that does not echo device_time_ns as it came",
        "let the environment echo device_seq and device_time_ns unchanged (docs/protocol.md)",
    ),
    "second_environment": Text("an answer of an environment that waits", _ONE_ENVIRONMENT),
}
_REJECTED = "rejects {rate:.3g} packets/s as {reason}: "
FINDINGS |= {
    f"rejected_{reason}": text._replace(seen=_REJECTED + text.seen)
    for reason, text in REASONS.items()
}
FINDINGS["rejected_unknown"] = Text(f"{_REJECTED}a reason of a newer version", _ENCODER)

FINDINGS |= {
    f"remote_{name}": Text(
        f"{kind.meaning} ({name}: {{count}} times, {{recent}} just now)", kind.action, kind.command
    )
    for name, kind in KINDS.items()
    if kind.is_problem
}

# Likely causes of a finding: only what to do.
CAUSES: dict[str, Text] = {
    **{code: Text(action=sentence) for code, sentence in realtime.SENTENCES.items()},
    "core_shared": Text(action="core {core} is shared with {graphs}: set realtime.cores"),
    "load": Text(
        action="the load is {load:.1f} on {cores} cores: end what is not needed, or keep it off "
        "the core (taskset, isolcpus)"
    ),
    "unknown": Text(
        action="cause unknown, see what this machine can do", command="forcebound doctor --measure"
    ),
    "injected_loss": Text(
        action="its parameters lose every packet; see and set them",
        command="forcebound param get links.{topic}",
    ),
    "sender_elsewhere": Text(
        action="is the {sender} running? It is not on this machine, or not in this run directory"
    ),
    "sender_silent": Text(action="see what the {sender} says in the log"),
    "environment_fails": Text(
        action="its log says how; then", command="forcebound check environment FILE"
    ),
    "environment_slow": Text(
        action="does it compute for longer than that (environment.compute_delay)? See its log"
    ),
    "replies_rejected": Text(action="the replies are of an environment that does not serve"),
    "law_not_certified": Text(
        action="law {law} limits it and does not say why; law certified would name the causes"
    ),
}

# Causes of little force: forcebound.analysis.bounder finds them.
_PUNCTUAL = "a quieter machine, realtime.policy: fifo"
CAUSES |= {
    "missed_ticks": Text(
        action=f"{{share:.1%}} of the ticks are missed: {_PUNCTUAL}, or a lower device.rate",
        command="forcebound doctor --measure",
    ),
    "delay": Text(
        action="half of the answers are {p50:.2g ms} old or older: less delay on the links, an "
        "environment that answers faster, or a controller of kind local_model"
    ),
    "overruns": Text(
        action="{rate:.2g} hold-limit overruns/s cost energy of the ledger: device.hold_limit: "
        f"auto, or a longer one; {_PUNCTUAL}"
    ),
    "overruns_at_auto": Text(
        action="{rate:.2g} hold-limit overruns/s cost energy of the ledger, though "
        f"device.hold_limit is auto: {_PUNCTUAL}; if the device has neither, set_hold_limit or a "
        "watchdog that reports"
    ),
    "late_ticks": Text(
        action="ticks are late, so a force is planned for {periods:.2g} periods, and the longer "
        f"the less: {_PUNCTUAL}"
    ),
    "long_hold_limit": Text(
        action="device.hold_limit is {periods:.2g} periods, and the longer the less force: "
        "device.hold_limit: auto"
    ),
    "energy_cap": Text(
        action="the ledger is full at device.energy_cap, {cap:.2g mJ}: a larger one, or auto"
    ),
    "imperfections": Text(
        action="{names} cost force: docs/theory.md, section 3, has the price of each"
    ),
    "resolution": Text(
        action="changes of the force cost {price:.2g mJ} with these encoder steps "
        "(device.resolution): a finer encoder, or an environment that commands calmly"
    ),
    "dissipation": Text(
        action="it is what the device's dissipation allows at this rate: more damping, a higher "
        "device.rate, or a softer environment"
    ),
}

# Notes on a change of parameters.
NOTES: dict[str, Text] = {
    "no_node": Text("no {node} is running here"),
    "node_stopped": Text(
        "{node} is stopped on request, and has the change when it starts again",
        command="forcebound start {node}",
    ),
    "node_ended": Text("{node} has ended"),
    "law_taken": Text(
        "the law was taken without force, with a new ledger; the force returns over {ramp:.3g ms}"
    ),
    "environment_waits": Text(
        "{serving} serves the graph, and not this environment, which waits: it has the change, "
        "which is felt when it serves"
    ),
    "another_serves": Text(
        "{serving} serves the graph, and not the environment of this machine, to which the change "
        "was made",
        "for the one that serves, use `forcebound param set` on its machine",
    ),
}
