"""Findings of the doctor about processes and links, case by case, without processes."""

from dataclasses import replace
from typing import Any

import pytest
from msgspec.structs import replace as changed
from observed_graph import (
    PROCESSES,
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

from forcebound.messages.control import NodeStatus, RemoteStatus
from forcebound.monitor.doctor import REASONS, examine
from forcebound.monitor.observation import Observations, Seen
from forcebound.topology import LINKS, ONE_HAND


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


def test_a_process_that_lives_and_does_not_answer_is_busy() -> None:
    finding = only(healthy(controller=silent("running", "R")))
    assert (finding.kind, finding.where) == ("no_answer", "controller")
    assert finding.data == {"pid": 7, "kernel_state": "R"}
    assert commands(finding) == ["top -p 7"]


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
    assert finding.data["restarts"] == 3
    assert ("3 times" in finding.seen) == (state != "stopped")


def test_a_stopped_environment_is_no_problem_while_another_one_serves() -> None:
    finding = only(healthy(environment=silent("stopped", pid=None)))
    assert (finding.severity, finding.kind) == ("note", "process_stopped")
    assert commands(finding) == ["forcebound start environment"]


def test_restarts_are_told_when_all_is_well_again() -> None:
    finding = only(healthy(environment=replace(PROCESSES["environment"], restarts=2)))
    assert (finding.severity, finding.kind) == ("note", "restarts")


def test_a_suspended_launcher_is_a_problem() -> None:
    seen = replace(healthy(), launcher=silent("running", "T", 6), phase=None)
    finding = only(seen)
    assert (finding.kind, finding.where) == ("suspended", "launcher")


@pytest.mark.parametrize("phase", ["starting", "engaging", "stopping"])
def test_a_run_that_begins_or_ends_is_no_problem(phase: str) -> None:
    finding = only(replace(healthy(), phase=phase))
    assert finding.severity == "note"


@pytest.mark.parametrize("topic", LINKS)
def test_of_a_broken_chain_only_the_first_broken_hop_is_named(topic: str) -> None:
    link = ONE_HAND.named(topic)[0]
    sender, receiver = link.sender, link.receiver
    behind = LINKS[LINKS.index(topic) :]
    processes = {}
    for name, whole in PROCESSES.items():
        assert whole.last is not None
        received = {t: 5 if t in behind else n for t, n in whole.last.received.items()}
        processes[name] = replace(whole, last=changed(whole.last, received=received))
    finding = only(with_processes(processes))
    assert (finding.severity, finding.kind) == ("problem", "hop_broken")
    assert finding.where == f"link {topic}"
    assert (finding.data["silence"], finding.data["earlier"]) == (2.0, 5)
    assert str(receiver) in finding.seen
    cause = "environment_slow" if topic == "environment_reply" else "sender_silent"
    assert codes(finding) == [cause]
    assert finding.data["sender"] == sender


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
    assert finding.data["earlier"] == 0
    assert finding.data["queries"] == pytest.approx(1000.0)
    assert codes(finding) == ["environment_slow"]


def test_an_environment_whose_code_fails_is_named_with_its_failures() -> None:
    finding = only(without_replies(failures=12))
    assert finding.data["failures"] == 12
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
    assert finding.data == {"received": 1000.0, "lost": 1000.0}
    assert codes(finding) == ["injected_loss"]
    assert commands(finding) == ["forcebound param get links.environment_query"]


def test_losses_that_were_asked_for_are_no_fault() -> None:
    link = {"force_command": counts(2000, 200, 1800)}
    finding = only(healthy(device=process("force_command", links=link)))
    assert (finding.severity, finding.kind) == ("note", "injected_loss")
    assert finding.where == "link force_command"
    assert finding.data == {"sent": 2000, "lost": 200, "corrupted": 0}


def test_a_second_environment_is_named_with_the_one_that_serves() -> None:
    controller = process(
        "device_state",
        "environment_reply",
        environment="there/2/b",
        rejected={"second_environment": 200},
    )
    finding = only(healthy(controller=controller))
    assert (finding.severity, finding.kind) == ("problem", "second_environment")
    assert finding.data == {"serving": "there/2/b", "rate": 100.0, "other": SERVING}


def test_an_environment_that_waits_is_a_note_wherever_it_is() -> None:
    knocks = {"second_environment": 2}
    topics = ("device_state", "environment_reply")
    there = process(*topics, environment="there/2/b", rejected=knocks)
    here = process(*topics, environment=SERVING, rejected=knocks)
    for controller, serving in ((there, "there/2/b"), (here, SERVING)):
        finding = only(healthy(controller=controller))
        assert (finding.severity, finding.kind) == ("note", "waiting_environment")
        assert finding.data["serving"] == serving


@pytest.mark.parametrize(
    ("refused_for", "serving", "waiting"),
    [(None, SERVING, None), ("there/2/b", "there/2/b", SERVING)],
)
def test_on_its_own_machine_an_environment_says_who_serves(
    refused_for: str | None, serving: str, waiting: str | None
) -> None:
    link = remote(connected=True)
    environment = process("environment_query", refused_for=refused_for, remote=link)
    seen = replace(healthy(), processes={"environment": environment}, telemetry=telemetry(0))
    finding = only(seen)
    assert (finding.severity, finding.kind) == ("note", "remote_connected")
    assert finding.data == {"queries": 1000.0, "serving": serving}
    assert (SERVING in finding.seen) == (SERVING in (serving, waiting))


def test_that_another_environment_serves_is_a_note() -> None:
    controller = process("device_state", "environment_reply", environment="there/2/b")
    finding = only(healthy(controller=controller))
    assert (finding.severity, finding.kind) == ("note", "other_environment")


@pytest.mark.parametrize("reason", [*sorted(REASONS), "of_tomorrow"])
def test_each_reason_for_a_refusal_has_an_explanation_and_advice(reason: str) -> None:
    refusing = process("force_command", rejected={reason: 20})
    finding = only(with_processes({"device": refusing}))
    assert finding.severity == "problem"
    assert finding.data["rate"] == 10.0
    assert reason in (*finding.data.values(), finding.kind)
    assert finding.advice


def test_refusals_of_the_past_are_not_told() -> None:
    device = process("force_command", rejected={"too_old": 9})
    assert device.last is not None
    earlier = changed(device.last, received={"force_command": 5})
    assert examine(healthy(device=replace(device, first=earlier))) == []


def test_overtaken_answers_are_usual_with_jitter() -> None:
    config = graph()
    jitter = replace(config.links["environment_query"], jitter=1e-3)
    config = replace(config, links={**config.links, "environment_query": jitter})
    device = process("force_command", rejected={"not_newer": 20})
    assert [f.severity for f in examine(healthy(config, device=device))] == ["note"]


def test_counts_of_a_process_that_was_started_anew_have_grown_from_zero() -> None:
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
        controller=process("device_state", environment=SERVING, remote=state),
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
    assert finding.data == {"count": 3, "recent": 3}
    assert "environment_keys" in finding.advice
