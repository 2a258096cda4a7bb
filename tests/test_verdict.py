"""The verdict on a run: what is so in its words, and the shares of runs whose cause is known."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from launch_texts import written

from forcebound.graph.loader import load
from forcebound.results.cells import energy
from forcebound.results.contact import steady_window
from forcebound.results.verdict import verdict
from forcebound.run.results import RunResult
from forcebound.run.simulation import LateTicks
from forcebound.run.virtual import run_virtual

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
    assert energy(calm["energy_left_j"]) in calm["verdict"][0]
    assert calm["verdict"][1].startswith("At rest")
    wild = result_of(tmp_path, "arguments: {law: none}").summary
    assert wild["verdict"][0].startswith("Not passive:")
    assert energy(-wild["true_energy_min_j"]) in wild["verdict"][0]
    assert wild["verdict"][1].startswith("Not at rest")


@pytest.mark.parametrize(
    ("change", "begin", "words"),
    [
        ({"observed_energy_min_j": 0.0}, "Passive", "motor"),
        ({"observed_energy_min_j": -0.003}, "Passive by the certificate", "3 mJ"),
        ({"observed_energy_min_j": -0.003, "law": "tdpa"}, "Unknown", "3 mJ"),
        ({"observed_energy_min_j": -0.003, "late_writes": 7}, "Unknown", "7 writes"),
    ],
)
def test_without_ground_truth_it_says_what_is_known(
    tmp_path: Path, change: dict[str, Any], begin: str, words: str
) -> None:
    truth = ("true_energy_min_j", "energy_left_j", "final_speed_m_per_s", "at_rest")
    known = result_of(tmp_path, "").summary
    line = verdict({**known, **dict.fromkeys(truth), **change}, {})[0]
    assert line.startswith(begin)
    assert words in line


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
    assert any(line.startswith("Stiffness felt") for line in lines)


def test_a_recording_whose_law_is_no_longer_known_has_its_result(tmp_path: Path) -> None:
    result = result_of(tmp_path, "")
    device = {**result.document["device"], "law": "certified_memoryless"}
    old = RunResult(result.columns, {**result.document, "device": device})
    assert old.summary["law"] == "certified_memoryless"
    assert verdict(old.summary, old.document)
    assert old.summary["little_force"] == []
