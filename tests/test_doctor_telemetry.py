"""Findings of the doctor about force, delay, ticks, recorder and law, case by case."""

from dataclasses import replace

import pytest
from observed_graph import (
    PUNCTUAL,
    TICKS,
    codes,
    commands,
    graph,
    healthy,
    kinds,
    only,
    process,
    telemetry,
)

from forcebound.messages.control import BounderReport
from forcebound.monitor.doctor import examine
from forcebound.monitor.observation import RecordingSeen
from forcebound.roles import Fact


def test_no_force_now_is_told_with_the_age_limit() -> None:
    finding = only(replace(healthy(), telemetry=telemetry(unanswered=range(500, TICKS))))
    assert (finding.severity, finding.kind) == ("problem", "no_force")
    assert finding.data == {"age_limit": 0.1, "silence": pytest.approx(1.499)}
    assert "1.5 s" in finding.seen


def test_gaps_of_force_are_told_with_their_share() -> None:
    finding = only(replace(healthy(), telemetry=telemetry(unanswered=range(500, 700))))
    assert finding.kind == "force_gaps"
    assert finding.data == {"age_limit": 0.1, "share": pytest.approx(0.1), "ticks": 2000}


def test_a_device_that_answers_without_telemetry_is_a_problem() -> None:
    seen = replace(healthy(recorder=process("telemetry", grown=0)), telemetry=telemetry(0))
    assert only(seen).kind == "no_telemetry"


def test_a_delay_near_the_age_limit_is_a_problem() -> None:
    finding = only(replace(healthy(), telemetry=telemetry(loop_delay=0.08)))
    assert finding.kind == "delay_near_age_limit"
    assert finding.data["p50"] == pytest.approx(0.08)
    assert finding.data["age_limit"] == 0.1


def test_a_loop_that_is_late_with_no_delay_injected_is_a_problem() -> None:
    late = replace(healthy(), telemetry=telemetry(loop_delay=0.01))
    finding = only(late)
    assert (finding.severity, finding.kind) == ("problem", "late_loop")
    assert (finding.data["injected"], finding.data["period"]) == (0.0, 1e-3)
    assert codes(finding) == ["unknown"]
    assert commands(finding) == ["forcebound doctor --measure"]
    asked_for = healthy(graph("delay:=5 ms"))
    assert examine(replace(asked_for, telemetry=telemetry(loop_delay=0.01))) == []


def test_late_ticks_are_told_with_their_likely_causes() -> None:
    facts = [*PUNCTUAL, Fact("fifo_not_permitted", "ordinary scheduling")]
    seen = healthy(device=process("force_command", realtime=facts))
    seen = replace(
        seen, telemetry=telemetry(lost_every=20), load=5.0, neighbours=("/tmp/forcebound-b",)
    )
    finding = only(seen)
    assert (finding.severity, finding.kind) == ("problem", "ticks_lost")
    assert finding.data["share"] == pytest.approx(99 / 2099)
    assert codes(finding) == ["fifo_not_permitted", "core_shared", "load"]
    assert "/tmp/forcebound-b" in finding.advice


def test_a_tick_lost_now_and_then_is_a_note() -> None:
    finding = only(replace(healthy(), telemetry=telemetry(lost_every=1999)))
    assert (finding.severity, finding.kind) == ("note", "ticks_lost")


def test_a_recorder_that_cannot_write_is_a_problem() -> None:
    stopped = "stopped: No space left on device"
    finding = only(healthy(recorder=process("telemetry", recording=stopped)))
    assert (finding.severity, finding.kind) == ("problem", "not_recording")
    assert finding.data == {"state": stopped, "path": "/data/run.mcap"}


@pytest.mark.parametrize(
    ("rate", "free", "left"), [(0.0, 100_000_000, None), (5e6, 1_200_000_000, 240.0)]
)
def test_a_disk_that_is_soon_full_is_a_problem(rate: float, free: int, left: float | None) -> None:
    seen = replace(healthy(), recording=RecordingSeen("/data/run.mcap", rate, free))
    finding = only(seen)
    assert finding.kind == "disk_nearly_full"
    assert finding.data["left"] == left
    assert ("full in 4 min" in finding.seen) == (left is not None)


def test_a_recorder_that_hears_nothing_is_a_problem() -> None:
    assert only(healthy(recorder=process("telemetry", grown=0))).kind == "recorder_deaf"


def test_a_law_that_limits_most_of_the_time_is_information() -> None:
    seen = replace(healthy(), telemetry=telemetry(asked=8.0, applied=1.5, loop_delay=4e-4))
    finding = only(seen)
    assert (finding.severity, finding.kind) == ("note", "law_limits")
    assert finding.data == {"law": "certified", "share": 1.0, "commanded": 8.0, "applied": 1.5}
    assert codes(finding) == ["dissipation"]
    assert codes(only(replace(seen, config=graph("law:=tdpa")))) == ["law_not_certified"]


def test_the_doctor_names_why_there_is_little_force_and_the_setting_that_gives_more() -> None:
    late = process(
        "force_command", bounder=BounderReport(overruns=5, hold_limit=4e-3, longest_hold_limit=4e-3)
    )
    seen = replace(
        healthy(device=late), telemetry=telemetry(asked=8.0, applied=2.0, loop_delay=4e-4)
    )
    finding = only(seen)
    assert codes(finding) == ["late_ticks"]
    assert "planned for 4 periods" in finding.advice
    long = graph("hold_limit:=4")
    assert long.device.servo.hold_limit == 4.0
    finding = only(replace(seen, config=long))
    assert codes(finding) == ["long_hold_limit"]
    assert "device.hold_limit: auto" in finding.advice


def test_without_a_law_nothing_protects_the_hand() -> None:
    finding = only(healthy(graph("law:=none")))
    assert (finding.severity, finding.kind) == ("note", "no_law")


def test_problems_come_first() -> None:
    config = graph("law:=none")
    findings = examine(healthy(config, recorder=process("telemetry", recording="stopped: x")))
    assert kinds(findings) == ["not_recording", "no_law"]
