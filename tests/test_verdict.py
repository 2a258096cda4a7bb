"""The verdict on a run: what is so in its words, and the shares of runs whose cause is known."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from launch_texts import written
from slow_bus import run_slow

from forcebound.graph.loader import load
from forcebound.messages.events import LAW_CHANGED
from forcebound.messages.packets import Event
from forcebound.results.contact import steady_window
from forcebound.results.verdict import verdict
from forcebound.run.results import RunResult
from forcebound.run.simulation import LateTicks
from forcebound.run.virtual import run_virtual
from forcebound.units import energy_in_words

LATE = LateTicks(rate=200.0, shortest=1e-3, longest=3e-3)


def result_of(folder: Path, text: str, late: LateTicks | None = None) -> RunResult:
    file = written(folder, f"forcebound: 1\ninclude: stiff_wall.yaml\n{text}")
    return run_virtual(load(file), 3.0, late_ticks=late)


@pytest.mark.parametrize(
    ("text", "cause"),
    [
        ("", "little dissipation"),
        ("arguments: {law: none, stiffness: 2 N/mm}\ndevice: {saturation: 1 N}", "saturation"),
        ("arguments: {law: none, stiffness: 0.5 N/mm, delay: 20 ms}", "late answers"),
    ],
)
def test_of_a_run_with_one_cause_it_takes_the_whole_rest(
    tmp_path: Path, text: str, cause: str
) -> None:
    stiffness = result_of(tmp_path, text).summary["stiffness_n_per_m"]
    assert stiffness["felt"] < 0.9 * stiffness["asked"]
    assert stiffness["shares"][cause] > 0.995


def test_missed_ticks_take_what_the_watchdog_drops(tmp_path: Path) -> None:
    text = "arguments: {law: none, stiffness: 1 N/mm, hold_limit: 1.02}\ndevice: {watchdog: silent}"
    result = result_of(tmp_path, text, LATE)
    stiffness, columns = result.summary["stiffness_n_per_m"], result.columns
    intervals = np.diff(columns.time)[steady_window(columns.time)[:-1]]
    held = float(np.minimum(intervals, 1.02e-3).sum() / intervals.sum())
    assert held < 0.8
    assert stiffness["felt"] == pytest.approx(held * stiffness["asked"], rel=0.02)
    assert stiffness["shares"]["missed ticks"] > 0.99


def test_a_law_that_plans_for_late_ticks_shares_with_them(tmp_path: Path) -> None:
    late = LateTicks(rate=50.0, shortest=0.3e-3, longest=1e-3)
    shares = [
        result_of(tmp_path, f"device: {{watchdog: {watchdog}}}", late).summary["stiffness_n_per_m"]
        for watchdog in ("silent", "guarding")
    ]
    assert 0.02 < shares[0]["shares"]["missed ticks"] < 0.5
    assert shares[1]["shares"].get("missed ticks", 0.0) < 0.001
    for each in shares:
        assert math.fsum(each["shares"].values()) == pytest.approx(1.0)


def test_a_passive_run_at_rest_and_one_that_is_neither(tmp_path: Path) -> None:
    calm = result_of(tmp_path, "").summary
    assert calm["verdict"][0].startswith("Passive:")
    assert energy_in_words(calm["energy_left_j"]) in calm["verdict"][0]
    assert calm["verdict"][1].startswith("At rest")
    wild = result_of(tmp_path, "arguments: {law: none}").summary
    assert wild["verdict"][0].startswith("Not passive:")
    assert energy_in_words(-wild["true_energy_min_j"]) in wild["verdict"][0]
    assert wild["verdict"][1].startswith("Not at rest")


TRUTH = ("true_energy_min_j", "energy_left_j", "final_speed_m_per_s", "at_rest")
NONE = {"observed_energy_min_j": 0.0}
GAVE = {"observed_energy_min_j": -0.003}
LATE_WRITES = {
    "promise": "write_delay", "unit": "s", "stated": 0.003, "count": 1055, "of": 1056,
    "typical": 0.005, "largest": 0.017, "is_paid": False,
}  # fmt: skip
TOO_FAST = {
    "promise": "largest_speed", "unit": "m/s", "stated": 5.0, "count": 7, "of": 1056,
    "typical": 6.0, "largest": 8.0, "is_paid": True,
}  # fmt: skip


@pytest.mark.parametrize(
    ("change", "begin", "words"),
    [
        (NONE, "Passive", "motor"),
        ({**NONE, "observed_energy_error_j": 2e-4}, "Passive by the certificate", "at most 200 uJ"),
        ({"observed_energy_min_j": -0.003}, "Passive by the certificate", "up to 3 mJ"),
        ({**GAVE, "observed_energy_error_j": 2e-4}, "Passive by the certificate", "(± 200 uJ)"),
        ({**GAVE, "observed_energy_error_j": 4e-3}, "Passive by the certificate", "at most 7 mJ"),
        ({**GAVE, "law": "tdpa"}, "Unknown", "3 mJ"),
        ({**GAVE, "law": "left: certified"}, "Unknown", "3 mJ"),  # without its launch file
        ({**GAVE, "largest_allowance_j": 0.002}, "Passive by the certificate but for", "2 mJ"),
        ({"broken_promises": [LATE_WRITES]}, "Not covered by the certificate: 1,055 of", "17 ms"),
        ({"broken_promises": [{**LATE_WRITES, "is_paid": True}]}, "Covered", "17 ms"),
        ({"broken_promises": [TOO_FAST], **GAVE}, "7 of 1,056 readings were refused", "Passive by"),
    ],
)
def test_without_ground_truth_it_says_what_is_known(
    tmp_path: Path, change: dict[str, Any], begin: str, words: str
) -> None:
    known = result_of(tmp_path, "").summary
    line = verdict({**known, **dict.fromkeys(TRUTH), **change}, {})[0]
    assert line.startswith(begin)
    assert words in line
    assert ("broken_promises" in change) or line.startswith(("Passive", "Unknown"))


def test_of_several_hands_the_law_is_that_of_the_launch_file(tmp_path: Path) -> None:
    known = result_of(tmp_path, "").summary
    summary = {**known, **dict.fromkeys(TRUTH), **GAVE, "law": "left: certified"}
    assert verdict(summary, {"device": {"law": "certified"}})[0].startswith("Passive by")


def test_of_several_hands_only_the_one_that_failed_says_how(tmp_path: Path) -> None:
    failed = "leader/device ended unexpectedly; its last lines:\n  forcebound: unplugged"
    calm = result_of(tmp_path, "").summary
    own, other = (verdict({**calm, "failed": failed, "hand": h}, {})[0] for h in ("leader", "left"))
    assert "unplugged" in own
    assert "leader" in other
    assert "unplugged" not in other


@pytest.mark.parametrize(("has_stamps", "delay"), [(False, 3e-3), (True, 3e-3), (False, 4.6e-3)])
def test_forces_later_than_stated_are_named_first_and_no_certificate_covers_the_run(
    has_stamps: bool, delay: float
) -> None:
    _, result = run_slow("certified", 1000.0, 1.5, has_stamps=has_stamps, write_delay=delay)
    summary, columns = result.summary, result.columns
    line = summary["verdict"][0]
    waits = (columns.write_ns - columns.read_ns)[columns.applied_force[:, 0] > 0.0] * 1e-9
    if delay > waits.max():
        assert summary["broken_promises"] == []
        assert line.startswith("Passive")
        return
    (broken,) = summary["broken_promises"]
    assert broken["promise"] == "write_delay"
    assert broken["largest"] == pytest.approx(waits.max())
    assert broken["typical"] == pytest.approx(float(np.median(waits)), rel=0.05)
    assert broken["count"] >= np.count_nonzero(waits > delay) > 0.9 * waits.size
    assert broken["count"] <= summary["late_writes"]
    is_paid = summary["largest_allowance_j"] <= result.document["device"]["allowance"]
    assert line.startswith("Covered" if is_paid else "Not covered by the certificate")
    assert "Passive" not in line


def test_of_a_run_that_changed_its_law_only_the_certified_one_breaks_a_promise() -> None:
    _, result = run_slow("none", 500.0, 1.0)
    middle = int(result.columns.time_ns[75])
    changed = Event(0, middle, "device", LAW_CHANGED, False, "", {"law": "certified"})
    summary = replace(result, events=[changed]).summary
    first, then = summary["laws"]
    assert first["broken_promises"] == summary["broken_promises"] == []
    assert then["broken_promises"][0]["promise"] == "write_delay"
    assert "Not covered" not in summary["verdict"][0]
    assert "s: Not covered by the certificate" in summary["verdict"][1]


def test_a_law_without_a_certificate_breaks_no_promise() -> None:
    _, result = run_slow("none", 1000.0, 1.0)
    assert result.summary["late_writes"] > 0
    assert result.summary["broken_promises"] == []
    assert result.summary["verdict"][0].startswith("Unknown if passive")


def test_a_force_that_lasts_beyond_the_watchdog_limit_is_a_broken_promise() -> None:
    kept, broken = (
        run_slow("certified", 1000.0, 1.0, write_delay=5e-3, watchdog_limit=limit)[1].summary
        for limit in (0.02, 6.9e-3)  # holds are 6.2 to 7.2 ms
    )
    assert kept["hold_limit_overruns"] > 0
    assert kept["broken_promises"] == []
    (one,) = broken["broken_promises"]
    assert one["promise"] == "watchdog_limit"
    assert 6.9e-3 < one["largest"] < 7.5e-3
    assert broken["verdict"][0].startswith("Not covered by the certificate")


def test_readings_that_are_refused_are_named_and_cost_only_force(tmp_path: Path) -> None:
    text = "device: {largest_speed: 0.05 m/s}"
    summary = result_of(tmp_path, text).summary
    (one,) = summary["broken_promises"]
    assert one["promise"] == "largest_speed"
    assert one["count"] == summary["refused_readings"] > 10
    assert 0.05 < one["typical"] <= one["largest"] < 0.3  # it approaches at 0.2 m/s
    line = summary["verdict"][0]
    assert line.index("readings were refused") < line.index("Passive: ")
    assert not any("refused" in other for other in summary["verdict"][1:])


def test_ground_truth_does_not_hide_a_broken_promise(tmp_path: Path) -> None:
    late = "truth: {write_delay: 0.5 ms, watchdog: 1}, watchdog: reporting"
    summary = result_of(tmp_path, f"device: {{{late}, write_delay: 0.2 ms}}").summary
    assert summary["broken_promises"][0]["typical"] == pytest.approx(0.5e-3)
    assert summary["verdict"][0].startswith("Not covered by the certificate")
    assert "the hand never received" in summary["verdict"][0]


def test_within_a_stated_allowance_a_run_is_passive_but_for_it(tmp_path: Path) -> None:
    known = {**result_of(tmp_path, "").summary, "true_energy_min_j": -0.004}
    for allowance, begin in ((0.0, "Not passive"), (0.003, "Not passive"), (0.005, "Passive but")):
        device = {"law": "certified", "allowance": allowance}
        assert verdict(known, {"device": device})[0].startswith(begin)


def test_a_wall_without_stiffness_has_a_verdict(tmp_path: Path) -> None:
    summary = result_of(tmp_path, "arguments: {stiffness: 0 N/mm}").summary
    assert summary["stiffness_n_per_m"] is None
    assert summary["verdict"][0].startswith("Passive")


@pytest.mark.parametrize(("name", "stiffness"), [("push_mass", "2"), ("touch_sphere", "1")])
def test_the_stiffness_felt_is_in_the_unit_of_the_file(name: str, stiffness: str) -> None:
    lines = run_virtual(load(name), 1.0).summary["verdict"]
    assert any(f"{stiffness} N/mm of {stiffness} N/mm" in line for line in lines)


def test_what_failed_is_named(tmp_path: Path) -> None:
    lossy = "links: {environment_reply: {loss: 30 %}}"
    summary = result_of(tmp_path, lossy, LATE).summary
    last = summary["verdict"][-1]
    assert last.startswith("Faults:")
    assert "environment_reply" in last
    assert f"{summary['deadline_misses']} ticks missed" in last
    faults = {"faults": {"environment_lost": 2}, "rejected_packets": {"age": 5}}
    few = {"deadline_misses": 1, "samples": 1, "refused_readings": 1}
    last = verdict({**summary, **faults, **few}, {})[-1]
    assert "environment lost 2 times" in last
    assert "5 age" in last
    assert "1 tick missed" in last
    assert "1 reading refused" in last


@pytest.mark.parametrize(
    "name", ["five_bar_wall", "follow_path", "impedance", "push_mass", "three_axes", "touch_sphere"]
)
def test_with_several_axes_moving_bodies_or_no_wall_there_is_a_verdict(name: str) -> None:
    lines = run_virtual(load(name), 0.3).summary["verdict"]
    assert 3 <= len(lines) <= 5
    assert lines[0].startswith("Passive")
    felt = "Spring between hand and body" if name == "push_mass" else "Stiffness felt"
    assert any(line.startswith(felt) for line in lines)


def test_a_recording_whose_law_is_no_longer_known_has_its_result(tmp_path: Path) -> None:
    result = result_of(tmp_path, "")
    device = {**result.document["device"], "law": "certified_memoryless"}
    old = RunResult(result.columns, {**result.document, "device": device})
    assert old.summary["law"] == "certified_memoryless"
    assert verdict(old.summary, old.document)
    assert old.summary["little_force"] == []


@pytest.mark.parametrize("delay", ["0 ms", "5 ms"])
def test_nobody_advises_stronger_motors_to_a_hand_that_gets_energy(delay: str) -> None:
    summary = run_virtual(load("stiff_wall", ["law:=none", f"delay:={delay}"]), 2.0).summary
    assert [cause["cause"] for cause in summary["little_force"]][:1] == ["saturation"]
    assert summary["verdict"][0].startswith("Not passive")
    assert not any("device.saturation" in line for line in summary["verdict"])
