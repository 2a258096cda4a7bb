"""Findings of the doctor, case by case, without processes."""

import re
from dataclasses import replace
from typing import Any

import pytest
from msgspec.structs import replace as changed
from observed_graph import (
    PROCESSES,
    PUNCTUAL,
    SERVING,
    TICKS,
    codes,
    commands,
    graph,
    healthy,
    kinds,
    only,
    process,
    silent,
    telemetry,
    with_processes,
)

from forcebound.graph.graph import GraphConfig
from forcebound.messages.control import NodeStatus, RemoteStatus
from forcebound.messages.topology import HAND, LINKS, ONE_HAND
from forcebound.observe.doctor import REASONS, examine
from forcebound.observe.observation import Observations, RecordingSeen, Seen
from forcebound.roles import Fact
from forcebound.run.virtual import run_virtual


def test_of_a_healthy_graph_there_is_nothing_to_say() -> None:
    assert examine(healthy()) == []


def test_a_suspended_process_is_named_with_what_wakes_it() -> None:
    finding = only(healthy(environment=silent("running", "T", 4711)))
    assert (finding.severity, finding.kind, finding.where) == (
        "problem",
        "suspended",
        "environment",
    )
    assert "SIGSTOP" in finding.seen
    assert commands(finding) == ["kill -CONT 4711"]


def test_without_a_launcher_nobody_knows_what_became_of_a_silent_process() -> None:
    seen = replace(healthy(device=silent("unknown", pid=None)), launcher=None, phase=None)
    findings = examine(seen)
    assert kinds(findings) == ["no_answer", "no_launcher"]
    assert "process" not in findings[0].seen
    assert commands(findings[0]) == []


@pytest.mark.parametrize(
    ("state", "severity", "kind"),
    [
        ("starting", "note", "process_starting"),
        ("restarting", "problem", "process_dead"),
        ("ended", "problem", "process_dead"),
        ("stopped", "problem", "process_stopped"),
    ],
)
def test_the_launcher_knows_why_a_process_is_silent(state: str, severity: str, kind: str) -> None:
    controller = replace(silent(state, pid=None), restarts=3)
    finding = only(healthy(controller=controller))
    assert (finding.severity, finding.kind, finding.where) == (severity, kind, "controller")
    assert ("3 times" in finding.seen) == (state != "stopped")


def test_a_stopped_environment_is_no_problem_while_another_one_serves() -> None:
    finding = only(healthy(environment=silent("stopped", pid=None)))
    assert (finding.severity, finding.kind) == ("note", "process_stopped")
    assert commands(finding) == ["forcebound start environment"]


def jittered() -> GraphConfig:
    config = graph()
    jitter = replace(config.only.links["environment_query"], jitter=1e-3)
    return config.with_hand(links={**config.only.links, "environment_query": jitter})


REPLIES = ("device_state", "environment_reply")


@pytest.mark.parametrize(
    ("seen", "severity", "kind", "where"),
    [
        (replace(healthy(), phase="starting"), "note", "starting", "launcher"),
        (replace(healthy(), phase="stopping"), "note", "stopping", "launcher"),
        (
            replace(healthy(), launcher=silent("running", "T", 6), phase=None),
            *("problem", "suspended", "launcher"),
        ),
        (
            healthy(jittered(), device=process("force_command", rejected={"not_newer": 20})),
            *("note", "rejected_not_newer", "device"),
        ),
        (
            healthy(controller=process(*REPLIES, environment="there/2/b")),
            *("note", "other_environment", "controller"),
        ),
        (
            replace(healthy(), telemetry=telemetry(lost_every=1999)),
            *("note", "ticks_lost", "device"),
        ),
        (
            replace(healthy(recorder=process("telemetry", grown=0)), telemetry=telemetry(0)),
            *("problem", "no_telemetry", "device"),
        ),
        (healthy(recorder=process("telemetry", grown=0)), "problem", "recorder_deaf", "recorder"),
        (healthy(graph("law:=none")), "note", "no_law", "device"),
        (
            healthy(environment=replace(PROCESSES["environment"], restarts=2)),
            *("note", "restarts", "environment"),
        ),
        (healthy(controller=silent("running", "R")), "problem", "no_answer", "controller"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_a_state_of_a_graph_is_one_finding(
    seen: Observations, severity: str, kind: str, where: str
) -> None:
    finding = only(seen)
    assert (finding.severity, finding.kind, finding.where) == (severity, kind, where)


@pytest.mark.parametrize("topic", LINKS)
def test_of_a_broken_chain_only_the_first_broken_hop_is_named(topic: str) -> None:
    receiver = ONE_HAND.named(topic)[0].receiver
    behind = LINKS[LINKS.index(topic) :]
    processes = {}
    for name, whole in PROCESSES.items():
        assert whole.last is not None
        received = {t: 5 if t in behind else n for t, n in whole.last.received.items()}
        processes[name] = replace(whole, last=changed(whole.last, received=received))
    finding = only(with_processes(processes))
    assert (finding.severity, finding.kind) == ("problem", "hop_broken")
    assert finding.where == f"link {topic}"
    assert re.search(f"{receiver}: no packet in 2.0 s, 5 before", finding.seen)
    cause = "environment_slow" if topic == "environment_reply" else "sender_silent"
    assert codes(finding) == [cause]


def without_replies(**environment: Any) -> Observations:
    """Return a graph whose environment gets queries and answers none."""
    quiet = {
        "controller": process("device_state", environment=SERVING),
        "device": process("force_command", grown=0),
        "environment": process("environment_query", **environment),
    }
    return with_processes(quiet)


def test_an_environment_that_never_answered_is_told_from_one_that_stopped_to() -> None:
    finding = only(without_replies(failures=0))
    assert "0 before" in finding.seen
    assert "1e+03 queries/s" in finding.seen
    assert codes(finding) == ["environment_slow"]


def test_an_environment_whose_code_fails_is_named_with_its_failures() -> None:
    finding = only(without_replies(failures=12))
    assert "failed to answer 12 times" in finding.seen
    assert commands(finding) == ["forcebound check environment FILE"]


def counts(sent: int, lost: int, delivered: int) -> dict[str, int]:
    return {"sent": sent, "lost": lost, "corrupted": 0, "delivered": delivered}


def test_a_link_that_loses_everything_on_purpose_is_named() -> None:
    link = {"environment_query": counts(2000, 2000, 0)}
    finding = only(
        healthy(
            environment=process("environment_query", links=link),
            controller=process("device_state", environment=SERVING),
            device=process("force_command", grown=0),
        )
    )
    assert (finding.kind, finding.where) == ("hop_broken", "link environment_query")
    assert "1e+03/s are lost on purpose" in finding.seen
    assert codes(finding) == ["injected_loss"]
    assert commands(finding) == ["forcebound param get links.environment_query"]


def test_losses_that_were_asked_for_are_no_fault() -> None:
    link = {"force_command": counts(2000, 200, 1800)}
    finding = only(healthy(device=process("force_command", links=link)))
    assert (finding.severity, finding.kind) == ("note", "injected_loss")
    assert finding.where == "link force_command"
    assert "200 and damages 0 of 2000 packets" in finding.seen


def test_a_second_environment_is_named_with_the_one_that_serves() -> None:
    controller = process(
        "device_state",
        "environment_reply",
        environment="there/2/b",
        rejected={"second_environment": 200},
    )
    finding = only(healthy(controller=controller))
    assert (finding.severity, finding.kind) == ("problem", "second_environment")
    assert re.search(f"there/2/b serves, 1e.02 replies/s of another, {SERVING}", finding.seen)


def test_an_environment_that_waits_is_a_note_wherever_it_is() -> None:
    knocks = {"second_environment": 2}
    topics = ("device_state", "environment_reply")
    there = process(*topics, environment="there/2/b", rejected=knocks)
    here = process(*topics, environment=SERVING, rejected=knocks)
    for controller, serving in ((there, "there/2/b"), (here, SERVING)):
        finding = only(healthy(controller=controller))
        assert (finding.severity, finding.kind) == ("note", "waiting_environment")
        assert finding.seen.startswith(f"{serving} serves")


@pytest.mark.parametrize(
    ("refused_for", "serving", "waiting"),
    [(None, SERVING, None), ("there/2/b", "there/2/b", SERVING)],
)
def test_on_its_own_machine_an_environment_says_who_serves(
    refused_for: str | None, serving: str, waiting: str | None
) -> None:
    link = remote(connected=True)
    environment = process("environment_query", refused_for=refused_for, remotes={HAND: link})
    seen = replace(healthy(), processes={"environment": environment}, telemetry=telemetry(0))
    finding = only(seen)
    assert (finding.severity, finding.kind) == ("note", "remote_connected")
    assert f"1e+03 queries/s; {serving} serves" in finding.seen
    assert (SERVING in finding.seen) == (SERVING in (serving, waiting))


@pytest.mark.parametrize("reason", [*sorted(REASONS), "of_tomorrow"])
def test_each_reason_for_a_refusal_has_an_explanation_and_advice(reason: str) -> None:
    refusing = process("force_command", rejected={reason: 20})
    finding = only(with_processes({"device": refusing}))
    assert finding.severity == "problem"
    assert f"10 packets/s as {reason}" in finding.seen
    assert finding.advice


def test_counts_of_a_process_that_was_restarted_have_grown_from_zero() -> None:
    first, last = NodeStatus(received={"a": 900}), NodeStatus(received={"a": 50})
    seen = Seen(first=first, last=last, interval=2.0)
    assert seen.received("a") == 50
    assert seen.rate(lambda status: status.received["a"]) == 25.0


def remote(connected: bool, **notices: int) -> RemoteStatus:
    return RemoteStatus(
        listens=True, address="127.0.0.1", port=7410, connected=connected, counts=notices
    )


def with_remote(state: RemoteStatus, grown: int) -> Observations:
    seen = healthy(
        controller=process("device_state", environment=SERVING, remotes={HAND: state}),
        device=process("force_command", grown=grown),
    )
    processes = {name: p for name, p in seen.processes.items() if name != "environment"}
    return replace(seen, processes=processes)


def test_a_remote_environment_that_is_not_there_is_a_problem_and_the_only_one() -> None:
    finding = only(with_remote(remote(connected=False), grown=0))
    assert (finding.severity, finding.kind) == ("problem", "remote_not_connected")
    assert "listens at 127.0.0.1 port 7410" in finding.seen
    assert commands(finding) == ["forcebound node environment FILE"]


def test_while_another_one_serves_a_remote_environment_may_be_away() -> None:
    finding = only(with_remote(remote(connected=False), grown=TICKS))
    assert (finding.severity, finding.kind) == ("note", "remote_not_connected")


def test_a_remote_environment_that_is_there_and_silent_is_a_broken_hop() -> None:
    finding = only(with_remote(remote(connected=True), grown=0))
    assert (finding.kind, finding.where) == ("hop_broken", "link environment_reply")
    assert codes(finding) == ["sender_elsewhere"]


def test_refused_peers_are_told_while_they_knock() -> None:
    finding = only(with_remote(remote(connected=True, refused_here=3), grown=TICKS))
    assert (finding.severity, finding.kind) == ("problem", "remote_refused_here")
    assert "3 times, 3 just now" in finding.seen
    assert "environment_keys" in finding.advice


# --- Force, delay, ticks, recorder and law --------------------------------------------------------


def test_no_force_now_is_told_with_the_age_limit() -> None:
    finding = only(replace(healthy(), telemetry=telemetry(unanswered=range(500, TICKS))))
    assert (finding.severity, finding.kind) == ("problem", "no_force")
    assert "1.5 s" in finding.seen
    assert "100 ms" in finding.seen


def test_gaps_of_force_are_told_with_their_share() -> None:
    finding = only(replace(healthy(), telemetry=telemetry(unanswered=range(500, 700))))
    assert finding.kind == "force_gaps"
    assert "10.0% of 2000 ticks" in finding.seen


def test_a_delay_near_the_age_limit_is_a_problem() -> None:
    finding = only(replace(healthy(), telemetry=telemetry(loop_delay=0.08)))
    assert finding.kind == "delay_near_age_limit"
    assert "p50 80.0 ms" in finding.seen


def test_a_loop_that_is_late_with_no_delay_injected_is_a_problem() -> None:
    late = replace(healthy(), telemetry=telemetry(loop_delay=0.01))
    finding = only(late)
    assert (finding.severity, finding.kind) == ("problem", "late_loop")
    assert "at most 0.0 ms" in finding.seen
    assert codes(finding) == ["unknown"]
    assert commands(finding) == ["forcebound doctor --measure"]
    asked_for = healthy(graph("delay:=5 ms"))
    finding = only(replace(asked_for, telemetry=telemetry(loop_delay=0.01)))
    assert (finding.severity, finding.kind) == ("note", "delayed_loop")


def test_late_ticks_are_told_with_their_likely_causes() -> None:
    facts = [*PUNCTUAL, Fact("fifo_not_permitted", "ordinary scheduling")]
    seen = healthy(device=process("force_command", realtime=facts))
    seen = replace(
        seen, telemetry=telemetry(lost_every=20), load=5.0, neighbours=("/tmp/forcebound-b",)
    )
    finding = only(seen)
    assert (finding.severity, finding.kind) == ("problem", "ticks_lost")
    assert f"{99 / 2099:.1%}" in finding.seen
    assert codes(finding) == ["fifo_not_permitted", "core_shared", "load"]
    assert "/tmp/forcebound-b" in finding.advice


def test_a_recorder_that_cannot_write_is_a_problem() -> None:
    stopped = "stopped: No space left on device"
    finding = only(healthy(recorder=process("telemetry", recording=stopped)))
    assert (finding.severity, finding.kind) == ("problem", "not_recording")
    assert stopped in finding.seen
    assert "/data/run.mcap" in finding.seen


@pytest.mark.parametrize(
    ("rate", "free", "left"), [(0.0, 100_000_000, ""), (5e6, 1_200_000_000, "full in 4 min")]
)
def test_a_disk_that_is_soon_full_is_a_problem(rate: float, free: int, left: str) -> None:
    seen = replace(healthy(), recording=RecordingSeen("/data/run.mcap", rate, free))
    finding = only(seen)
    assert finding.kind == "disk_nearly_full"
    assert ("full in" in finding.seen) == bool(left)
    assert left in finding.seen


def test_a_law_that_limits_most_of_the_time_is_information() -> None:
    seen = replace(healthy(), telemetry=telemetry(asked=8.0, applied=1.5, loop_delay=4e-4))
    finding = only(seen)
    assert (finding.severity, finding.kind) == ("note", "law_limits")
    assert "100% of the ticks" in finding.seen
    assert "of 8 N commanded it applies 1.5 N" in finding.seen
    assert codes(finding) == []  # it touches no surface


def test_the_doctor_names_why_there_is_little_force_and_the_setting_that_gives_more() -> None:
    config = graph("hold_limit:=4")
    finding = only(replace(healthy(config), telemetry=run_virtual(config, 2.0).columns))
    assert finding.kind == "law_limits"
    assert codes(finding)[0] == "hold_limit"
    assert "device.hold_limit: auto" in finding.advice


def test_a_hand_that_received_energy_is_a_problem_in_the_words_of_the_verdict() -> None:
    config = graph("law:=none", "delay:=5 ms")
    result = run_virtual(config, 2.0)
    findings = examine(replace(healthy(config), telemetry=result.columns))
    (first,) = (one for one in findings if one.kind == "not_passive")
    assert first.severity == "problem"
    assert f"{first.seen}." == result.summary["verdict"][0]
    passive = graph("law:=certified", "delay:=5 ms")
    seen = replace(healthy(passive), telemetry=run_virtual(passive, 2.0).columns)
    assert "not_passive" not in kinds(examine(seen))


def test_problems_come_first() -> None:
    config = graph("law:=none")
    findings = examine(healthy(config, recorder=process("telemetry", recording="stopped: x")))
    assert kinds(findings) == ["not_recording", "no_law"]
