"""Diagnosis of a running graph: what is wrong with it, where, and the likely causes.

:func:`examine` judges what :mod:`forcebound.observe.observation` saw, and touches nothing. Each
rule gives findings. A cause is named once, and not again by all that follows from it: of the chain
device, controller, environment, controller, device only the first hop that is broken is named.

To add a rule: a function from observations to findings, and its name in ``RULES``.
"""

from collections.abc import Callable, Iterator
from functools import partial
from itertools import product
from typing import Any, TypeAlias

from forcebound.graph.names import parameter_name
from forcebound.messages.control import (
    ControllerStatus,
    EnvironmentStatus,
    NodeStatus,
    ProcessStatus,
    RemoteStatus,
)
from forcebound.messages.topology import HAND, Stream, node_name
from forcebound.network.notices import PROBLEMS
from forcebound.observe.doctor_loop import LESS_DELAY, LOOP_RULES
from forcebound.observe.findings import Finding, note, problem
from forcebound.observe.observation import SUSPENDED, Observations, Seen
from forcebound.results.bounder import Cause
from forcebound.roles import CONTROLLER, ENVIRONMENT
from forcebound.run.lifecycle import resume_command

LOSSES = ("lost", "corrupted")  # fates of packets on a link that does not deliver them
WAITING_RATE = 5.0  # rejected replies in 1/s: of several that wait, each tries once a second

_CHECK = "forcebound check environment FILE"
_OTHER_SOFTWARE = "find the sender: a node of your own, or of another version of forcebound"
_ENCODER = "compare the sender with docs/protocol.md and its golden bytes"
_NEWER = ("a reason of a newer version", _ENCODER)

#: Reasons for a rejected packet, of codec, safety chain and controller: meaning, and what to do.
REASONS: dict[str, tuple[str, str]] = {
    "malformed": ("not one msgpack map with text keys", _OTHER_SOFTWARE),
    "version": ("another version of the wire format", "use one version on both ends"),
    "value": ("a value of a wrong type, range or length", _ENCODER),
    "unexpected": ("a packet that no device takes", _OTHER_SOFTWARE),
    "wrong_length": (
        "a force with another number of axes than the device has",
        "let the environment answer with one number per axis",
    ),
    "not_finite": (
        "a force that is infinite or not a number",
        f"look for a division by zero in the environment: {_CHECK}",
    ),
    "too_old": ("an answer to a state older than device.age_limit", LESS_DELAY),
    "not_newer": (
        "an answer that a newer one has overtaken, or a copy",
        "usual with jitter, reordering or duplicates; else a sender repeats itself",
    ),
    "from_the_future": (
        "an answer to a future tick",
        "end nodes left over from an earlier run, and environments that count ticks themselves",
    ),
    "wrong_echo": (
        "an answer that does not echo device_time_ns as it came",
        "let the environment echo device_seq and device_time_ns unchanged (docs/protocol.md)",
    ),
}


def examine(*hands: Observations) -> list[Finding]:
    """Return the findings about a running graph, of which each hand was seen, problems first."""
    found: list[Finding] = []
    for rule, seen in product(RULES, hands):  # what belongs to all is seen with each hand
        found += [finding for finding in rule(seen) if finding not in found]
    return sorted(found, key=lambda finding: finding.severity != "problem")


def _launcher(seen: Observations) -> Iterator[Finding]:
    if seen.launcher is None:
        words = "no launcher: an environment by itself, which none restarts"
        yield note("no_launcher", "launcher", words)
    elif seen.phase is None:
        yield _silent("launcher", seen.launcher)
    elif seen.phase in ("starting", "engaging"):
        yield note("starting", "launcher", f"the run is {seen.phase}: no force yet")
    elif seen.phase == "stopping":
        yield note("stopping", "launcher", "the run is ending")


def _processes(seen: Observations) -> Iterator[Finding]:
    log = "the launcher's log says why it ended"
    for name, process in seen.processes.items():
        state, again = process.state, f"restarted {process.restarts} times in this run"
        then = f"; {again}" if process.restarts else ""
        if state == "starting":
            action = "wait a second and ask again"
            yield note("process_starting", name, f"is starting{then}", action)
        elif state == "lost":
            words = "is lost: zero force; plug it in, switch it on, hold it in its home pose"
            words += " if it has one"
            command = resume_command(seen.hand).strip("`")
            yield problem("device_lost", name, words, command=command)
        elif state in ("restarting", "ended"):
            yield problem("process_dead", name, f"has ended, its state is {state}{then}", log)
        elif state in ("stopped", "stopping"):
            is_replaced = name == ENVIRONMENT and _delivered(seen, "force_command")
            words, command = f"is {state} on request", f"forcebound start {name}"
            report = note if is_replaced else problem
            yield report("process_stopped", name, words, command=command)
        elif process.last is None:
            yield _silent(name, process)
        elif process.restarts:
            yield note("restarts", name, f"was {again}", log)


def _silent(name: str, process: Seen[Any]) -> Finding:
    pid, state = process.pid, process.kernel_state
    if state in SUSPENDED:
        words = f"does not answer: process {pid} is suspended (SIGSTOP, Ctrl-Z, debugger)"
        return problem("suspended", name, words, command=f"kill -CONT {pid}")
    words = "does not answer" if pid is None else f"does not answer: process {pid}"
    words += f" is in state {state}" if state else ""
    action = "it computes without end, waits for something, is suspended or gone"
    return problem("no_answer", name, words, action, "" if pid is None else f"top -p {pid}")


def _chain(seen: Observations) -> Iterator[Finding]:
    if _delivered(seen, "force_command"):
        return  # what arrives at the end has passed every hop
    for link in seen.graph.links:
        sender, receiver = link.sender, str(link.receiver)
        sending, receiving = seen.process(sender), seen.process(receiver)
        if sender in seen.processes and sending.last is None:
            return  # has a finding of its own
        if receiver not in seen.processes:
            continue  # on another machine
        if receiving.last is None:
            return
        remotes = receiving.last.remotes.values()
        if sender not in seen.processes and not all(remote.connected for remote in remotes):
            return  # has a finding of its own
        if not receiving.received(link.name):
            yield _nothing_arrives(seen, link, sender, receiver)
            return
        if not _delivered(seen, link.topic):
            yield _all_lost(receiving, link, receiver)
            return


def _delivered(seen: Observations, topic: str) -> int:
    """Return how many packets of a topic have reached the node that they are for."""
    link = next((stream for stream in seen.graph.links if stream.topic == topic), None)
    if link is None:  # of a hand on another machine
        return 0
    receiver = seen.process(str(link.receiver))
    if receiver.last is not None and link.name in receiver.last.links:
        return receiver.growth(partial(_fate, link=link.name, fate="delivered"))
    return 0 if receiver.last is None else receiver.received(link.name)


def _fate(status: NodeStatus, link: str, fate: str) -> int:
    return status.links.get(link, {}).get(fate, 0)


def _all_lost(receiving: Seen[Any], link: Stream, receiver: str) -> Finding:
    lost = sum(receiving.rate(partial(_fate, link=link.name, fate=fate)) for fate in LOSSES)
    arriving = receiving.rate_of(link.name)
    words = (
        f"nothing gets through to the {receiver}: {arriving:.3g} packets/s arrive, "
        f"{lost:.3g}/s are lost on purpose"
    )
    advice = "its parameters lose every packet; see and set them"
    cause = Cause("injected_loss", advice, _parameters_of(link.name))
    return problem("hop_broken", f"link {link.name}", words, causes=(cause,))


def _parameters_of(link: str) -> str:
    """Return the command that shows the parameters of a link, by the name of its stream."""
    hand, _, topic = link.rpartition("/")
    return f"forcebound param get {parameter_name(hand or HAND, f'links.{topic}')}"


def _nothing_arrives(seen: Observations, link: Stream, sender: str, receiver: str) -> Finding:
    receiving = seen.process(receiver)
    earlier = 0 if receiving.last is None else receiving.last.received.get(link.name, 0)
    words = (
        f"nothing gets through to the {receiver}: no packet in {receiving.interval:.1f} s, "
        f"{earlier} before"
    )
    cause = Cause("sender_silent", f"see what the {sender} says in the log")
    if sender not in seen.processes:
        where = "it is not on this machine, or not in this run directory"
        cause = Cause("sender_elsewhere", f"is the {sender} running? {where}")
    elif link.topic == "environment_reply":
        environment = seen.of(EnvironmentStatus)
        status, queries = environment.last, _queries(seen)
        words += f"; the {sender} gets {queries:.3g} queries/s"
        if status is not None and status.failures:
            words += f"; its code failed to answer {status.failures} times"
            cause = Cause("environment_fails", "its log says how; then", _CHECK)
        else:
            limit = "does it compute for longer than that (environment.compute_delay)?"
            cause = Cause("environment_slow", f"{limit} See its log")
    elif link.topic == "force_command" and seen.of(ControllerStatus).growth(_second_replies):
        cause = Cause("replies_rejected", "the replies are of an environment that does not serve")
    return problem("hop_broken", f"link {link.name}", words, causes=(cause,))


def _queries(seen: Observations) -> float:
    """Return how many queries of the hand the environment gets, in 1/s."""
    return seen.of(EnvironmentStatus).rate_of(node_name(seen.hand, "environment_query"))


def _second_replies(status: ControllerStatus) -> int:
    """Return how many replies came from an environment that does not serve."""
    return _rejections(status, "second_environment")


def _environments(seen: Observations) -> Iterator[Finding]:
    own, where = seen.of(EnvironmentStatus).last, seen.name(CONTROLLER)
    if where not in seen.processes and own is not None:
        yield from _serves_elsewhere(own, _queries(seen))
    controller = seen.of(ControllerStatus).last
    if controller is None:
        return
    serving, name = controller.environment, None if own is None else own.name
    rejected = seen.of(ControllerStatus).rate(_second_replies)
    other = f", {name}," if name not in (None, serving) else ""
    if rejected > WAITING_RATE:
        words = (
            f"two environments answer: {serving} serves, {rejected:.2g} replies/s of another"
            f"{other} are rejected"
        )
        action = "end one of the two; the other takes over after 1 s"
        yield problem("second_environment", where, words, action)
    elif rejected:
        words = f"{serving} serves; another{other} waits, and takes over when the first is silent"
        yield note("waiting_environment", where, words)
    elif None not in (name, serving) and name != serving:
        words = f"{serving} serves, not {name} of this launcher"
        yield note("other_environment", where, words)


def _serves_elsewhere(status: EnvironmentStatus, queries: float) -> Iterator[Finding]:
    """Report an environment whose graph is on another machine."""
    if not any(remote.connected for remote in status.remotes.values()) or not queries:
        return  # has a finding of its own
    other = status.refused_for
    words = f"connected with the graph, {queries:.3g} queries/s; {other or status.name} serves"
    words += f", and {status.name} waits" if other else ""
    yield note("remote_connected", "remote link of the environment", words)


def _remote(seen: Observations) -> Iterator[Finding]:
    for name, process in seen.processes.items():
        remotes = process.last.remotes if isinstance(process.last, NodeStatus) else {}
        for hand, remote in remotes.items():
            yield from _remote_link(seen, name, hand, remote)


def _remote_link(
    seen: Observations, name: str, hand: str, remote: RemoteStatus
) -> Iterator[Finding]:
    where = f"remote link of the {name}"
    if hand != HAND and name == ENVIRONMENT:
        where += f" to {hand}"
    if not remote.connected:
        is_served = _delivered(seen, "force_command") > 0  # then others may come later
        verb = "listens at" if remote.listens else "connects to"
        words = f"nobody is there; it {verb} {remote.address} port {remote.port}"
        command = "forcebound node environment FILE"
        if name == ENVIRONMENT:
            command = "forcebound launch FILE"
        report = note if is_served else problem
        yield report("remote_not_connected", where, words, "start the other end", command)
    for kind, (meaning, action, command) in PROBLEMS.items():
        if count := remote.counts.get(kind, 0):
            recent = seen.processes[name].growth(partial(_notices, hand=hand, kind=kind))
            words = f"{meaning} ({kind}: {count} times, {recent} just now)"
            report = problem if recent or not remote.connected else note
            yield report(f"remote_{kind}", where, words, action, command)


def _notices(status: NodeStatus, hand: str, kind: str) -> int:
    return status.remotes[hand].counts.get(kind, 0) if hand in status.remotes else 0


def _rejected(seen: Observations) -> Iterator[Finding]:
    is_reordered = any(link.reorders for link in seen.config.only.links.values())
    for name, process in seen.processes.items():
        for reason in () if process.last is None else process.last.rejected:
            rate = process.rate(partial(_rejections, reason=reason))
            if not rate or reason == "second_environment":  # which has a finding of its own
                continue
            meaning, action = REASONS.get(reason, _NEWER)
            words = f"rejects {rate:.3g} packets/s as {reason}: {meaning}"
            report = note if is_reordered and reason == "not_newer" else problem
            kind = f"rejected_{reason if reason in REASONS else 'unknown'}"
            yield report(kind, name, words, action)


def _rejections(status: ProcessStatus, reason: str) -> int:
    return status.rejected.get(reason, 0)


def _links(seen: Observations) -> Iterator[Finding]:
    for process in seen.processes.values():
        for link in process.last.links if isinstance(process.last, NodeStatus) else ():
            sent, lost, corrupted = (
                process.growth(partial(_fate, link=link, fate=fate)) for fate in ("sent", *LOSSES)
            )
            # If all are lost, the chain is broken there.
            if 0 < lost + corrupted < sent:
                words = f"loses {lost} and damages {corrupted} of {sent} packets, on purpose"
                yield note("injected_loss", f"link {link}", words, command=_parameters_of(link))


Rule: TypeAlias = Callable[[Observations], Iterator[Finding]]

RULES: tuple[Rule, ...] = (
    _launcher,
    _processes,
    _chain,
    _remote,
    _environments,
    _rejected,
    *LOOP_RULES,
    _links,
)
